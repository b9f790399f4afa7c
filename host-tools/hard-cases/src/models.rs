//! Models that are hard on a filter's arithmetic.

use std::borrow::ToOwned;
use std::f64::consts::{PI, TAU};
use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use model_format::{SAMPLE_RATE_HZ, limits};
use stylus_dsp::fourier;
use stylus_dsp::linear_prediction::{self, Prediction};

const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// A model by its reflection coefficients, with a name.
#[derive(Clone, Debug)]
pub struct NamedModel {
    /// Name in tables.
    pub name: String,
    /// Reflection coefficients, the first stage first.
    pub reflection: Vec<f64>,
    /// Largest magnitude of the model's poles, or a bound of it.
    pub pole_radius: f64,
}

impl NamedModel {
    /// The predictor, h₁ first: h = -a.
    pub fn predictor(&self) -> Vec<f64> {
        let a = linear_prediction::step_up(&self.reflection);
        a.iter().map(|a| -a).collect()
    }

    /// Power of the prediction error for an output power of 1.
    pub fn error_share(&self) -> f64 {
        linear_prediction::error_share(&self.reflection)
    }
}

/// The six models of order 400 of `tests/fixtures`, made from the formulas that are given there.
pub fn fixtures() -> Vec<NamedModel> {
    let damped = |first_hz: f64, second_hz: f64| {
        let line = |radius: f64, hz: f64, lag: usize| radius.powi(lag as i32) * (TAU * hz * lag as f64 / RATE_HZ).cos();
        let lag = |lag| line(0.995, first_hz, lag) + 0.5 * line(0.99, second_hz, lag);
        let mut lags: Vec<f64> = (0..=limits::MAX_ORDER).map(lag).collect();
        lags[0] += 1e-4;
        lags
    };
    [
        ("H1a", damped(60.0, 180.0)),
        ("H1b", damped(240.0, 720.0)),
        ("H2a", low_pass(100.0, 8, 1e-6)),
        ("H2b", low_pass(800.0, 8, 1e-6)),
        ("H3", low_pass(200.0, 8, 1e-8)),
        ("H4", low_pass(200.0, 16, 1e-10)),
    ]
    .into_iter()
    .map(|(name, lags)| NamedModel {
        name: name.to_owned(),
        reflection: Prediction::levinson_durbin(&lags, limits::MAX_ORDER).reflection,
        // The larger radius of H1's two lines. The poles of the other models are below it.
        pole_radius: 0.995,
    })
    .collect()
}

/// Autocorrelation of noise with the spectrum 1 / (1 + (f/cut-off)^`order`) over a floor, on a grid of 32 768
/// frequencies.
fn low_pass(cut_off_hz: f64, order: i32, floor: f64) -> Vec<f64> {
    const POINTS: usize = 32_768;
    let power = |bin: usize| {
        let frequency_hz = bin as f64 * RATE_HZ / POINTS as f64;
        1.0 / (1.0 + (frequency_hz / cut_off_hz).powi(order)) + floor
    };
    let power: Vec<f64> = (0..=POINTS / 2).map(power).collect();
    let mut lags = fourier::of_power(&power, POINTS);
    lags.truncate(limits::MAX_ORDER + 1);
    let total = lags[0];
    lags.iter().map(|lag| lag / total).collect()
}

/// A model of one pair of poles of this radius.
pub fn resonance(radius: f64, frequency_hz: f64) -> NamedModel {
    // The step-down recursion of the polynomial 1 - 2r cos ω z⁻¹ + r² z⁻².
    let k2 = radius * radius;
    let k1 = -2.0 * radius * (TAU * frequency_hz / RATE_HZ).cos() / (1.0 + k2);
    NamedModel {
        name: format!("r {radius}, {frequency_hz} Hz"),
        reflection: vec![k1, k2],
        pole_radius: radius,
    }
}

/// Resonances of low and high frequency, from a damped one to a pole radius of 0.99999.
pub fn resonances() -> Vec<NamedModel> {
    [0.99, 0.999, 0.9999, 0.999_99]
        .into_iter()
        .flat_map(|radius| [resonance(radius, 100.0), resonance(radius, 1230.0)])
        .collect()
}

/// A model of this order whose reflection coefficients fall as 1/m, with changing signs.
pub fn falling(order: usize) -> NamedModel {
    let k = |stage: usize| 0.9 * (PI * stage as f64 * 0.7).cos() / stage as f64;
    NamedModel {
        name: format!("order {order}"),
        reflection: (1..=order).map(k).collect(),
        pole_radius: 0.995,
    }
}
