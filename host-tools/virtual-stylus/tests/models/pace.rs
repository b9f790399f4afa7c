//! Reports of a pace that is slower than real time, over given times.

use std::time::Duration;

use virtual_stylus::pace::Pace;

/// Seconds of real time at which a run with a constant ratio `share` of virtual to real time is reported as slow.
fn told(share: f64, seconds: u64) -> Vec<u64> {
    let mut pace = Pace::default();
    let is_told = |&at: &u64| {
        let real = Duration::from_secs(at);
        pace.slow(real, real.mul_f64(share)).is_some()
    };
    (0..=seconds).filter(is_told).collect()
}

#[test]
fn a_slow_run_is_told_once_a_minute_and_one_that_keeps_up_never() {
    assert_eq!(told(0.03, 150), [10, 70, 130]);
    assert_eq!(told(0.9, 150), []);
}

#[test]
fn the_share_is_that_of_the_last_interval_alone() {
    let mut pace = Pace::default();
    let second = Duration::from_secs;
    assert_eq!(pace.slow(second(10), second(10)), None);
    assert_eq!(pace.slow(second(20), second(12)), Some(0.2));
}
