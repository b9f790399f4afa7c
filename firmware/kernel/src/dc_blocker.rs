//! First-order high-pass filter, so that no steady current warms the coil or pushes the hand.
//!
//! The device's safety stages and the player on a computer use it. y = x - m, where the mean m follows x:
//! m += α (x - m). The corner frequency is α f / 2π to first order: 1.99 Hz, with half the α at 10 kHz.

use crate::fixed::shift_toward_zero;

/// α at 5 kHz: 82 / 2^15.
pub const ALPHA: i64 = 82;
/// α at 10 kHz.
pub const ALPHA_OF_PAIR: i64 = ALPHA / 2;
const ALPHA_BITS: u32 = 15;

/// Binary digits of the mean beyond the input's. They keep the round-off of the mean below 2^-6 of the input's last
/// digit: a difference of less than 1 / α of the mean's last digits, 800 at 10 kHz, moves the mean no more.
const EXTRA_BITS: u32 = 16;

/// State of the filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DcBlocker {
    /// The mean that is subtracted, in units of the input of 2^-16.
    mean: i64,
}

impl Default for DcBlocker {
    fn default() -> Self {
        Self::new()
    }
}

impl DcBlocker {
    /// A filter whose input has been zero.
    pub const fn new() -> Self {
        Self { mean: 0 }
    }

    /// `input`, at most 2^31 in magnitude, without its mean: at most twice the largest input.
    #[inline(always)]
    pub fn next<const ALPHA: i64>(&mut self, input: i64) -> i64 {
        // Means are below 2^47, so the product stays below 2^55.
        let difference = (input << EXTRA_BITS) - self.mean;
        self.mean += shift_toward_zero(difference * ALPHA, ALPHA_BITS);
        shift_toward_zero((input << EXTRA_BITS) - self.mean, EXTRA_BITS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FULL: i64 = 1 << 31;

    /// The next output at a rate, by its number of samples per tick.
    fn next(blocker: &mut DcBlocker, samples_per_tick: u32, input: i64) -> i64 {
        match samples_per_tick {
            1 => blocker.next::<ALPHA>(input),
            _ => blocker.next::<ALPHA_OF_PAIR>(input),
        }
    }

    proptest! {
        #[test]
        fn an_output_is_at_most_twice_the_largest_input(
            inputs in prop::collection::vec((-FULL..=FULL, 1u32..=2), 1..2000),
        ) {
            let mut blocker = DcBlocker::new();
            for (input, per_tick) in inputs {
                prop_assert!(next(&mut blocker, per_tick, input).abs() <= 2 * FULL);
            }
        }
    }

    #[test]
    fn the_corner_is_at_two_hertz_at_each_rate() {
        // A sine of 2 Hz passes with 1/√2 of its amplitude, one of 40 Hz with all of it.
        let amplitude = |hertz: f64, per_tick: u32| {
            let mut blocker = DcBlocker::new();
            let mut highest = 0.0f64;
            for n in 0..50_000 * per_tick {
                let rate_hz = 5_000.0 * f64::from(per_tick);
                let phase = core::f64::consts::TAU * hertz * f64::from(n) / rate_hz;
                let input = (phase.sin() * FULL as f64) as i64;
                let out = next(&mut blocker, per_tick, input) as f64 / FULL as f64;
                if n > 25_000 * per_tick {
                    highest = highest.max(out.abs());
                }
            }
            highest
        };
        for per_tick in [1, 2] {
            assert!((amplitude(2.0, per_tick) - 0.5f64.sqrt()).abs() < 0.01);
            assert!(amplitude(40.0, per_tick) > 0.995);
        }
    }
}
