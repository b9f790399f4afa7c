//! Tests of the order of a node's model: what it preserves, and which coefficients it saves.

use std::f64::consts::TAU;

use model_format::SAMPLE_RATE_HZ;
use proptest::prelude::*;
use stylus_dsp::autocorrelation::PaddedSpectrum;
use stylus_dsp::log_spectrum::{FINE_BINS, density_of_model};
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::band_edges_hz;
use stylus_dsp::sums::rms;
use stylus_signals::recording::resample;
use test_helpers::{noise, resonant};

use super::estimate::{Bands, KnownBand, estimate};
use super::grid::model_of;
use super::options::Order;

const MAX_ORDER: usize = model_format::limits::MAX_ORDER;

/// Makes noise that is filtered by resonances at these frequencies, Hz, with these pole radii.
fn textured(seed: u64, samples: usize, resonances: &[(f64, f64)]) -> Vec<f64> {
    const SETTLED: usize = 5000;
    let mut signal = noise(seed, samples + SETTLED);
    for &(hz, radius) in resonances {
        signal = resonant(signal, TAU * hz / f64::from(SAMPLE_RATE_HZ), radius);
    }
    signal.split_off(SETTLED)
}

/// Coefficients of a pole pair for its own last two outputs.
fn feedback(hz: f64, radius: f64) -> (f64, f64) {
    let angle = TAU * hz / f64::from(SAMPLE_RATE_HZ);
    (2.0 * radius * angle.cos(), radius * radius)
}

/// Density of the process behind [`textured`], computed independently of any fit.
fn density(resonances: &[(f64, f64)]) -> Vec<f64> {
    let bin = |bin: usize| {
        let angle = TAU * bin as f64 / (2 * (FINE_BINS - 1)) as f64;
        resonances
            .iter()
            .map(|&(hz, radius)| {
                let (a, b) = feedback(hz, radius);
                let real = 1.0 - a * angle.cos() + b * (2.0 * angle).cos();
                let imaginary = a * angle.sin() - b * (2.0 * angle).sin();
                1.0 / (real * real + imaginary * imaginary)
            })
            .product()
    };
    (0..FINE_BINS).map(bin).collect()
}

/// Returns the model of a recording at 5 kHz whose source is at `source_rate_hz`, and its bands.
fn fitted(signal: &[f64], source_rate_hz: u32, order: Order) -> (Model, Bands) {
    let plain = PaddedSpectrum::of(signal, MAX_ORDER);
    let known = KnownBand::of(f64::from(source_rate_hz), SAMPLE_RATE_HZ, None);
    let estimate = estimate(SAMPLE_RATE_HZ, signal, plain, known);
    let model = model_of(estimate.lags, &estimate.bands, signal.len(), order);
    (model, estimate.bands)
}

/// Returns a recording of `signal` at `rate_hz`, converted to 5 kHz.
fn recorded_at(rate_hz: u32, signal: Vec<f64>) -> Vec<f64> {
    let recorded = resample(&[signal], SAMPLE_RATE_HZ, rate_hz);
    resample(&recorded, rate_hz, SAMPLE_RATE_HZ).remove(0)
}

/// RMS of the level errors of `model` against `resonances`, dB, without their mean, in the third octaves from 20 Hz to
/// `to_hz` that are within 40 dB of the strongest.
fn off_db(model: &Model, resonances: &[(f64, f64)], to_hz: f64) -> f64 {
    let (found, truth) = (density_of_model(model, FINE_BINS), density(resonances));
    let step_hz = f64::from(SAMPLE_RATE_HZ) / (2 * (FINE_BINS - 1)) as f64;
    let powers = (0..)
        .map(band_edges_hz)
        .take_while(|&(_, high)| high <= to_hz)
        .map(|(low, high)| {
            let bins = (low / step_hz) as usize..(high / step_hz) as usize;
            [&found, &truth].map(|density| density[bins.clone()].iter().sum::<f64>())
        });
    let powers: Vec<[f64; 2]> = powers.collect();
    let strongest = powers.iter().map(|[_, truth]| *truth).fold(0.0, f64::max);
    let levels: Vec<f64> = powers
        .iter()
        .filter(|[_, truth]| *truth > 1e-4 * strongest)
        .map(|[found, truth]| 10.0 * (found / truth).log10())
        .collect();
    let mean = levels.iter().sum::<f64>() / levels.len() as f64;
    let squares = levels.iter().map(|level| (level - mean).powi(2));
    (squares.sum::<f64>() / levels.len() as f64).sqrt()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// Eight seconds of two resonances: the band that is not recorded costs few coefficients. To model the filter that
    /// removed it would cost a hundred and more.
    #[test]
    fn two_resonances_take_few_coefficients_at_any_rate(
        seed: u64, low_hz in 100.0f64..250.0, high_hz in 280.0f64..400.0, rate_hz in 1000u32..5000,
    ) {
        let truth = [(low_hz, 0.97), (high_hz, 0.95)];
        let signal = textured(seed, 40_000, &truth);
        for (rate_hz, signal) in [(SAMPLE_RATE_HZ, signal.clone()), (rate_hz, recorded_at(rate_hz, signal))] {
            let (model, _) = fitted(&signal, rate_hz, Order::Auto);
            let order = model.reflection.len();
            prop_assert!((2..80).contains(&order), "{rate_hz} Hz: {order}");
            let off_db = off_db(&model, &truth, 0.45 * f64::from(rate_hz));
            prop_assert!(off_db < 0.5, "{rate_hz} Hz: {off_db} dB");
        }
    }

    /// A peak that stands 18 dB out of its third octave and has no more than a tenth of the power.
    #[test]
    fn a_narrow_peak_at_twenty_hertz_is_held(seed: u64) {
        // A short filter does not preserve the bands next to such a peak.
        const LIMIT_DB: f64 = 6.0;
        let peak = textured(seed, 40_000, &[(20.0, 0.9995)]);
        let rms = rms(&peak);
        let floor = noise(!seed, peak.len());
        let signal: Vec<f64> = peak.iter().zip(floor).map(|(x, floor)| x / rms + 3.0 * floor).collect();
        let (model, bands) = fitted(&signal, SAMPLE_RATE_HZ, Order::Auto);
        prop_assert_eq!(bands.missed_by(&model, signal.len(), LIMIT_DB), None);
        let (lower, _) = fitted(&signal, SAMPLE_RATE_HZ, Order::Fixed(8));
        prop_assert!(bands.missed_by(&lower, signal.len(), LIMIT_DB).is_some(), "an easy peak tells nothing");
    }

    /// Noise, a tone and a resonance anywhere around the edge of the recorded band.
    #[test]
    fn what_is_not_recorded_adds_little_power(
        seed: u64, rate_hz in 1000u32..4000, edge in 0.3f64..0.5, amplitude in 0.0f64..20.0, radius in 0.0f64..0.999,
    ) {
        let hz = edge * f64::from(rate_hz);
        let tone = |n: usize| amplitude * (TAU * hz * n as f64 / f64::from(SAMPLE_RATE_HZ)).sin();
        let mut signal = textured(seed, 20_000, &[(hz, radius)]);
        signal.iter_mut().enumerate().for_each(|(n, x)| *x += tone(n));
        let signal = recorded_at(rate_hz, signal);
        let (model, _) = fitted(&signal, rate_hz, Order::Auto);
        let ratio = model.output_power.sqrt() / rms(&signal);
        prop_assert!((0.98..1.04).contains(&ratio), "{ratio}");
    }
}
