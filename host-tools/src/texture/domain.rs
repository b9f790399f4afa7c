//! Domains in which models can be interpolated, and a model predicted in each from its neighbours.

use model_format::{LevelLaw, NodeFlags};
use serde::{Serialize, Serializer};

use crate::dsp::line_spectral_frequencies as line_spectrum;
use crate::dsp::linear_prediction::{Prediction, corrected, error_share, step_down, step_up};
use crate::dsp::log_spectrum::{FINE_BINS, LogSpectrum};
use crate::dsp::model::Model;

/// The representation of a model's shape that is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Predictor coefficients h, as in the paper. A mean of stable models need not be stable.
    Predictor,
    /// Reflection coefficients k.
    Reflection,
    /// θ = arcsin k, as the device does.
    Angle,
    /// Log-area ratios ln (1 + k)/(1 - k).
    LogAreaRatio,
    /// Line spectral frequencies.
    LineSpectrum,
    /// Autocorrelation coefficients.
    Autocorrelation,
    /// The cepstrum, the paper's own open question. It is a linear transform of the log-spectrum, so that its mean is
    /// that of the log-spectra at equal frequencies; the mean is refitted.
    Cepstrum,
    /// The log-spectrum at equal spatial frequencies f/v, refitted.
    WarpedLogSpectrum,
}

/// The representation of the level that is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// By the excitation's variance σ², as in the paper: the output's power is what the mean filter makes of it.
    Excitation,
    /// By the output's power.
    Power,
    /// By the output's RMS.
    Amplitude,
    /// By the output's power in dB.
    LogPower,
}

/// A way to predict a model from its neighbours: what a row of the table of domains stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Of the shape.
    pub domain: Domain,
    /// Of the level.
    pub level: Level,
}

impl Method {
    /// The paper's: h and σ², played in the direct form.
    pub const PAPER: Self = Self::new(Domain::Predictor, Level::Excitation);

    /// The device's own method for grids as `fit` makes them.
    pub const DEVICE: Self = Self::of_device(LevelLaw::Logarithm);

    /// Every method, the paper's first.
    pub const ALL: [Self; 18] = [
        Self::PAPER,
        Self::new(Domain::Predictor, Level::Power),
        Self::new(Domain::Predictor, Level::LogPower),
        Self::new(Domain::Reflection, Level::Power),
        Self::new(Domain::Reflection, Level::LogPower),
        Self::of_device(LevelLaw::Power),
        Self::of_device(LevelLaw::Amplitude),
        Self::of_device(LevelLaw::Logarithm),
        Self::new(Domain::LogAreaRatio, Level::Power),
        Self::new(Domain::LogAreaRatio, Level::LogPower),
        Self::new(Domain::LineSpectrum, Level::Power),
        Self::new(Domain::LineSpectrum, Level::LogPower),
        Self::new(Domain::Autocorrelation, Level::Power),
        Self::new(Domain::Autocorrelation, Level::LogPower),
        Self::new(Domain::Cepstrum, Level::Power),
        Self::new(Domain::Cepstrum, Level::LogPower),
        Self::new(Domain::WarpedLogSpectrum, Level::Power),
        Self::new(Domain::WarpedLogSpectrum, Level::LogPower),
    ];

    /// The device's own method for a lattice with this law: θ, and the level by the law.
    pub const fn of_device(law: LevelLaw) -> Self {
        let level = match law {
            LevelLaw::Power => Level::Power,
            LevelLaw::Amplitude => Level::Amplitude,
            LevelLaw::Logarithm => Level::LogPower,
        };
        Self::new(Domain::Angle, level)
    }

    const fn new(domain: Domain, level: Level) -> Self {
        Self { domain, level }
    }

    /// A name for tables.
    pub fn name(self) -> String {
        let domain = match self.domain {
            Domain::Predictor => "h",
            Domain::Reflection => "k",
            Domain::Angle => "θ = arcsin k",
            Domain::LogAreaRatio => "log-area ratios",
            Domain::LineSpectrum => "line spectral frequencies",
            Domain::Autocorrelation => "autocorrelation",
            Domain::Cepstrum => "cepstrum",
            Domain::WarpedLogSpectrum => "log-spectrum over f/v",
        };
        let level = match self.level {
            Level::Excitation => "σ²",
            Level::Power => "power",
            Level::Amplitude => "amplitude",
            Level::LogPower => "log power",
        };
        let role = match self {
            Self::PAPER => " (the paper)",
            Self::DEVICE => " (the device)",
            _ => "",
        };
        format!("{domain}, {level}{role}")
    }

