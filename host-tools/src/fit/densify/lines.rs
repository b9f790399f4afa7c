//! Lines that could be added to a grid, with the gain that each promises.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use model_format::NodeFlags;
use rayon::prelude::*;
use serde::Serialize;

use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::model::Model;
use crate::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use crate::texture::domain::{Method, Neighbour};
use crate::texture::grid::Grid;
use crate::texture::recorded_spectra::spectra::{NodeIndex, RecordedSpectra, TwoWays};

/// Worst error of a third octave that a densified node's order may leave, dB: well below the amplitude JND.
pub const ECONOMY_DB: f64 = 0.5;

/// The least gain of C that is worth a line: what cannot be told from the scatter of a recording.
const LEAST_GAIN: f64 = 0.003;

/// Divisions of a gap at most: into two, and each half again.
const DIVISIONS: u32 = 2;

/// The axis along which the nodes of a line share their value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Nodes of one speed.
    Speed,
    /// Nodes of one force.
    Force,
}

/// A line that could be added.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub texture: usize,
    pub direction: Direction,
    pub value: f32,
    pub gain: f64,
}

/// The lines that would make the grid of texture `texture` better.
///
/// The error of a mean over a gap goes with the square of its width, so that the second division promises a quarter
/// of the first.
pub(super) fn candidates(
    texture: usize,
    grid: &Grid,
    field: &RecordedSpectra,
    ways: &TwoWays,
) -> Vec<Candidate> {
    let most = highest_order(grid);
    let mut candidates = Vec::new();
    for direction in [Direction::Speed, Direction::Force] {
        let (along, across) = match direction {
            Direction::Speed => (&grid.speeds_mm_s, grid.forces_n.len()),
            Direction::Force => (&grid.forces_n, grid.speeds_mm_s.len()),
        };
        let place = |index: usize, other: usize| match direction {
            Direction::Speed => (index, other),
            Direction::Force => (other, index),
        };
        // The mean gain at every value of the axis.
        let gains: Vec<Option<f64>> = (0..along.len())
            .map(|index| {
                let nodes = (0..across).map(|other| place(index, other));
                let gains: Vec<f64> = nodes
                    .filter_map(|node| gain(grid, field, (ways, most), direction, node))
                    .collect();
                let mean = gains.iter().sum::<f64>() / gains.len().max(1) as f64;
                (!gains.is_empty()).then_some(mean)
            })
            .collect();
        for gap in 1..along.len() {
            let ends: Vec<f64> = gains[gap - 1..=gap].iter().flatten().copied().collect();
            // Towards silence there is nothing to be filled.
            let sounds =
                |index: usize| (0..across).any(|o| field.spectrum(place(index, o)).is_some());
            if ends.is_empty() || !sounds(gap - 1) || !sounds(gap) {
                continue;
            }
            let mean = ends.iter().sum::<f64>() / ends.len() as f64;
            let (low, high) = (along[gap - 1], along[gap]);
            for division in 1..=DIVISIONS {
                let parts = 1 << division;
                let gain = mean / f64::from(4u32.pow(division - 1));
                // Odd parts only: the even ones belong to the division before.
                let new = (1..parts).step_by(2).map(|part| Candidate {
                    texture,
                    direction,
                    value: rounded(low + (high - low) * part as f32 / parts as f32),
                    gain,
                });
                candidates.extend(new.filter(|candidate| candidate.gain >= LEAST_GAIN));
            }
        }
    }
    candidates
}

/// The model that is filled in where `spectrum` is what the recordings tell.
fn filled_model(spectrum: &LogSpectrum, highest_order: usize) -> Model {
    Model {
        flags: NodeFlags::INTERPOLATED,
        ..spectrum.economical_model(ECONOMY_DB, highest_order)
    }
}

/// The highest order among the recorded nodes of `grid`.
pub fn highest_order(grid: &Grid) -> usize {
    let filled = [NodeFlags::INTERPOLATED, NodeFlags::EXTRAPOLATED];
    let recorded =
        (grid.models.iter()).filter(|model| !filled.iter().any(|&flag| model.flags.contains(flag)));
    let orders = recorded.map(|model| model.reflection.len());
    orders.max().unwrap_or(0)
}

/// A value without the noise of single precision.
fn rounded(value: f32) -> f32 {
    (value * 1e4).round() / 1e4
}

/// C of the device's interpolation over `node` from its two neighbours, less that of the model of order `most` that
/// would be filled in; `None` where either cannot be told.
fn gain(
    grid: &Grid,
    field: &RecordedSpectra,
    (ways, most): (&TwoWays, usize),
    direction: Direction,
    node: NodeIndex,
) -> Option<f64> {
    let recorded = field.spectrum(node)?;
    let (before, after) = match direction {
        Direction::Speed => ((node.0.checked_sub(1)?, node.1), (node.0 + 1, node.1)),
        Direction::Force => ((node.0, node.1.checked_sub(1)?), (node.0, node.1 + 1)),
    };
    if after.0 >= grid.speeds_mm_s.len() || after.1 >= grid.forces_n.len() {
        return None;
    }
    let filled = match direction {
        Direction::Speed => ways.along_speed(field, node)?,
        Direction::Force => ways.along_force(field, node)?,
    };
    field.spectrum(before).and(field.spectrum(after))?;
    let value = |place: NodeIndex| match direction {
        Direction::Speed => grid.speeds_mm_s[place.0],
        Direction::Force => grid.forces_n[place.1],
    };
    let share = f64::from((value(node) - value(before)) / (value(after) - value(before)));
    let neighbours = [(before, 1.0 - share), (after, share)].map(|(place, weight)| Neighbour {
        weight,
        model: &grid.models[grid.index(place.0, place.1)],
    });
    let played = Method::of_device(grid.laws.level).predict(&neighbours)?;
    let cost = |spectrum: &LogSpectrum| recorded.cost(spectrum, DEFAULT_SMOOTHING_WIDTH_HZ);
    Some(cost(&LogSpectrum::of_model(&played)) - cost(&LogSpectrum::of_model(&filled.model(most))))
}

/// All that the recordings of one texture tell.
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
            candidates: candidates(texture, grid, &field, &ways),
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
