//! Logarithms of power spectra: estimated from recordings with little leakage, taken from models, warped from one speed
//! to another, and turned back into models.
//!
//! Values stand evenly from 0 Hz to half the models' rate: natural logarithms of the two-sided density times the sample
//! rate, so that their exponentials' mean over all frequencies is the power. Those of recordings are [`BINS`] values,
//! [`STEP_HZ`] apart; those of models may be more, since a model's resonances can be narrower than any that a recording
//! tells.

use std::f64::consts::PI;

use model_format::{NodeFlags, limits};
use realfft::num_complex::Complex;

use crate::dsp::MODEL_RATE_HZ;
use crate::dsp::linear_prediction::{Prediction, corrected, error_share, step_up};
use crate::dsp::model::Model;
use crate::dsp::with_planner;

/// Length of the transforms behind a spectrum, samples: 2 s.
const LENGTH: usize = 10_000;

/// Frequencies of a spectrum, from 0 Hz to half the models' rate.
pub const BINS: usize = LENGTH / 2 + 1;

/// Frequencies that hold the resonances of models of any order fitted to 2 s: 0.06 Hz apart.
pub const FINE_BINS: usize = 4 * LENGTH + 1;

/// From one frequency to the next of [`BINS`], Hz.
pub const STEP_HZ: f64 = MODEL_RATE_HZ as f64 / LENGTH as f64;

/// Sine tapers of an estimate: a bandwidth of 4 Hz for 2 s, and leakage that falls with the fourth power of the
/// distance (Riedel and Sidorenko, IEEE Trans. Signal Processing 43, 1995, 188).
const TAPERS: usize = 7;

/// The least density, as a share of the power, whose logarithm is taken: 120 dB below.
const FLOOR: f64 = 1e-12;

/// The logarithm of a power spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSpectrum(Vec<f64>);

impl LogSpectrum {
    /// The spectrum of `signals`, taken together, each weighed by its length: pieces of 2 s (or one shorter), each the
    /// mean of seven periodograms with sine tapers. `None` if they have no power.
    ///
    /// What the logarithm of a mean of few periodograms lacks on average (ln n - ψ(n) for n of them) is added, so that
    /// means of logarithms have the level of the signal.
    pub fn estimate(signals: &[&[f64]]) -> Option<Self> {
        let mut density = vec![0.0; BINS];
        let (mut weight, mut periodograms) = (0.0, 0);
        for piece in signals.iter().flat_map(|signal| pieces(signal)) {
            for taper in 1..=TAPERS {
                add_periodogram(piece, taper, &mut density);
            }
            weight += piece.len() as f64;
            periodograms += TAPERS;
        }
        let power = density.iter().sum::<f64>() / (weight * BINS as f64);
        if !(power.is_finite() && power > 0.0) {
            return None;
        }
        let bias = (periodograms as f64).ln() - digamma(periodograms);
        let log = |sum: &f64| (sum / weight).max(FLOOR * power).ln() + bias;
        Some(Self(density.iter().map(log).collect()))
    }

    /// The spectrum of what `model` puts out, which is not silent, at [`BINS`] frequencies.
    pub fn of_model(model: &Model) -> Self {
        Self::of_model_at(model, BINS)
    }

    /// The spectrum of what `model` puts out, which is not silent, at `bins` frequencies, more than the model's order.
    pub fn of_model_at(model: &Model, bins: usize) -> Self {
        let length = 2 * (bins - 1);
        let mut response = vec![0.0; length];
        response[0] = 1.0;
        for (to, a) in response[1..].iter_mut().zip(step_up(&model.reflection)) {
            *to = a;
        }
        let transform = with_planner(|planner| planner.plan_fft_forward(length));
        let mut spectrum = transform.make_output_vec();
        transform
            .process(&mut response, &mut spectrum)
            .expect("lengths come from the plan");
        let error_power = (model.output_power * error_share(&model.reflection)).ln();
        let log = |bin: &Complex<f64>| error_power - bin.norm_sqr().max(f64::MIN_POSITIVE).ln();
        Self(spectrum.iter().map(log).collect())
    }

