//! Conversions between models and spectra.

use super::LogSpectrum;
use crate::fourier::{self, Complex};
use crate::linear_prediction::{Prediction, corrected, step_up};
use crate::model::Model;

impl LogSpectrum {
    /// Returns the spectrum of the output of `model`, which must not be silent, at `bins` frequencies. Their number
    /// must exceed the model's order.
    pub fn of_model_at(model: &Model, bins: usize) -> Self {
        let error_power = model.error_power().ln();
        let log = |bin: &Complex<f64>| error_power - bin.norm_sqr().max(f64::MIN_POSITIVE).ln();
        Self::from_values(denominator(model, bins).iter().map(log).collect())
    }

    /// Returns the autocorrelation from lag 0 to `max_lag`.
    fn autocorrelation(&self, max_lag: usize) -> Vec<f64> {
        let length = 2 * (self.values().len() - 1);
        let power: Vec<f64> = self.values().iter().map(|log| log.exp()).collect();
        let mut lags = fourier::of_power(&power, length);
        lags.truncate(max_lag + 1);
        lags.iter_mut().for_each(|lag| *lag /= length as f64);
        lags
    }

    /// Returns the model of this spectrum that has the order `order` and the spectrum's power.
    pub fn model(&self, order: usize) -> Model {
        let lags = corrected(self.autocorrelation(order));
        Model::new(Prediction::levinson_durbin(&lags, order).reflection, self.power())
    }
}

/// Returns the two-sided density of the output of `model` times the sample rate, at `bins` frequencies.
/// [`LogSpectrum::of_model_at`] returns its logarithms.
pub fn density_of_model(model: &Model, bins: usize) -> Vec<f64> {
    let error_power = model.error_power();
    let density = |bin: &Complex<f64>| error_power / bin.norm_sqr().max(f64::MIN_POSITIVE);
    denominator(model, bins).iter().map(density).collect()
}

/// A(z) of `model` at `bins` frequencies.
fn denominator(model: &Model, bins: usize) -> Vec<Complex<f64>> {
    let length = 2 * (bins - 1);
    let mut response = vec![0.0; length];
    response[0] = 1.0;
    for (to, a) in response[1..].iter_mut().zip(step_up(&model.reflection)) {
        *to = a;
    }
    fourier::forward(&mut response)
}

#[cfg(test)]
mod tests {
    use super::super::{BINS, FINE_BINS};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // The coefficients are no larger, because the spectrum's step does not resolve a narrower resonance.
        #[test]
        fn a_models_spectrum_has_its_power_and_gives_it_back(
            reflection in prop::collection::vec(-0.4f64..0.4, 1..8), power in 0.01f64..100.0,
        ) {
            let original = Model::new(reflection.clone(), power);
            let spectrum = LogSpectrum::of_model_at(&original, FINE_BINS);
            prop_assert!((spectrum.power() / power - 1.0).abs() < 1e-6);
            let back = spectrum.model(reflection.len());
            for (a, b) in reflection.iter().zip(&back.reflection) {
                prop_assert!((a - b).abs() < 1e-4);
            }
        }
    }

    proptest! {
        #[test]
        fn a_density_has_the_logarithms_of_the_spectrum(
            reflection in prop::collection::vec(-0.9f64..0.9, 0..30), power in 0.01f64..100.0,
        ) {
            let model = Model::new(reflection, power);
            let spectrum = LogSpectrum::of_model_at(&model, BINS);
            let density = density_of_model(&model, BINS);
            prop_assert_eq!(density.len(), spectrum.values().len());
            for (density, log) in density.iter().zip(spectrum.values()) {
                prop_assert!((density.ln() - log).abs() < 1e-12 * log.abs().max(1.0));
            }
        }
    }
}
