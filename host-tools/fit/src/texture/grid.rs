//! A texture's grid of models over speed and force.

use model_format::{Laws, NodeFlags, PartsSpec};
use stylus_dsp::model::Model;

/// Models over ascending speeds and forces. All forces of the first speed come first (speed-major).
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Tangential speeds, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Normal forces, N.
    pub forces_n: Vec<f32>,
    /// One model per node.
    pub models: Vec<Model>,
    /// Laws of the level between nodes and below the grid.
    pub laws: Laws,
    /// Optional parts of the texture.
    pub parts: PartsSpec,
}

impl Grid {
    /// Returns a grid with the default laws and without optional parts.
    pub fn new(speeds_mm_s: Vec<f32>, forces_n: Vec<f32>, models: Vec<Model>) -> Self {
        Self {
            speeds_mm_s,
            forces_n,
            models,
            laws: Laws::default(),
            parts: PartsSpec::default(),
        }
    }

    /// Index of the node at these indices of the axes.
    pub fn index(&self, speed: usize, force: usize) -> usize {
        speed * self.forces_n.len() + force
    }

    /// Returns each node's speed, mm/s, force, N, and model.
    pub fn nodes(&self) -> impl Iterator<Item = (f32, f32, &Model)> {
        let forces = self.forces_n.len();
        self.models.iter().enumerate().map(move |(index, model)| {
            let (speed, force) = (index / forces, index % forces);
            (self.speeds_mm_s[speed], self.forces_n[force], model)
        })
    }
}

/// Returns whether a node with these flags comes from a recording that is not silent.
pub fn is_recorded(flags: NodeFlags) -> bool {
    let others = NodeFlags::INTERPOLATED.with(NodeFlags::EXTRAPOLATED);
    flags.bits() & others.with(NodeFlags::SILENT).bits() == 0
}

/// Returns a value of an axis as it was written in decimals: 0.2, not 0.200000003.
pub fn as_written(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}