    /// The model at a speed, mm/s, from its `neighbours`, at least one and none silent; `None` where the mean is not
    /// stable.
    pub fn predict(self, neighbours: &[Neighbour<'_>], speed_mm_s: f64) -> Option<Model> {
        let reflection = self.domain.shape(neighbours, speed_mm_s)?;
        Some(Model {
            output_power: self.level.power(neighbours, &reflection),
            reflection,
            flags: NodeFlags::NONE,
        })
    }
}

impl Level {
    /// The output's power, (m/s²)², of a filter that stands for `neighbours`.
    pub fn power(self, neighbours: &[Neighbour<'_>], reflection: &[f64]) -> f64 {
        let mean = |of: &dyn Fn(&Model) -> f64| -> f64 {
            neighbours.iter().map(|n| n.weight * of(n.model)).sum()
        };
        match self {
            Self::Excitation => {
                let excitation = |m: &Model| m.output_power * error_share(&m.reflection);
                mean(&excitation) / error_share(reflection)
            }
            Self::Power => mean(&|m| m.output_power),
            Self::Amplitude => mean(&|m| m.output_power.sqrt()).powi(2),
            Self::LogPower => mean(&|m| m.output_power.ln()).exp(),
        }
    }
}

impl Domain {
    /// The reflection coefficients at a speed, mm/s, from those of `neighbours`; `None` where the mean is not stable.
    pub fn shape(self, neighbours: &[Neighbour<'_>], speed_mm_s: f64) -> Option<Vec<f64>> {
        let order = neighbours
            .iter()
            .map(|n| n.model.reflection.len())
            .max()
            .unwrap_or(0);
        let mean = |of: &dyn Fn(&[f64]) -> Vec<f64>| {
            let terms = neighbours
                .iter()
                .map(|n| (n.weight, of(&n.model.reflection)));
            weighted_mean(order, terms)
        };
        let each = |of: fn(f64) -> f64| mean(&move |k: &[f64]| k.iter().map(|&k| of(k)).collect());
        let back = |values: Vec<f64>, of: fn(f64) -> f64| values.into_iter().map(of).collect();
        Some(match self {
            Self::Predictor => return step_down(&mean(&step_up)),
            Self::Reflection => each(|k| k),
            Self::Angle => back(each(f64::asin), f64::sin),
            // The ratio's logarithm is twice the inverse of tanh.
            Self::LogAreaRatio => back(each(f64::atanh), f64::tanh),
            Self::LineSpectrum => {
                // All of one order: further stages of k = 0 change nothing but the number of lines.
                let lines = mean(&|k: &[f64]| {
                    let mut k = k.to_vec();
                    k.resize(order, 0.0);
                    line_spectrum::frequencies(&k)
                });
                refitted(&line_spectrum::log_spectrum(&lines, FINE_BINS), order)
            }
            Self::Autocorrelation => {
                let terms = neighbours
                    .iter()
                    .map(|n| (n.weight, autocorrelation(&n.model.reflection, order)));
                let lags = weighted_mean(order + 1, terms);
                Prediction::levinson_durbin(&corrected(lags), order).reflection
            }
            Self::Cepstrum | Self::WarpedLogSpectrum => {
                let spectra: Vec<(f64, LogSpectrum)> = neighbours
                    .iter()
                    .map(|n| {
                        let own = LogSpectrum::of_model_at(&at_unit_power(n.model), FINE_BINS);
                        let there = if self == Self::Cepstrum {
                            own
                        } else {
                            own.warped(n.speed_mm_s, speed_mm_s)
                        };
                        (n.weight, there)
                    })
                    .collect();
                let terms: Vec<_> = spectra.iter().map(|(weight, s)| (*weight, s)).collect();
                refitted(&LogSpectrum::mean(&terms), order)
            }
        })
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.name())
    }
}

/// A node beside the one that is predicted.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// Its weight; those of all neighbours add up to one.
    pub weight: f64,
    /// Its tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Its model, which is not silent.
    pub model: &'a Model,
}

/// The mean of vectors, shorter ones continued with zeros.
fn weighted_mean(length: usize, terms: impl Iterator<Item = (f64, Vec<f64>)>) -> Vec<f64> {
    let mut sum = vec![0.0; length];
    for (weight, values) in terms {
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum += weight * value;
        }
    }
    sum
}

fn refitted(spectrum: &LogSpectrum, order: usize) -> Vec<f64> {
    spectrum.prediction(order).reflection
}

fn at_unit_power(model: &Model) -> Model {
    Model {
        output_power: 1.0,
        ..model.clone()
    }
}

