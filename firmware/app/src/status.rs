//! Histogram of the tick's duration.

use model_format::link::{CycleRange, TICK_BIN_COUNT, TICK_BIN_CYCLES, TickHistogram};

/// Durations of ticks, in bins of fixed width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Histogram {
    shortest: u32,
    longest: u32,
    bins: [u32; TICK_BIN_COUNT],
}

const BIN_BITS: u32 = TICK_BIN_CYCLES.ilog2();
const _: () = assert!(TICK_BIN_CYCLES.is_power_of_two());

impl Default for Histogram {
    fn default() -> Self {
        Self::new()
    }
}

impl Histogram {
    /// A histogram of no ticks.
    pub const fn new() -> Self {
        Self {
            shortest: u32::MAX,
            longest: 0,
            bins: [0; TICK_BIN_COUNT],
        }
    }

    /// Counts a tick that took `cycles`.
    #[inline(always)]
    pub fn count(&mut self, cycles: u32) {
        let bin = ((cycles >> BIN_BITS) as usize).min(TICK_BIN_COUNT - 1);
        self.bins[bin] = self.bins[bin].saturating_add(1);
        self.shortest = self.shortest.min(cycles);
        self.longest = self.longest.max(cycles);
    }

    /// Returns the range of the ticks' durations since the previous call, and begins a new range. `counted` is the
    /// number of ticks in the ranges of earlier calls. The bins are not reset.
    pub fn take_range(&mut self, counted: &mut u32) -> CycleRange {
        let total = (self.bins.iter()).fold(0u32, |total, &bin| total.saturating_add(bin));
        CycleRange {
            runs: total - core::mem::replace(counted, total),
            shortest: core::mem::replace(&mut self.shortest, u32::MAX),
            longest: core::mem::take(&mut self.longest),
        }
    }

    /// This histogram, with a range that also covers the range of `earlier`.
    #[must_use]
    pub fn with_range(mut self, earlier: CycleRange) -> Self {
        self.shortest = self.shortest.min(earlier.shortest);
        self.longest = self.longest.max(earlier.longest);
        self
    }

    /// The histogram as it is sent, for a processor with a clock of `core_hz`.
    pub fn report(&self, core_hz: u32) -> TickHistogram {
        TickHistogram {
            core_hz,
            shortest: self.shortest,
            longest: self.longest,
            bins: self.bins,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_tick_is_counted_once_in_the_bin_of_its_length(ticks in prop::collection::vec(any::<u32>(), 1..200)) {
            let mut histogram = Histogram::new();
            let mut expected = [0u32; TICK_BIN_COUNT];
            for &cycles in &ticks {
                histogram.count(cycles);
                expected[((cycles / TICK_BIN_CYCLES) as usize).min(TICK_BIN_COUNT - 1)] += 1;
            }
            let report = histogram.report(400_000_000);
            prop_assert_eq!(report.bins, expected);
            prop_assert_eq!(Some(report.shortest), ticks.iter().copied().min());
            prop_assert_eq!(Some(report.longest), ticks.iter().copied().max());
        }
    }

    #[test]
    fn a_taken_range_has_the_ticks_since_the_last_one_and_the_bins_go_on() {
        let mut histogram = Histogram::new();
        let mut counted = 0;
        histogram.count(500);
        histogram.count(9_000);
        let first = histogram.take_range(&mut counted);
        assert_eq!((first.runs, first.shortest, first.longest), (2, 500, 9_000));
        histogram.count(700);
        let second = histogram.take_range(&mut counted);
        assert_eq!((second.runs, second.shortest, second.longest), (1, 700, 700));
        assert_eq!(histogram.take_range(&mut counted), CycleRange::NONE);
        let whole = histogram.with_range(first.merged(second)).report(1);
        assert_eq!((whole.shortest, whole.longest), (500, 9_000));
        assert_eq!(whole.bins.iter().sum::<u32>(), 3);
    }

    #[test]
    fn the_last_bin_begins_within_the_period() {
        let period = 400_000_000 / crate::SAMPLE_RATE_HZ;
        assert!((TICK_BIN_COUNT as u32 - 1) * TICK_BIN_CYCLES < period);
        assert!(TICK_BIN_COUNT as u32 * TICK_BIN_CYCLES >= period);
    }
}