    /// A spectrum from its values, evenly from 0 Hz to half the rate.
    ///
    /// # Panics
    /// If there are fewer than two.
    pub fn from_values(values: Vec<f64>) -> Self {
        assert!(values.len() > 1, "a spectrum has two ends");
        Self(values)
    }

    /// Its values.
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// The power, (signal's unit)².
    pub fn power(&self) -> f64 {
        let last = self.0.len() - 1;
        let inner: f64 = self.0[1..last].iter().map(|l| l.exp()).sum();
        (self.0[0].exp() + 2.0 * inner + self.0[last].exp()) / (2 * last) as f64
    }

    /// The spectrum of the same surface at another speed, if all of it came from the surface: what stood at f now stands
    /// at f · `to_speed` / `from_speed`. Beyond half the rate the last value goes on.
    #[must_use]
    pub fn warped(&self, from_speed: f64, to_speed: f64) -> Self {
        let ratio = from_speed / to_speed;
        Self(
            (0..self.0.len())
                .map(|bin| self.at(bin as f64 * ratio))
                .collect(),
        )
    }

    /// The value at a place between bins, in bins; the ends go on.
    pub(crate) fn at(&self, place: f64) -> f64 {
        let place = place.clamp(0.0, (self.0.len() - 1) as f64);
        let below = (place as usize).min(self.0.len() - 2);
        let fraction = place - below as f64;
        self.0[below] + (self.0[below + 1] - self.0[below]) * fraction
    }

    /// The weighted mean of logarithms of one number of frequencies; weights add up to one.
    pub fn mean(terms: &[(f64, &Self)]) -> Self {
        let mut sum = vec![0.0; terms.first().map_or(BINS, |(_, spectrum)| spectrum.0.len())];
        for (weight, spectrum) in terms {
            for (sum, value) in sum.iter_mut().zip(&spectrum.0) {
                *sum += weight * value;
            }
        }
        Self(sum)
    }

    /// The autocorrelation from lag 0 to `max_lag`.
    pub fn autocorrelation(&self, max_lag: usize) -> Vec<f64> {
        let length = 2 * (self.0.len() - 1);
        let transform = with_planner(|planner| planner.plan_fft_inverse(length));
        let mut spectrum: Vec<_> = self.0.iter().map(|l| Complex::new(l.exp(), 0.0)).collect();
        let mut lags = transform.make_output_vec();
        transform
            .process(&mut spectrum, &mut lags)
            .expect("lengths come from the plan");
        lags.truncate(max_lag + 1);
        lags.iter_mut().for_each(|lag| *lag /= length as f64);
        lags
    }

    /// The linear predictor of this spectrum, of every order up to `max_order`.
    pub fn prediction(&self, max_order: usize) -> Prediction {
        Prediction::levinson_durbin(&corrected(self.autocorrelation(max_order)), max_order)
    }

    /// The model of order `order` with this spectrum, and its power.
    pub fn model(&self, order: usize) -> Model {
        Model {
            reflection: self.prediction(order).reflection,
            output_power: self.power(),
            flags: NodeFlags::NONE,
        }
    }

    /// The model of the least order that is as near to this spectrum as another would be to the ear of the skin: every
    /// third octave from 20 to 1000 Hz within `tolerance_db`, and the [cost](Self::cost) within 5 %. Of the highest order
    /// where none is.
    pub fn economical_model(&self, tolerance_db: f64) -> Model {
        const ORDERS: [usize; 11] = [15, 25, 40, 60, 80, 110, 150, 200, 260, 330, 400];
        const COST: f64 = 0.05;
        let full = self.model(limits::MAX_ORDER);
        for order in ORDERS {
            let model = Model {
                reflection: full.reflection[..order.min(full.reflection.len())].to_vec(),
                ..full.clone()
            };
            let there = Self::of_model(&model);
            let near = |error: &Option<f64>| error.is_none_or(|e| e.abs() <= tolerance_db);
            if self.band_errors_db(&there).iter().all(near) && self.cost(&there, 20.0) <= COST {
                return model;
            }
        }
        full
    }