/// Autocorrelation coefficients from lag 0 (which is 1) to `max_lag`: Levinson's recursion, run backwards.
fn autocorrelation(reflection: &[f64], max_lag: usize) -> Vec<f64> {
    let mut lags = vec![1.0];
    let mut predictor: Vec<f64> = Vec::new();
    let mut error = 1.0;
    for m in 0..max_lag {
        let k = reflection.get(m).copied().unwrap_or(0.0);
        let known: f64 = predictor
            .iter()
            .zip(lags.iter().rev())
            .map(|(a, r)| a * r)
            .sum();
        lags.push(-(k * error + known));
        let reversed: Vec<f64> = predictor.iter().rev().copied().collect();
        for (a, b) in predictor.iter_mut().zip(reversed) {
            *a += k * b;
        }
        predictor.push(k);
        error *= (1.0 - k) * (1.0 + k);
    }
    lags
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn model(reflection: Vec<f64>, output_power: f64) -> Model {
        Model {
            reflection,
            output_power,
            flags: NodeFlags::NONE,
        }
    }

    fn predict(method: Method, models: &[Model]) -> Option<Model> {
        let neighbours: Vec<_> = models
            .iter()
            .map(|model| Neighbour {
                weight: 1.0 / models.len() as f64,
                speed_mm_s: 100.0,
                model,
            })
            .collect();
        method.predict(&neighbours, 100.0)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn between_equal_neighbours_every_method_gives_them_back(
            reflection in prop::collection::vec(-0.4f64..0.4, 1..10), power in 0.01f64..10.0,
        ) {
            let same = model(reflection, power);
            for method in Method::ALL {
                let mean = predict(method, &[same.clone(), same.clone()]).unwrap();
                prop_assert!((mean.output_power / power - 1.0).abs() < 1e-9, "{}", method.name());
                for (a, b) in mean.reflection.iter().zip(&same.reflection) {
                    prop_assert!((a - b).abs() < 1e-4, "{}", method.name());
                }
            }
        }

        #[test]
        fn every_mean_but_that_of_predictors_is_stable(
            a in prop::collection::vec(-0.95f64..0.95, 1..24), b in prop::collection::vec(-0.95f64..0.95, 1..24),
        ) {
            let models = [model(a, 1.0), model(b, 4.0)];
            for method in Method::ALL {
                let mean = predict(method, &models);
                if let Some(mean) = mean {
                    prop_assert!(mean.reflection.iter().all(|k| k.abs() < 1.0));
                    match method.level {
                        Level::Power => prop_assert!((mean.output_power - 2.5).abs() < 1e-9),
                        Level::Amplitude => prop_assert!((mean.output_power - 2.25).abs() < 1e-9),
                        Level::LogPower => prop_assert!((mean.output_power - 2.0).abs() < 1e-9),
                        Level::Excitation => {}
                    }
                } else {
                    prop_assert_eq!(method.domain, Domain::Predictor);
                }
            }
        }

        #[test]
        fn autocorrelations_give_their_model_back(reflection in prop::collection::vec(-0.9f64..0.9, 1..20)) {
            let lags = autocorrelation(&reflection, reflection.len());
            let back = Prediction::levinson_durbin(&lags, reflection.len()).reflection;
            for (a, b) in reflection.iter().zip(back) {
                prop_assert!((a - b).abs() < 1e-6);
            }
        }
    }

    /// Domains that go by a spectrum hold what a recording of 2 s tells.
    #[test]
    fn a_recordings_model_of_order_400_comes_back_from_every_domain() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let generator = rand_pcg::Pcg64::seed_from_u64(3);
        let noise: Vec<f64> = StandardNormal.sample_iter(generator).take(10_000).collect();
        let mut signal = vec![0.0; noise.len()];
        for n in 2..noise.len() {
            let line = 3.0 * (0.15 * n as f64 + 0.3 * (0.01 * n as f64).sin()).sin();
            signal[n] = noise[n] + line + 1.7 * signal[n - 1] - 0.9 * signal[n - 2];
        }
        let lags = crate::dsp::autocorrelation::Autocorrelation::of(&signal, 400).lags;
        let power = lags[0];
        let own = model(
            Prediction::levinson_durbin(&corrected(lags), 400).reflection,
            power,
        );
        let wanted = LogSpectrum::of_model(&own);
        for method in Method::ALL {
            let back = predict(method, &[own.clone(), own.clone()]).unwrap();
            let cost = wanted.cost(&LogSpectrum::of_model(&back), 20.0);
            assert!(cost < 0.01, "{}: {cost}", method.name());
        }
    }

    /// (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ average to 1 + 2.43 z⁻², whose poles have a radius of 1.5588.
    #[test]
    fn the_mean_of_stable_predictors_that_is_not_stable_is_told() {
        let ends = [[-2.7, 2.43, -0.729], [2.7, 2.43, 0.729]];
        let models = ends.map(|a| model(step_down(&a).unwrap(), 1.0));
        assert!(predict(Method::PAPER, &models).is_none());
        assert!(predict(Method::DEVICE, &models).is_some());
    }

    #[test]
    fn only_the_warped_spectrum_follows_a_line_between_speeds() {
        let line_at = |frequency_hz: f64| {
            let angle = std::f64::consts::TAU * frequency_hz / 5000.0;
            model(
                step_down(&[-2.0 * 0.99 * angle.cos(), 0.99 * 0.99]).unwrap(),
                1.0,
            )
        };
        let (low, high) = (line_at(100.0), line_at(140.0));
        let neighbours = [(100.0, &low), (140.0, &high)].map(|(speed_mm_s, model)| Neighbour {
            weight: 0.5,
            speed_mm_s,
            model,
        });
        let wanted = LogSpectrum::of_model(&line_at(120.0));
        let cost = |domain| {
            let method = Method {
                domain,
                level: Level::Power,
            };
            let mean = method.predict(&neighbours, 120.0).unwrap();
            wanted.cost(&LogSpectrum::of_model(&mean), 20.0)
        };
        assert!(cost(Domain::WarpedLogSpectrum) < 0.5 * cost(Domain::Cepstrum));
    }
}
