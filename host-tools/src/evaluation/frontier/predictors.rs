//! Predictors for the kernel's direct form, from a texture that is stored as a lattice.

use model_format::Texture;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::variants::direct::{CODE_SUM_LIMIT, COEFFICIENT_FRACTION_BITS, MAX_EXPONENT};

use crate::dsp::linear_prediction::{step_down, step_up};
use crate::texture::stored::reflection;

/// The predictors of all nodes of a texture.
#[derive(Clone, Debug)]
pub struct Predictors {
    /// Codes by node, speed-major, each of as many taps as the texture's highest order.
    codes: Vec<Vec<i32>>,
    forces: usize,
    exponent: u32,
}

impl Predictors {
    /// The predictors of `texture`, each rounded to `bits` bits. `None` if one of them is too large for that, or not
    /// stable after rounding.
    pub fn of(texture: &Texture<'_>, bits: u32) -> Option<Self> {
        let taps = texture.max_order();
        let nodes = texture.nodes().map(|node| {
            let polynomial = step_up(&reflection(node.coefficients));
            let mut predictor: Vec<f64> = polynomial.iter().map(|a| -a).collect();
            predictor.resize(taps, 0.0);
            predictor
        });
        let nodes: Vec<Vec<f64>> = nodes.collect();
        let needed = nodes.iter().map(|predictor| exponent_of(predictor));
        let exponent = needed.max().unwrap_or(0);
        let codes = nodes.iter().map(|predictor| {
            // A node's own exponent decides its steps; the codes are those of the common one.
            let step = 2f64.powi(exponent_of(predictor) + 1 - bits as i32);
            let rounded: Vec<f64> = predictor
                .iter()
                .map(|h| (h / step).round() * step)
                .collect();
            let polynomial: Vec<f64> = rounded.iter().map(|h| -h).collect();
            step_down(&polynomial)?;
            let one = 2f64.powi(COEFFICIENT_FRACTION_BITS as i32 - exponent);
            Some(rounded.iter().map(|h| (h * one) as i32).collect())
        });
        let codes = codes.collect::<Option<Vec<_>>>()?;
        let exponent = u32::try_from(exponent)
            .ok()
            .filter(|&e| e <= MAX_EXPONENT)?;
        Some(Self {
            codes,
            forces: texture.force_axis().len(),
            exponent,
        })
    }

    /// The binary exponent of all of them.
    pub fn exponent(&self) -> u32 {
        self.exponent
    }

    /// The predictors of the nodes around `point`.
    pub fn around(&self, point: &GridPoint) -> [&[i32]; 4] {
        point
            .nodes
            .map(|(speed, force)| self.codes[speed * self.forces + force].as_slice())
    }
}

/// The least exponent at which the codes of `predictor` fit their words, and their sum the kernel's.
fn exponent_of(predictor: &[f64]) -> i32 {
    let largest = predictor.iter().fold(0.0, |most: f64, h| most.max(h.abs()));
    let sum: f64 = predictor.iter().map(|h| h.abs()).sum();
    // Rounding may add half a step to each tap.
    let room = 0.999 * CODE_SUM_LIMIT as f64 / 2f64.powi(COEFFICIENT_FRACTION_BITS as i32);
    let holds = |exponent: i32| {
        let scale = 2f64.powi(exponent);
        largest < 0.9999 * scale && sum < room * scale
    };
    (0..64).find(|&exponent| holds(exponent)).unwrap_or(64)
}
