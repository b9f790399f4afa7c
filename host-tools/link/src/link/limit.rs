//! Longest waits for a device, in the device's own time.
//!
//! A virtual stylus on a busy computer may be many times slower than real time. Its announcement states its virtual
//! time. A wait for it ends only when the longest wait has passed in virtual time, too.

use std::pin::pin;
use std::time::{Duration, Instant};

use virtual_link::announcement::{Announced, announced};

use super::address::LinkAddress;

/// Interval between readings of the virtual time.
const LOOK_INTERVAL: Duration = Duration::from_millis(250);

/// Longest real time without progress of the virtual time. A virtual stylus whose time stands still for so long is
/// halted.
const LONGEST_HALT: Duration = Duration::from_secs(10);

/// Delay of this program beyond which an answer may have arrived in time, although the wait is over: a busy computer
/// has not run this program meanwhile. It is also the time that such an answer then has to be read.
const LATE: Duration = Duration::from_millis(100);

/// A wait for the device at a link.
#[derive(Debug)]
pub(super) struct Limit {
    link: LinkAddress,
    longest: Duration,
    begin: Instant,
    seen: Option<Seen>,
}

/// The virtual times that were read.
#[derive(Debug)]
struct Seen {
    first: Duration,
    last: Duration,
    /// Instant at which `last` changed.
    moved: Instant,
}

impl Limit {
    /// Begins a wait of at most `longest` for the device at `link`.
    pub(super) fn new(link: &LinkAddress, longest: Duration) -> Self {
        Self {
            link: link.clone(),
            longest,
            begin: Instant::now(),
            seen: None,
        }
    }

    /// Returns whether the longest wait has passed in the device's time.
    pub(super) fn has_passed(&mut self) -> bool {
        self.has_passed_by(announced)
    }

    /// Like [`Limit::has_passed`], with a function that reads the announced virtual styluses. It is not called before
    /// the real time has passed, so a wait for a device that answers in time costs nothing.
    fn has_passed_by(&mut self, announced: impl Fn() -> Vec<Announced>) -> bool {
        if self.begin.elapsed() < self.longest {
            return false;
        }
        if !self.link.is_of_an_emulator() {
            return true;
        }
        let is_its = |link: &String| link.parse().is_ok_and(|its| self.link.is_of_same_port(&its));
        let Some(own) = (announced().into_iter()).find(|one| one.links.iter().any(is_its)) else {
            return true;
        };
        // The virtual time counts from this first look, so the longest wait passes in real and then in virtual time.
        let now = Instant::now();
        let seen = self.seen.get_or_insert(Seen {
            first: own.time,
            last: own.time,
            moved: now,
        });
        if own.time != seen.last {
            (seen.last, seen.moved) = (own.time, now);
        }
        let is_halted = now - seen.moved > LONGEST_HALT;
        is_halted || seen.last.saturating_sub(seen.first) >= self.longest
    }

    /// Waits for `answer`. Returns `None` if the longest wait passes first in the device's time.
    pub(super) async fn wait<T>(mut self, answer: impl Future<Output = T>) -> Option<T> {
        let mut answer = pin!(answer);
        let mut pause = self.longest;
        loop {
            match tokio::time::timeout(pause, &mut answer).await {
                Ok(answer) => return Some(answer),
                Err(_) if self.has_passed() => {
                    let is_late = self.begin.elapsed() >= self.longest + LATE;
                    let last = if is_late { LATE } else { Duration::ZERO };
                    return tokio::time::timeout(last, answer).await.ok();
                }
                Err(_) => pause = LOOK_INTERVAL.min(self.longest),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::task::Poll;

    use super::*;

    /// A limit whose real time has passed.
    fn passed(link: &str, longest_ms: u64) -> Limit {
        let mut limit = Limit::new(&link.parse().unwrap(), Duration::ZERO);
        assert!(!limit.link.is_of_an_emulator() || limit.has_passed_by(Vec::new));
        limit.longest = Duration::from_millis(longest_ms);
        limit.begin -= limit.longest;
        limit
    }

    fn at(ms: u64) -> Vec<Announced> {
        let of = |port: u16, ms| Announced {
            links: vec![
                format!("tcp:127.0.0.1:{port}"),
                format!("usb-virtual:127.0.0.1:{}", port + 1),
            ],
            time: Duration::from_millis(ms),
        };
        // The time of another virtual stylus must not matter.
        vec![of(4100, 1_000_000 + 1000 * ms), of(4000, ms)]
    }

    #[test]
    fn a_slow_virtual_stylus_has_its_time_and_no_more() {
        for link in ["tcp:localhost:4000", "usb-virtual:127.0.0.1:4001"] {
            let mut limit = passed(link, 100);
            for (time_ms, has_passed) in [(7, false), (8, false), (106, false), (107, true)] {
                assert_eq!(limit.has_passed_by(|| at(time_ms)), has_passed, "{time_ms}");
            }
        }
    }

    #[test]
    fn the_real_time_counts_for_a_board_and_for_a_virtual_stylus_that_is_gone_or_halted() {
        for link in ["usb", "serial:/dev/ttyACM0", "tcp:127.0.0.1:4002"] {
            assert!(passed(link, 100).has_passed_by(|| at(7)), "{link}");
        }
        let mut halted = passed("tcp:127.0.0.1:4000", 100);
        assert!(!halted.has_passed_by(|| at(7)));
        halted.seen.as_mut().unwrap().moved -= LONGEST_HALT + Duration::from_millis(1);
        assert!(halted.has_passed_by(|| at(7)));
        assert!(passed("tcp:127.0.0.1:4000", 100).has_passed_by(Vec::new));
    }

    #[test]
    fn an_answer_that_is_there_when_this_program_runs_again_after_the_limit_is_taken() {
        let mut limit = Limit::new(&"usb".parse().unwrap(), Duration::ZERO);
        limit.begin -= LATE;
        let mut looks = 0;
        let answer = std::future::poll_fn(|context| {
            looks += 1;
            context.waker().wake_by_ref();
            if looks < 2 {
                return Poll::Pending;
            }
            Poll::Ready(looks)
        });
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_time()
            .build()
            .unwrap();
        let taken = runtime.block_on(limit.wait(answer));
        assert_eq!(taken, Some(2));
    }

    #[test]
    fn nothing_is_read_while_the_real_time_runs() {
        let mut limit = Limit::new(&"tcp:127.0.0.1:4000".parse().unwrap(), Duration::from_hours(1));
        assert!(!limit.has_passed_by(|| panic!("nobody asks")));
    }
}