    /// Level of `other` over this in each third-octave band, dB. Both are of [`BINS`] frequencies.
    pub fn band_errors_db(&self, other: &Self) -> [Option<f64>; crate::dsp::spectrum::BAND_COUNT] {
        std::array::from_fn(|band| {
            let (low, high) = crate::dsp::spectrum::band_edges_hz(band);
            let ratio = other.power_between(low, high) / self.power_between(low, high);
            Some(10.0 * ratio.log10()).filter(|level| level.is_finite())
        })
    }

    /// Power between two frequencies, of one side of the spectrum, with fractional bins at both ends.
    fn power_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let (low, high) = (low_hz / STEP_HZ, high_hz / STEP_HZ);
        let first = low.round().max(0.0) as usize;
        let last = (high.round() as usize).min(BINS - 1);
        (first..=last)
            .map(|bin| {
                let share = (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
                self.0[bin].exp() * share.max(0.0)
            })
            .sum()
    }

    /// The paper's cost C, equation (6), of a signal with the spectrum `other` against one with this, were the scatter
    /// of both smoothed away: amplitudes averaged over a running window `width_hz` wide. Both are of [`BINS`] frequencies.
    pub fn cost(&self, other: &Self, width_hz: f64) -> f64 {
        let (here, there) = (
            self.smoothed_amplitude(width_hz),
            other.smoothed_amplitude(width_hz),
        );
        let difference: f64 = here.iter().zip(&there).map(|(a, b)| (a - b).powi(2)).sum();
        let energy: f64 = here.iter().map(|a| a * a).sum();
        (difference / energy).sqrt()
    }

    fn smoothed_amplitude(&self, width_hz: f64) -> Vec<f64> {
        let half = (0.5 * width_hz / STEP_HZ) as usize;
        let mut sums = vec![0.0; BINS + 1];
        for (bin, value) in self.0.iter().enumerate() {
            sums[bin + 1] = sums[bin] + (0.5 * value).exp();
        }
        (0..BINS)
            .map(|bin| {
                let (first, end) = (bin.saturating_sub(half), (bin + half + 1).min(BINS));
                (sums[end] - sums[first]) / (end - first) as f64
            })
            .collect()
    }
}

/// `signal` in pieces of at most [`LENGTH`]: as few of equal length as hold it all.
fn pieces(signal: &[f64]) -> impl Iterator<Item = &[f64]> {
    let count = signal.len().div_ceil(LENGTH).max(1);
    signal.chunks(signal.len().div_ceil(count).max(1))
}

/// Adds to `density` the periodogram of `piece` under sine taper `taper` (from 1), times the piece's length.
fn add_periodogram(piece: &[f64], taper: usize, density: &mut [f64]) {
    let step = PI * taper as f64 / (piece.len() + 1) as f64;
    let scale = (2.0 / (piece.len() + 1) as f64).sqrt();
    let mut tapered = vec![0.0; LENGTH];
    for (n, (to, value)) in tapered.iter_mut().zip(piece).enumerate() {
        *to = scale * (step * (n + 1) as f64).sin() * value;
    }
    let transform = with_planner(|planner| planner.plan_fft_forward(LENGTH));
    let mut spectrum = transform.make_output_vec();
    transform
        .process(&mut tapered, &mut spectrum)
        .expect("lengths come from the plan");
    // Tapers have unit energy; the mean over tapers is taken here, that over pieces by their length.
    let weight = piece.len() as f64 / TAPERS as f64;
    for (sum, bin) in density.iter_mut().zip(&spectrum) {
        *sum += weight * bin.norm_sqr();
    }
}

