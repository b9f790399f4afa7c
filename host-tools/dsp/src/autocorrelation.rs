//! Biased autocorrelation of a signal, computed from its power spectrum.

use std::cell::RefCell;
use std::f64::consts::{EULER_GAMMA, FRAC_PI_2};
use std::rc::Rc;

use crate::fourier::{self, Complex};
use crate::spectrum::THIRD_OCTAVE_RATIO;
use crate::sums::{energy, sum};

/// Longest taper of an end, samples: 0.1 s at the models' sample rate. Longer tapers do not leak less in the bands of a
/// texture, and lose more of a short recording.
const TAPER_SAMPLES: usize = 500;

/// Least and largest exponent of frequency in the decay of the power spectrum above the recorded band: the decay beyond
/// one pair of poles and beyond four pairs.
const LEAST_FALL: f64 = 4.0;
const MOST_FALL: f64 = 16.0;

/// Largest fraction of a recording's power that filling the spectrum above the recorded band may add: 0.25 dB.
const MOST_ADDED: f64 = 0.06;

/// Least number of bins through which a line is fitted.
const LEAST_BINS: usize = 4;

/// A taper is at most the signal's length divided by this number.
const TAPER_SHARE: usize = 20;

/// Second-order statistics of a signal.
///
/// The rectangular window leaks: at a distance Δf from a line of power P, the leakage has the density P·fs/(2π² N Δf²).
/// For 2 s at 5 kHz, that is 70 dB below P in 1 Hz at a distance of 500 Hz. Components below this density cannot be
/// modelled from such a recording unless its ends are tapered. If the ends rise and fall as a cosine over the time T,
/// the leakage decreases with the sixth power of the distance beyond 1/T.
#[derive(Clone, Debug)]
pub struct Autocorrelation {
    /// r(m) = (1/N) Σ a(n) a(n+m) for m from 0: the biased estimate. The unbiased estimate is not positive definite and
    /// is never used.
    pub lags: Vec<f64>,
    /// Power spectrum |A|² of the zero-padded signal, from 0 Hz to half the sample rate.
    pub power: Vec<f64>,
    /// Length of the transform from which `power` comes. The spacing of the bins is the sample rate divided by this
    /// length.
    pub transform_length: usize,
}

impl Autocorrelation {
    /// Computes the autocorrelation of `signal` up to lag `max_lag`, or up to its length less one.
    pub fn of(signal: &[f64], max_lag: usize) -> Self {
        PaddedSpectrum::of(signal, max_lag).into_autocorrelation()
    }

    /// Fills the spectrum of a signal at `rate_hz` outside the range of frequencies in which the signal is valid, and
    /// computes the autocorrelation again. Otherwise a model of high order would follow the edges of a filter or of the
    /// recorded band.
    ///
    /// Below `below_hz`, the spectrum becomes flat, at its mean from `below_hz` to twice this frequency. Above
    /// `above_hz`, it continues to fall as in the third octave below, by 12 to 48 dB per octave, like the spectrum of a
    /// few resonances. This upper part has at least the power that was there before, and at most 6 % of the signal's
    /// power more.
    #[must_use]
    pub fn filled(mut self, below_hz: Option<f64>, above_hz: Option<f64>, rate_hz: f64) -> Self {
        let length = self.transform_length;
        let bin_of = |hz: f64| (hz * length as f64 / rate_hz).ceil() as usize;
        let transform = |power: &[f64]| {
            let mut lags = fourier::of_power(power, length);
            lags.truncate(self.lags.len());
            lags
        };
        let before = transform(&self.power)[0];
        // Silence has no spectrum that could be continued.
        if before <= 0.0 {
            return self;
        }
        if let Some(hz) = below_hz {
            let (edge, end) = (bin_of(hz), bin_of(2.0 * hz).min(self.power.len()));
            if edge < end {
                let mean = self.power[edge..end].iter().sum::<f64>() / (end - edge) as f64;
                self.power[..edge].fill(mean);
            }
        }
        if let Some(hz) = above_hz {
            let (first, edge) = (bin_of(hz / THIRD_OCTAVE_RATIO), bin_of(hz).min(self.power.len()));
            if first + LEAST_BINS <= edge {
                let (level, fall) = edge_of_noise(&self.power[first..edge], first);
                let at = |bin: usize| level * (edge as f64 / bin as f64).powf(fall);
                let beyond = sum(&self.power[edge..]);
                let wanted: f64 = (edge..self.power.len()).map(at).sum();
                let most = beyond + MOST_ADDED * sum(&self.power);
                // Without the upper bound, a resonance at the edge made a synthesis 4.7 dB louder than its recording.
                let share = wanted.clamp(beyond, most) / wanted.max(f64::MIN_POSITIVE);
                for (power, bin) in self.power[edge..].iter_mut().zip(edge..) {
                    *power = share * at(bin);
                }
            }
        }
        // Factor from the sum that the transform returns to the mean square of the samples.
        let scale = self.lags[0] / before;
        self.lags = transform(&self.power);
        self.lags.iter_mut().for_each(|lag| *lag *= scale);
        self
    }
}

