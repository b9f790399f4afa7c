//! Biased autocorrelation of a signal, computed from its power spectrum.

use std::f64::consts::FRAC_PI_2;

use realfft::num_complex::Complex;

use crate::dsp::sums::energy;
use crate::dsp::with_planner;

/// Longest taper of an end, samples: 0.1 s at the models' rate. Longer ones leak no less in the bands of a texture and
/// lose more of a short recording.
const TAPER_SAMPLES: usize = 500;

/// A taper is at most one in so many of the signal's samples.
const TAPER_SHARE: usize = 20;

/// Second-order statistics of a signal.
///
/// The rectangular window leaks: a line of power P appears at a distance Δf as a density of P·fs/(2π² N Δf²). For 2 s
/// at 5 kHz, that is 71 dB below P in 1 Hz at a distance of 500 Hz. Components below this density cannot be modelled
/// from such a recording, unless its ends are tapered: the leakage of ends that rise and fall as a cosine over T falls
/// with the sixth power of the distance beyond 1/T.
#[derive(Clone, Debug)]
pub struct Autocorrelation {
    /// r(m) = (1/N) Σ a(n) a(n+m) for m from 0: biased. The unbiased estimate is not positive definite and is never
    /// used.
    pub lags: Vec<f64>,
    /// Power spectrum |A|² of the zero-padded signal, from 0 Hz to half the sample rate.
    pub power: Vec<f64>,
    /// Length of the transform behind `power`: the distance of its bins is the sample rate divided by this length.
    pub transform_length: usize,
}

impl Autocorrelation {
    /// Computes the autocorrelation of `signal` up to lag `max_lag`, or up to its length less one.
    pub fn of(signal: &[f64], max_lag: usize) -> Self {
        let samples = signal.len();
        let max_lag = max_lag.min(samples.saturating_sub(1));
        let transform_length = quick_length(samples + max_lag + 1);
        let (forward, inverse) = with_planner(|planner| {
            (
                planner.plan_fft_forward(transform_length),
                planner.plan_fft_inverse(transform_length),
            )
        });
        let mut padded = signal.to_vec();
        padded.resize(transform_length, 0.0);
        let mut spectrum = forward.make_output_vec();
        forward
            .process(&mut padded, &mut spectrum)
            .expect("lengths come from the plan");
        let power: Vec<f64> = spectrum.iter().map(Complex::norm_sqr).collect();
        for (bin, &power) in spectrum.iter_mut().zip(&power) {
            *bin = Complex::new(power, 0.0);
        }
        inverse
            .process(&mut spectrum, &mut padded)
            .expect("lengths come from the plan");
        let scale = 1.0 / (transform_length as f64 * samples.max(1) as f64);
        let mut lags: Vec<f64> = padded[..=max_lag].iter().map(|r| r * scale).collect();
        // Lag 0 is the exact power, without the round-off of the transform.
        lags[0] = energy(signal) / samples.max(1) as f64;
        Self {
            lags,
            power,
            transform_length,
        }
    }

    /// Computes the autocorrelation of `signal` with tapered ends: a cosine over 500 samples at each, or over
    /// a 20th of a short signal (the split cosine bell; Bingham, Godfrey and Tukey, IEEE Trans. Audio
    /// Electroacoustics 15, 1967, 56). All is scaled so that lag 0 is the power of the signal without taper.
    pub fn with_tapered_ends(signal: &[f64], max_lag: usize) -> Self {
        let samples = signal.len();
        let taper = TAPER_SAMPLES.min(samples / TAPER_SHARE);
        let mut tapered = signal.to_vec();
        for n in 0..taper {
            let weight = (FRAC_PI_2 * (n as f64 + 0.5) / taper as f64).sin().powi(2);
            tapered[n] *= weight;
            tapered[samples - 1 - n] *= weight;
        }
        let mut result = Self::of(&tapered, max_lag);
        let power = energy(signal) / samples.max(1) as f64;
        if result.lags[0] > 0.0 {
            let scale = power / result.lags[0];
            result.lags.iter_mut().for_each(|lag| *lag *= scale);
            result.power.iter_mut().for_each(|bin| *bin *= scale);
        }
        result
    }
}

/// Returns the smallest even length of at least `least` with no prime factors but 2, 3 and 5, because transforms of
/// such lengths are fast.
fn quick_length(least: usize) -> usize {
    let quick = |length: &usize| {
        let mut rest = *length;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1 && length.is_multiple_of(2)
    };
    let least = least.max(2);
    (least..=least.next_power_of_two())
        .find(quick)
        .expect("a power of two is quick")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lags_are_the_sums_of_their_definition(
            signal in prop::collection::vec(-10.0f64..10.0, 1..300), max_lag in 0usize..400,
        ) {
            let fast = Autocorrelation::of(&signal, max_lag).lags;
            prop_assert_eq!(fast.len(), max_lag.min(signal.len() - 1) + 1);
            for (lag, r) in fast.iter().enumerate() {
                let sum: f64 = signal.iter().zip(&signal[lag..]).map(|(a, b)| a * b).sum();
                prop_assert!((r - sum / signal.len() as f64).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn quick_lengths_are_the_least_that_hold_the_signal() {
        assert_eq!(quick_length(10_401), 10_800);
        assert_eq!(quick_length(1), 2);
        assert_eq!(quick_length(16), 16);
    }
}
