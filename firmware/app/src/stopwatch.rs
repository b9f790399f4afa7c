//! Time of an upload by its steps, for the host to show. What no step took was spent waiting for the host and its link.

use model_format::link::UploadTimes;

use crate::slots::Step;

/// Times of the upload under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopwatch {
    times: UploadTimes,
    begun_us: u64,
    /// End of the last step, or begin of the request.
    last_us: u64,
}

impl Stopwatch {
    /// The times of an upload that begins at `now_us`.
    pub const fn begun_at(now_us: u64) -> Self {
        Self {
            times: UploadTimes {
                erase_us: 0,
                program_us: 0,
                check_us: 0,
                wait_us: 0,
                sectors: 0,
                words: 0,
            },
            begun_us: now_us,
            last_us: now_us,
        }
    }

    /// These times, with a request that is served from `now_us` on.
    #[must_use]
    pub const fn resumed_at(self, now_us: u64) -> Self {
        Self {
            last_us: now_us,
            ..self
        }
    }

    /// Notes that `step` has ended at `now_us`. It began where the step before it ended, or with the request.
    pub fn end(&mut self, step: Step, now_us: u64) {
        let took_us = narrow(now_us.saturating_sub(self.last_us));
        self.last_us = now_us;
        let sum = match step {
            Step::Erase => {
                self.times.sectors = self.times.sectors.saturating_add(1);
                &mut self.times.erase_us
            }
            Step::Program { words } => {
                self.times.words = self.times.words.saturating_add(words);
                &mut self.times.program_us
            }
            Step::Check => &mut self.times.check_us,
        };
        *sum = sum.saturating_add(took_us);
    }

    /// The times of an upload that has ended at `now_us`.
    pub fn times_at(&self, now_us: u64) -> UploadTimes {
        let whole_us = now_us.saturating_sub(self.begun_us);
        UploadTimes {
            wait_us: narrow(whole_us.saturating_sub(self.times.total_us())),
            ..self.times
        }
    }
}

/// A time that is at most an hour, µs.
fn narrow(us: u64) -> u32 {
    u32::try_from(us).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_step_took_was_spent_waiting_and_nothing_is_counted_twice() {
        let mut watch = Stopwatch::begun_at(1_000);
        watch.end(Step::Check, 1_010);
        watch.end(Step::Erase, 2_010);
        watch = watch.resumed_at(2_500);
        watch.end(Step::Program { words: 16 }, 4_500);
        watch = watch.resumed_at(5_000);
        watch.end(Step::Program { words: 1 }, 5_101);
        let times = watch.times_at(5_101);
        let expected = UploadTimes {
            erase_us: 1_000,
            program_us: 2_101,
            check_us: 10,
            wait_us: 990,
            sectors: 1,
            words: 17,
        };
        assert_eq!(times, expected);
        assert_eq!(times.total_us(), 4_101);
    }
}