/// Returns the level of the noise at the upper edge of the bins of a periodogram, whose lowest bin is `first`, and the
/// exponent of frequency by which the power falls there. They come from a straight line through the logarithms, to
/// which a tone adds little. The mean logarithm of an exponential variable is below the logarithm of its mean by
/// Euler's constant.
fn edge_of_noise(power: &[f64], first: usize) -> (f64, f64) {
    let edge = (first + power.len()) as f64;
    let points = power.iter().zip(first..).map(|(power, bin)| {
        let distance = (bin as f64 / edge).ln();
        (distance, power.max(f64::MIN_POSITIVE).ln())
    });
    let (mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0);
    for (distance, level) in points {
        x += distance;
        y += level;
        xx += distance * distance;
        xy += distance * level;
    }
    let count = power.len() as f64;
    let (x, y) = (x / count, y / count);
    let slope = (xy / count - x * y) / (xx / count - x * x).max(f64::MIN_POSITIVE);
    (
        (y - slope * x + EULER_GAMMA).exp(),
        (-slope).clamp(LEAST_FALL, MOST_FALL),
    )
}

/// Power spectrum of a signal that is padded with zeros to the length of a transform.
pub struct PaddedSpectrum {
    /// Like [`Autocorrelation::power`]; for a tapered signal, before scaling.
    pub power: Vec<f64>,
    /// See [`Autocorrelation::transform_length`].
    pub transform_length: usize,
    samples: usize,
    max_lag: usize,
    mean_square: f64,
    scale: f64,
}

impl PaddedSpectrum {
    /// Computes the spectrum of `signal`, for lags up to `max_lag`, or up to the signal's length less one.
    pub fn of(signal: &[f64], max_lag: usize) -> Self {
        let mean_square = energy(signal) / signal.len().max(1) as f64;
        Self::scaled(signal.to_vec(), max_lag, mean_square, 1.0)
    }

    /// Computes the spectrum of `signal` with tapered ends: a cosine over 500 samples at each end, or over a 20th of a
    /// short signal (the split cosine bell; Bingham, Godfrey and Tukey, IEEE Trans. Audio Electroacoustics 15, 1967,
    /// 56). The results are scaled so that the power is the power of the signal without taper.
    pub fn tapered(signal: &[f64], max_lag: usize) -> Self {
        let samples = signal.len();
        let mut tapered = signal.to_vec();
        for (n, weight) in taper(TAPER_SAMPLES.min(samples / TAPER_SHARE)).iter().enumerate() {
            tapered[n] *= weight;
            tapered[samples - 1 - n] *= weight;
        }
        let mean_square = energy(&tapered) / samples.max(1) as f64;
        let scale = if mean_square > 0.0 {
            energy(signal) / samples.max(1) as f64 / mean_square
        } else {
            1.0
        };
        Self::scaled(tapered, max_lag, mean_square, scale)
    }

    fn scaled(mut signal: Vec<f64>, max_lag: usize, mean_square: f64, scale: f64) -> Self {
        let samples = signal.len();
        let max_lag = max_lag.min(samples.saturating_sub(1));
        // The zeros after the signal keep the transform's circular correlation from wrapping around up to `max_lag`.
        let transform_length = fourier::quick_length(samples + max_lag + 1);
        signal.resize(transform_length, 0.0);
        let bins = fourier::forward(&mut signal);
        Self {
            power: bins.iter().map(Complex::norm_sqr).collect(),
            transform_length,
            samples,
            max_lag,
            mean_square,
            scale,
        }
    }

    /// Highest lag.
    pub fn max_lag(&self) -> usize {
        self.max_lag
    }

    /// Mean square of the signal: lag 0, without the round-off of the transform.
    pub fn mean_square(&self) -> f64 {
        self.mean_square * self.scale
    }

    /// See [`Autocorrelation::lags`].
    pub fn lags(&self) -> Vec<f64> {
        let mut lags = fourier::of_power(&self.power, self.transform_length);
        let to_lag = 1.0 / (self.transform_length as f64 * self.samples.max(1) as f64);
        lags.truncate(self.max_lag + 1);
        // The lags of every trial are kept in memory, and the transform is much longer than they are.
        lags.shrink_to_fit();
        lags.iter_mut().for_each(|r| *r = *r * to_lag * self.scale);
        // The sum of squares has less round-off than the transform.
        lags[0] = self.mean_square();
        lags
    }

    /// Returns the autocorrelation, with the scaled power spectrum.
    pub fn into_autocorrelation(self) -> Autocorrelation {
        Autocorrelation {
            lags: self.lags(),
            power: self.power.into_iter().map(|bin| bin * self.scale).collect(),
            transform_length: self.transform_length,
        }
    }
}

thread_local! {
    /// The last taper, kept because the recordings of a set mostly have the same length.
    static TAPER: RefCell<Rc<[f64]>> = RefCell::new(Rc::new([]));
}

/// Returns the weights of the first `length` samples; the last `length` samples have them in reverse order.
fn taper(length: usize) -> Rc<[f64]> {
    let weight = |n: usize| (FRAC_PI_2 * (n as f64 + 0.5) / length as f64).sin().powi(2);
    TAPER.with_borrow_mut(|last| {
        if last.len() != length {
            *last = (0..length).map(weight).collect();
        }
        Rc::clone(last)
    })
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

    proptest! {
        #[test]
        fn a_tapered_signal_has_the_power_of_the_signal_in_lags_and_spectrum(
            signal in prop::collection::vec(-10.0f64..10.0, 1..300), max_lag in 0usize..400,
        ) {
            let whole = PaddedSpectrum::tapered(&signal, max_lag).into_autocorrelation();
            let mean_square = signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64;
            prop_assert!((whole.lags[0] - mean_square).abs() <= 1e-12 * mean_square);
            let of_spectrum = fourier::of_power(&whole.power, whole.transform_length)[0];
            let of_spectrum = of_spectrum / (whole.transform_length * signal.len()) as f64;
            prop_assert!((of_spectrum - mean_square).abs() <= 1e-9 * mean_square);
        }
    }
}
