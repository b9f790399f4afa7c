//! Rounding to whole converter steps, with an error at frequencies to which neither the coil nor the skin responds.
//!
//! Error feedback of the third order: the error of each code is fed back to the next three, so its spectrum is that of
//! white noise through (1 - z^-1) (1 - (2 - 2^-6) z^-1 + z^-2), with zeros at 0 and 796 Hz. From 20 to 1000 Hz less
//! than 0.0001 steps RMS remain. In exchange the error grows above that band: an output differs from its input by up to
//! four steps, and by 1.3 steps RMS. Feedback of the second order leaves 0.0007 steps. That raises a third-octave band
//! 50 dB below a texture's level of 0.02 m/s² by 2 dB.
//!
//! Only the error of rounding is fed back. What the limits cut from a code is not, so nothing winds up.

use super::{CODE_BITS, round_to_step};

/// Position of the upper zeros: the coefficients of the last two errors are ±(3 - 2^-`ZERO_BITS`).
const ZERO_BITS: u32 = 6;

/// Largest difference of an output from its input, converter steps: half a step times the sum of the magnitudes of the
/// filter's coefficients.
pub const LARGEST_DEVIATION: i32 = 4;

/// The errors of the last three codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shaper {
    /// Errors from the last one back, converter steps of 2^-15, at most half a step.
    errors: [i32; 3],
}

impl Shaper {
    pub const fn new() -> Self {
        Self { errors: [0; 3] }
    }

    /// Forgets the errors if `silent`, so that an input of zero gives exactly zero from then on.
    #[inline(always)]
    pub fn forget_if(&mut self, silent: bool) {
        // All ones if the errors stay, 0 otherwise: the path does not depend on the signal.
        let kept = i32::from(silent) - 1;
        self.errors = self.errors.map(|error| error & kept);
    }

    /// The next output, whole converter steps, for an `input` of at most 2^30 steps of 2^-15.
    #[inline(always)]
    pub fn next(&mut self, input: i32) -> i32 {
        let [last, second, third] = self.errors;
        let change = last - second;
        let wanted = input + (3 * change - (change >> ZERO_BITS)) + third;
        let output = round_to_step(wanted);
        self.errors = [wanted - (output << CODE_BITS), last, second];
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use proptest::prelude::*;
    use std::vec::Vec;

    const STEP: f64 = (1 << CODE_BITS) as f64;
    /// Codes of a second at the pin.
    const SECOND: usize = 40_000;

    /// Outputs minus inputs over a second of a sine, converter steps.
    fn errors(amplitude: f64, hertz: f64) -> Vec<f64> {
        let mut shaper = Shaper::new();
        let input = |n| (amplitude * STEP * (TAU * hertz * n as f64 / SECOND as f64).sin()) as i32;
        (0..SECOND)
            .map(input)
            .map(|input| f64::from(shaper.next(input)) - f64::from(input) / STEP)
            .collect()
    }

    /// RMS of `values`, a second of them, in whole hertz from `low` to `high`, through a Hann window that keeps power.
    fn rms(values: &[f64], low: u32, high: u32) -> f64 {
        let power = |hertz: u32| {
            let (mut sum, turn) = ([0.0; 2], TAU * f64::from(hertz) / SECOND as f64);
            for (n, value) in values.iter().enumerate() {
                let hann = 1.0 - (TAU * n as f64 / SECOND as f64).cos();
                let value = value * hann / 1.5f64.sqrt();
                let (sine, cosine) = (turn * n as f64).sin_cos();
                sum[0] += value * cosine;
                sum[1] += value * sine;
            }
            2.0 * (sum[0].powi(2) + sum[1].powi(2)) / (SECOND as f64).powi(2)
        };
        (low..=high).map(power).sum::<f64>().sqrt()
    }

    #[test]
    fn errors_leave_the_band_that_is_felt_and_lie_above_it() {
        for (amplitude, hertz) in [(0.7, 61.3), (300.0, 733.1)] {
            let errors = errors(amplitude, hertz);
            let total = errors.iter().map(|error| error * error).sum::<f64>() / SECOND as f64;
            let felt = rms(&errors, 20, 1000);
            let below = rms(&errors, 0, 19).hypot(felt).hypot(rms(&errors, 1001, 2000));
            let above = (total - below * below).sqrt();
            assert!(felt < 0.000_1, "{felt} steps from 20 to 1000 Hz");
            assert!((1.2..1.4).contains(&above), "{above} steps above 2 kHz");
        }
    }

    proptest! {
        #[test]
        fn an_output_is_at_most_four_steps_from_its_input(
            inputs in prop::collection::vec(prop_oneof![-1i32 << 30..=1 << 30, -200_000i32..200_000], 1..500),
        ) {
            let mut shaper = Shaper::new();
            for input in inputs {
                let deviation = (f64::from(shaper.next(input)) - f64::from(input) / STEP).abs();
                prop_assert!(deviation <= f64::from(LARGEST_DEVIATION), "{deviation}");
            }
        }

        #[test]
        fn silence_after_forgetting_is_exactly_zero(
            inputs in prop::collection::vec(-200_000i32..200_000, 1..100),
        ) {
            let mut shaper = Shaper::new();
            for input in inputs {
                shaper.forget_if(false);
                shaper.next(input);
            }
            for _ in 0..20 {
                shaper.forget_if(true);
                prop_assert_eq!(shaper.next(0), 0);
            }
            prop_assert_eq!(shaper, Shaper::new());
        }
    }
}
