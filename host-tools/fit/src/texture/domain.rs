//! Domains in which models can be interpolated, and the prediction of a model from its neighbours in each domain.

use model_format::LevelLaw;

use crate::dsp::linear_prediction::{error_share, step_down, step_up};
use crate::dsp::model::Model;

/// The representation of a model's shape that is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Predictor coefficients h, as in the paper. A mean of stable models need not be stable.
    Predictor,
    /// θ = arcsin k, like the device.
    Angle,
}

/// The representation of the level that is averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// The excitation's variance σ², as in the paper. The output's power then follows from the averaged filter.
    Excitation,
    /// The output's power.
    Power,
    /// The output's RMS.
    Amplitude,
    /// The output's power in dB.
    LogPower,
}

/// A method to predict a model from its neighbours; each is a row of the table of domains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Domain in which the shape is averaged.
    pub domain: Domain,
    /// Quantity by which the level is averaged.
    pub level: Level,
}

impl Method {
    /// The paper's method: h and σ², played in the direct form.
    pub const PAPER: Self = Self {
        domain: Domain::Predictor,
        level: Level::Excitation,
    };

    /// The device's own method for grids that `fit` makes.
    pub const DEVICE: Self = Self::of_device(LevelLaw::Logarithm);

    /// All methods, the paper's first.
    pub const ALL: [Self; 4] = [
        Self::PAPER,
        Self::of_device(LevelLaw::Power),
        Self::of_device(LevelLaw::Amplitude),
        Self::DEVICE,
    ];

    /// Returns the device's own method for a lattice with this law: θ for the shape, and the law for the level.
    const fn of_device(law: LevelLaw) -> Self {
        let level = match law {
            LevelLaw::Power => Level::Power,
            LevelLaw::Amplitude => Level::Amplitude,
            LevelLaw::Logarithm => Level::LogPower,
        };
        let domain = Domain::Angle;
        Self { domain, level }
    }

    /// Returns a name for tables.
    pub fn name(self) -> String {
        let domain = match self.domain {
            Domain::Predictor => "h",
            Domain::Angle => "θ = arcsin k",
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

    /// Returns the model between `neighbours`, of which there is at least one; `None` if the mean is not stable. With
    /// [`Level::LogPower`] none may be silent, because silence has no logarithm.
    pub fn predict(self, neighbours: &[Neighbour<'_>]) -> Option<Model> {
        let reflection = self.domain.shape(neighbours)?;
        let output_power = self.level.power(neighbours, &reflection);
        Some(Model::new(reflection, output_power))
    }
}

impl Level {
    /// Returns the output's power, (m/s²)², of the filter `reflection` that is predicted from `neighbours`.
    pub fn power(self, neighbours: &[Neighbour<'_>], reflection: &[f64]) -> f64 {
        let mean = |of: &dyn Fn(&Model) -> f64| -> f64 { neighbours.iter().map(|n| n.weight * of(n.model)).sum() };
        match self {
            Self::Excitation => {
                // σ² is the share Π(1 - k²) of the output's power.
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
    /// Returns the reflection coefficients between those of `neighbours`; `None` if the mean is not stable.
    fn shape(self, neighbours: &[Neighbour<'_>]) -> Option<Vec<f64>> {
        match self {
            // A mean of predictors may be unstable, and then has no reflection coefficients.
            Self::Predictor => step_down(&mean(neighbours, step_up)),
            Self::Angle => {
                let angles = mean(neighbours, |k| k.iter().map(|k| k.asin()).collect());
                Some(angles.into_iter().map(f64::sin).collect())
            }
        }
    }
}

/// A node next to the predicted one.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// Weight of the neighbour; the weights of all neighbours add up to one.
    pub weight: f64,
    /// Model of the neighbour.
    pub model: &'a Model,
}

/// Returns the weighted mean of `of` over the neighbours' reflection coefficients. Shorter ones are padded with zeros.
fn mean(neighbours: &[Neighbour<'_>], of: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    let orders = neighbours.iter().map(|n| n.model.reflection.len());
    let mut sum = vec![0.0; orders.max().unwrap_or(0)];
    for neighbour in neighbours {
        for (sum, value) in sum.iter_mut().zip(of(&neighbour.model.reflection)) {
            *sum += neighbour.weight * value;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn predict(method: Method, models: &[Model]) -> Option<Model> {
        let weight = 1.0 / models.len() as f64;
        let neighbours = models.iter().map(|model| Neighbour { weight, model });
        method.predict(&neighbours.collect::<Vec<_>>())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn between_equal_neighbours_every_method_gives_them_back(
            reflection in prop::collection::vec(-0.4f64..0.4, 1..10), power in 0.01f64..10.0,
        ) {
            let same = Model::new(reflection, power);
            for method in Method::ALL {
                let mean = predict(method, &[same.clone(), same.clone()]).unwrap();
                prop_assert!((mean.output_power / power - 1.0).abs() < 1e-9, "{}", method.name());
                for (a, b) in mean.reflection.iter().zip(&same.reflection) {
                    prop_assert!((a - b).abs() < 1e-9, "{}", method.name());
                }
            }
        }

        #[test]
        fn every_mean_but_that_of_predictors_is_stable(
            a in prop::collection::vec(-0.95f64..0.95, 1..24), b in prop::collection::vec(-0.95f64..0.95, 1..24),
        ) {
            let models = [Model::new(a, 1.0), Model::new(b, 4.0)];
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
    }

    /// (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ average to 1 + 2.43 z⁻², whose poles have a radius of 1.5588.
    #[test]
    fn the_mean_of_stable_predictors_that_is_not_stable_is_told() {
        let ends = [[-2.7, 2.43, -0.729], [2.7, 2.43, 0.729]];
        let models = ends.map(|a| Model::new(step_down(&a).unwrap(), 1.0));
        assert!(predict(Method::PAPER, &models).is_none());
        assert!(predict(Method::DEVICE, &models).is_some());
    }
}