/// The digamma function of a whole number above zero (Abramowitz and Stegun 6.3.2).
fn digamma(n: usize) -> f64 {
    const EULER: f64 = 0.577_215_664_901_532_9;
    (1..n).map(|k| 1.0 / k as f64).sum::<f64>() - EULER
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(len: usize, seed: u64) -> Vec<f64> {
        let generator = rand_pcg::Pcg64::seed_from_u64(seed);
        StandardNormal.sample_iter(generator).take(len).collect()
    }

    fn model(reflection: Vec<f64>, output_power: f64) -> Model {
        Model {
            reflection,
            output_power,
            flags: NodeFlags::NONE,
        }
    }

    proptest! {
        // No larger, since a resonance narrower than the spectrum's step is not held by it.
        #[test]
        fn a_models_spectrum_has_its_power_and_gives_it_back(
            reflection in prop::collection::vec(-0.4f64..0.4, 1..8), power in 0.01f64..100.0,
        ) {
            let original = model(reflection.clone(), power);
            let spectrum = LogSpectrum::of_model_at(&original, FINE_BINS);
            prop_assert!((spectrum.power() / power - 1.0).abs() < 1e-6);
            let back = spectrum.model(reflection.len());
            for (a, b) in reflection.iter().zip(&back.reflection) {
                prop_assert!((a - b).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn the_mean_of_many_estimates_logarithms_is_the_logarithm_of_the_power() {
        let mut sum = 0.0;
        for seed in 0..20 {
            let signal = noise(7000 + 500 * seed as usize, seed);
            let spectrum = LogSpectrum::estimate(&[&signal]).unwrap();
            sum += spectrum.values()[10..4990].iter().sum::<f64>() / 4980.0;
        }
        assert!((sum / 20.0).abs() < 0.02, "{}", sum / 20.0);
    }

    #[test]
    fn estimates_leak_less_than_a_rectangular_window() {
        // A line of half a square metre, 400 Hz from where it is looked for, in next to no noise.
        let line: Vec<f64> = (0..10_000)
            .map(|n| (2.0 * PI * 200.3 * f64::from(n) / 5000.0).sin())
            .collect();
        let spectrum = LogSpectrum::estimate(&[&line]).unwrap();
        let far = spectrum.values()[1200].exp() / spectrum.power();
        assert!(10.0 * far.log10() < -60.0, "{}", 10.0 * far.log10());
        assert!(LogSpectrum::estimate(&[&[0.0; 100]]).is_none());
        assert!(LogSpectrum::estimate(&[]).is_none());
    }

    #[test]
    fn warping_moves_a_line_with_the_speed() {
        let peak = |spectrum: &LogSpectrum| {
            let values = spectrum.values().iter().enumerate();
            values.max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0 as f64 * STEP_HZ
        };
        let line: Vec<f64> = (0..10_000)
            .map(|n| (2.0 * PI * 120.0 * f64::from(n) / 5000.0).sin())
            .collect();
        let spectrum = LogSpectrum::estimate(&[&line]).unwrap();
        assert!((peak(&spectrum.warped(100.0, 150.0)) - 180.0).abs() < 3.0);
        assert_eq!(spectrum.warped(80.0, 80.0), spectrum);
    }

    #[test]
    fn an_economical_model_of_a_model_is_no_larger_than_it_need_be() {
        let spectrum = LogSpectrum::of_model(&model(vec![-0.9, 0.7, -0.2, 0.3], 2.0));
        assert_eq!(spectrum.economical_model(0.5).reflection.len(), 15);
        let flat = spectrum.band_errors_db(&spectrum);
        assert!(flat.iter().all(|error| error.unwrap().abs() < 1e-9));
        assert!(spectrum.cost(&spectrum, 20.0) <= 0.0);
    }
}
