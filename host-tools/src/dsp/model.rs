//! The linear predictor of one node: an all-pole model with its level.

use model_format::NodeFlags;

/// The model at one node.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Reflection coefficients, as many as the order.
    pub reflection: Vec<f64>,
    /// Variance of the signal, (m/s²)².
    pub output_power: f64,
    /// What is to be known about it.
    pub flags: NodeFlags,
}

impl Model {
    /// Silence.
    pub fn silent() -> Self {
        Self {
            reflection: Vec::new(),
            output_power: 0.0,
            flags: NodeFlags::SILENT,
        }
    }

    /// Whether it is silence.
    pub fn is_silent(&self) -> bool {
        self.flags.contains(NodeFlags::SILENT)
    }

    /// A weighted mean of models where every mixture is stable and every level right: of θ = arcsin k, and of the power's
    /// logarithm (of the power itself where one is silent). Weights add up to one.
    pub fn mean(models: &[(f64, &Self)]) -> Self {
        let order = models.iter().map(|(_, model)| model.reflection.len()).max();
        let mut thetas = vec![0.0; order.unwrap_or(0)];
        for (weight, model) in models {
            for (theta, k) in thetas.iter_mut().zip(&model.reflection) {
                *theta += weight * k.asin();
            }
        }
        let any_silent = models.iter().any(|(_, model)| model.is_silent());
        let power = |of: fn(f64) -> f64| -> f64 {
            let terms = models.iter().map(|(w, model)| w * of(model.output_power));
            terms.sum()
        };
        let output_power = if any_silent {
            power(|p| p)
        } else {
            power(f64::ln).exp()
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
