//! The model of one node: a linear predictor with its level.

use model_format::{LevelLaw, NodeFlags};

use crate::linear_prediction::error_share;

/// An all-pole model of a node: its reflection coefficients and the power of its output.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Reflection coefficients k(1) to k(order).
    pub reflection: Vec<f64>,
    /// Variance of the signal, (m/s²)².
    pub output_power: f64,
    /// Properties of the node, such as silence or doubt.
    pub flags: NodeFlags,
}

impl Model {
    /// Returns a model that is not silent, without further properties.
    pub fn new(reflection: Vec<f64>, output_power: f64) -> Self {
        Self {
            reflection,
            output_power,
            flags: NodeFlags::NONE,
        }
    }

    /// Returns the model of silence.
    pub fn silent() -> Self {
        Self {
            reflection: Vec::new(),
            output_power: 0.0,
            flags: NodeFlags::SILENT,
        }
    }

    /// Returns true for the model of silence.
    pub fn is_silent(&self) -> bool {
        self.flags.contains(NodeFlags::SILENT)
    }

    /// Returns the power of the prediction error, (m/s²)²: the share Π(1 - k²) of the output's power.
    pub fn error_power(&self) -> f64 {
        self.output_power * error_share(&self.reflection)
    }

    /// Returns the weighted mean of models; the weights add up to one.
    ///
    /// The reflection coefficients are averaged as θ = arcsin k, so that every mixture is stable, and the level is
    /// averaged by `law`. If one of the models is silent, the mean of the power replaces the mean of the logarithm.
    pub fn mean(models: &[(f64, &Self)], law: LevelLaw) -> Self {
        let order = models.iter().map(|(_, model)| model.reflection.len()).max();
        let mut thetas = vec![0.0; order.unwrap_or(0)];
        for (weight, model) in models {
            // The coefficients that a model of lower order lacks are zero.
            for (theta, k) in thetas.iter_mut().zip(&model.reflection) {
                *theta += weight * k.asin();
            }
        }
        let any_silent = models.iter().any(|(_, model)| model.is_silent());
        let mean = |of: fn(f64) -> f64| -> f64 { models.iter().map(|(w, model)| w * of(model.output_power)).sum() };
        let output_power = match law {
            LevelLaw::Logarithm if !any_silent => mean(f64::ln).exp(),
            LevelLaw::Power | LevelLaw::Logarithm => mean(|p| p),
            LevelLaw::Amplitude => mean(f64::sqrt).powi(2),
        };
        let flags = if output_power > 0.0 {
            NodeFlags::NONE
        } else {
            NodeFlags::SILENT
        };
        Self {
            reflection: thetas.into_iter().map(f64::sin).collect(),
            output_power,
            flags,
        }
    }
}
