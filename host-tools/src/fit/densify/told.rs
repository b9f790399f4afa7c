//! The models that the recordings of one texture tell of any place between its nodes, computed once for each place.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use model_format::NodeFlags;
use rayon::prelude::*;

use super::filling::{filled_model, highest_order};
use super::lines::{self, Candidate};
use crate::dsp::model::Model;
use crate::texture::grid::Grid;
use crate::texture::recorded_spectra::spectra::{RecordedSpectra, TwoWays};

/// All that the recordings of one texture tell. It does not depend on what is left out, so every round of densifying
/// uses the same.
pub(super) struct Told {
    pub field: RecordedSpectra,
    /// The lines that could be added.
    pub candidates: Vec<Candidate>,
    /// Models of the nodes that `fit` filled in, by the index of the node.
    pub holes: Vec<Option<Model>>,
    highest_order: usize,
    /// Models by the bits of speed, mm/s, and force, N; none where the recordings tell nothing.
    known: Mutex<HashMap<[u64; 2], Option<Model>>>,
}

impl Told {
    /// All that `field` tells of the grid of texture `texture`.
    pub fn of(texture: usize, grid: &Grid, field: RecordedSpectra) -> Self {
        let ways = TwoWays::of(&field);
        let highest_order = highest_order(grid);
        let forces = grid.forces_n.len();
        let hole = |(index, model): (usize, &Model)| {
            let is_hole = model.flags.contains(NodeFlags::INTERPOLATED)
                && !model.flags.contains(NodeFlags::SILENT);
            let spectrum = is_hole
                .then(|| field.without((index / forces, index % forces), &ways))
                .flatten()?;
            Some(filled_model(&spectrum, highest_order))
        };
        Self {
            candidates: lines::candidates(texture, grid, &field, &ways),
            holes: grid.models.par_iter().enumerate().map(hole).collect(),
            highest_order,
            known: Mutex::default(),
            field,
        }
    }

    /// The model at a speed, mm/s, and a force, N; none where the recordings tell nothing.
    pub fn model_at(&self, speed_mm_s: f64, force_n: f64) -> Option<Model> {
        let place = [speed_mm_s.to_bits(), force_n.to_bits()];
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(model) = known().get(&place) {
            return model.clone();
        }
        // Without the lock, because it takes long; two threads may compute the same, and find the same.
        let spectrum = self.field.at(speed_mm_s, force_n);
        let model = spectrum.map(|spectrum| filled_model(&spectrum, self.highest_order));
        known().insert(place, model.clone());
        model
    }
}
