//! Denser grids: nodes added on the host between the recorded ones. A bilinear mean on the device cannot move a
//! surface's spectrum with the speed; the added nodes do so, as far as this predicts the texture's own nodes. The
//! device stays as it is and interpolates over shorter distances.
//!
//! Lines of nodes at one speed or at one force are added one by one, those with the largest promised gain first, until
//! the slot is full or no line promises a gain. The gain is measured on the recordings: at each end of the gap that the
//! line divides, it is the error of the device's own interpolation over the removed node, less the error of the
//! spectrum that would have been put there. A removed node's neighbours are two gaps apart, so this is the worst case
//! of a gap that is twice as wide. It is used only to order the gaps.
//!
//! No added node has a higher order than the texture's recorded ones.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use model_format::{NodeFlags, SAMPLE_RATE_HZ, TextureSpec, limits};
use rayon::prelude::*;
use serde::Serialize;

use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::model::Model;
use crate::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use crate::fit::blocks::Part;
use crate::fit::fitted::{Fit, FittedTexture, Source};
use crate::fit::options::Options;
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};
use crate::texture::domain::{Method, Neighbour};
use crate::texture::grid::{Grid, as_written};
use crate::texture::library::{spec_of, stored_nodes};
use crate::texture::parts::{Between, bytes as bytes_of_parts, on_grid};
use crate::texture::recorded_spectra::recorded_spectra;
use crate::texture::recorded_spectra::{NodeIndex, RecordedSpectra, TwoWays};
use crate::texture::theta::{StoredTheta, all_allow_compact, bytes_per_node};

/// Upper bound of the bytes of a texture without its axes, nodes and parts: its name, lengths and other fields. The
/// library's own header fits in, too.
const HEADER_BYTES: usize = 64 + limits::MAX_NAME_BYTES;

/// A line of nodes that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AddedLine {
    /// The texture.
    pub texture: String,
    /// Quantity that the line's nodes share.
    pub direction: Direction,
    /// The speed, mm/s, or the force, N.
    pub value: f32,
    /// Expected fall of C: the mean over the removed nodes at both ends of the gap, and a quarter of it for a line that
    /// divides half of a gap.
    pub promised_gain: f64,
}

/// A denser grid per texture.
#[derive(Clone, Debug)]
pub struct Densified {
    /// The textures, ready to be encoded.
    pub specs: Vec<TextureSpec>,
    /// The lines, in the order in which they were chosen.
    pub lines: Vec<AddedLine>,
}

/// A texture whose grid grows.
struct Growing<'f> {
    texture: &'f FittedTexture,
    grid: Grid,
    told: Told,
    /// Form in which θ of all nodes is stored.
    stored: StoredTheta,
}

/// Fills the grids of `fit`, of `set` at 5 kHz with `options`, as densely as a slot of the device allows. The
/// recordings are read again, one texture at a time. Calls `progress` for every texture that is read and every line
/// that is tried.
///
/// # Errors
/// A recording that cannot be read any more; a texture that a library cannot hold.
pub fn densify(
    fit: &Fit,
    set: &RecordingSet,
    options: &Options,
    progress: impl Fn(),
) -> Result<Densified> {
    let source = Source {
        set,
        reports: &fit.trials,
        options,
        part: Part::Whole,
    };
    let growing = |(index, texture)| {
        progress();
        Growing::of(index, texture, &source)
    };
    let textures = fit.textures.iter().enumerate().map(growing);
    let mut textures = textures.collect::<Result<Vec<_>>>()?;
    let candidates = textures
        .iter_mut()
        .flat_map(|own| std::mem::take(&mut own.told.candidates));
    let mut candidates: Vec<Candidate> = candidates.collect();
    // The sort is stable, so that equal gains have one order in every run.
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let taken: usize = textures
        .iter()
        .map(|own| bytes(&own.grid, own.stored))
        .sum();
    let mut left = limits::MAX_LIBRARY_BYTES.saturating_sub(taken);
    let mut lines = Vec::new();
    for candidate in candidates {
        progress();
        let growing = &mut textures[candidate.texture];
        // A later line may be shorter and still fit, so the search goes on.
        let Some(more) = growing.grow(&candidate, left) else {
            continue;
        };
        left -= more;
        lines.push(AddedLine {
            texture: growing.texture.name.clone(),
            direction: candidate.direction,
            value: candidate.value,
            promised_gain: candidate.gain,
        });
    }
    let specs = textures.iter().map(|Growing { texture, grid, .. }| {
        let nodes = stored_nodes(&texture.name, grid, SAMPLE_RATE_HZ)?;
        Ok(spec_of(&texture.name, texture.provenance, grid, nodes))
    });
    let specs = specs.collect::<Result<Vec<TextureSpec>>>()?;
    model_format::encode(&specs)
        .map_err(|failure| Error::Model(format!("the denser grid does not fit: {failure}")))?;
    Ok(Densified { specs, lines })
}

impl<'f> Growing<'f> {
    /// Returns the texture with the index `index`. The nodes that the fit filled get models from the spectra of its
    /// recordings.
    fn of(index: usize, texture: &'f FittedTexture, source: &Source<'_>) -> Result<Self> {
        let mut takes = source.takes(texture)?;
        // `takes` returns all trials if lines or the rig's noise were taken off.
        takes.retain(|take| source.reports[take.number].used);
        let signals = takes
            .iter()
            .map(|take| (take.trial, &take.signal.samples[..]));
        let field = recorded_spectra(&texture.grid, &signals.collect::<Vec<_>>());
        let told = Told::of(index, &texture.grid, field);
        let grid = with_holes_filled(&texture.grid, &told);
        Ok(Self {
            stored: allowed(&grid.models.iter().collect::<Vec<_>>()),
            texture,
            grid,
            told,
        })
    }

    /// Adds a line of nodes if it takes at most `left` bytes. Returns the number of bytes that it took; `None` if it
    /// was not added.
    fn grow(&mut self, line: &Candidate, left: usize) -> Option<usize> {
        let Self { grid, told, .. } = self;
        let (direction, value) = (line.direction, line.value);
        // Nodes without a spectrum would be what the device plays there anyway, and only take bytes.
        if !fills_any(grid, told, direction, value) {
            return None;
        }
        let denser = with_line(grid, told, direction, value)?;
        // If one new node needs fine θ, the whole texture does.
        let after = match self.stored {
            StoredTheta::Fine => StoredTheta::Fine,
            StoredTheta::Compact => allowed(&new_models(grid, &denser)),
        };
        let more = bytes(&denser, after) - bytes(grid, self.stored);
        if more > left {
            return None;
        }
        (self.grid, self.stored) = (denser, after);
        Some(more)
    }
}

/// Returns the form of θ in which a lattice of `models` may be stored.
fn allowed(models: &[&Model]) -> StoredTheta {
    if all_allow_compact(models) {
        StoredTheta::Compact
    } else {
        StoredTheta::Fine
    }
}

/// Returns the models that are in `denser` and not in `grid`.
fn new_models<'g>(grid: &Grid, denser: &'g Grid) -> Vec<&'g Model> {
    let is_new = |&(speed_mm_s, force_n, _): &(f32, f32, &Model)| {
        !grid.speeds_mm_s.contains(&speed_mm_s) || !grid.forces_n.contains(&force_n)
    };
    denser.nodes().filter(is_new).map(|node| node.2).collect()
}

/// Returns an estimate of the bytes that a grid takes in a library. It is never too low.
fn bytes(grid: &Grid, theta: StoredTheta) -> usize {
    const NODE_BYTES: usize = 16;
    let orders = || grid.models.iter().map(|model| model.reflection.len());
    let highest = orders().max().unwrap_or(0);
    // Without stages beyond these there are no tails, and all nodes are stored with fine θ.
    let theta = if highest > limits::MAX_FINE_STAGES {
        theta
    } else {
        StoredTheta::Fine
    };
    let models: usize = orders()
        .map(|order| NODE_BYTES + bytes_per_node(theta, order, highest))
        .sum();
    let axes = 4 * (grid.speeds_mm_s.len() + grid.forces_n.len());
    HEADER_BYTES + axes + models + bytes_of_parts(&grid.parts)
}

/// Replaces the models that `fit` filled in between recorded nodes by those from the recordings' spectra.
fn with_holes_filled(grid: &Grid, told: &Told) -> Grid {
    let mut grid = grid.clone();
    for (model, hole) in grid.models.iter_mut().zip(&told.holes) {
        if let Some(hole) = hole {
            model.clone_from(hole);
        }
    }
    grid
}

/// Returns whether the recordings determine the model of any node of a line at `value`.
fn fills_any(grid: &Grid, told: &Told, direction: Direction, value: f32) -> bool {
    let [_, across] = direction.axes(grid);
    across.iter().any(|&other| {
        let [speed, force] = direction.of([as_written(value), as_written(other)]);
        told.model_at(speed, force).is_some()
    })
}

/// Returns `grid` with one more line of nodes; `None` if the axis is full or already has the value.
fn with_line(grid: &Grid, told: &Told, direction: Direction, value: f32) -> Option<Grid> {
    let mut denser = grid.clone();
    let axis = match direction {
        Direction::Speed => &mut denser.speeds_mm_s,
        Direction::Force => &mut denser.forces_n,
    };
    let at = axis.partition_point(|&known| known < value);
    if axis.len() >= limits::MAX_AXIS_LEN || axis.get(at) == Some(&value) {
        return None;
    }
    axis.insert(at, value);
    let places = places_with(grid, direction, at, value);
    denser.parts = on_grid(&grid.parts, &places);
    let forces = denser.forces_n.len();
    let model = |(index, place): (usize, &Between)| match place.nodes {
        [node, other] if node == other => grid.models[node].clone(),
        _ => {
            let speed_mm_s = denser.speeds_mm_s[index / forces];
            let force_n = denser.forces_n[index % forces];
            new_node(grid, told, [speed_mm_s, force_n], place)
        }
    };
    denser.models = places.par_iter().enumerate().map(model).collect();
    Some(denser)
}

/// Returns the positions on `grid` of the nodes of a denser grid, which has an additional line of nodes at `value`
/// before line `at` of an axis. `at` is at least 1.
fn places_with(grid: &Grid, direction: Direction, at: usize, value: f32) -> Vec<Between> {
    let on_axis = |axis: &[f32], own: bool| -> Vec<Between> {
        let mut places: Vec<Between> = (0..axis.len()).map(Between::at).collect();
        if own {
            let (before, after) = (axis[at - 1], axis[at]);
            let between = Between {
                nodes: [at - 1, at],
                share: (value - before) / (after - before),
            };
            places.insert(at, between);
        }
        places
    };
    let speeds = on_axis(&grid.speeds_mm_s, direction == Direction::Speed);
    let forces = on_axis(&grid.forces_n, direction == Direction::Force);
    let place = |speed: Between, force: Between| Between {
        nodes: [0, 1].map(|end| grid.index(speed.nodes[end], force.nodes[end])),
        // A line is added to one axis, so one of the two shares is 0.
        share: speed.share.max(force.share),
    };
    let of_speed = |&speed: &Between| forces.iter().map(move |&force| place(speed, force));
    speeds.iter().flat_map(of_speed).collect()
}

/// Returns the model of a new node at a speed, mm/s, and a force, N, between two nodes of the grid: that of the
/// spectrum there. If there is no spectrum, or a neighbour is silent, it is what the device would play there.
fn new_node(grid: &Grid, told: &Told, at: [f32; 2], place: &Between) -> Model {
    let ends = place.nodes.map(|node| &grid.models[node]);
    let is_silent = |model: &&Model| model.flags.contains(NodeFlags::SILENT);
    let [speed, force] = at.map(as_written);
    if !ends.iter().any(is_silent)
        && let Some(model) = told.model_at(speed, force)
    {
        return model;
    }
    let neighbours = [(1.0 - place.share, ends[0]), (place.share, ends[1])];
    let neighbours = neighbours.map(|(weight, model)| Neighbour {
        weight: f64::from(weight),
        model,
    });
    let mut model = Method::of_device(grid.laws.level)
        .predict(&neighbours)
        .expect("a mean of angles is stable");
    model.flags = if model.output_power > 0.0 {
        NodeFlags::INTERPOLATED
    } else {
        NodeFlags::SILENT
    };
    model
}

/// Largest error of a third-octave band that the reduced order of an added node may cause, dB: well below the amplitude
/// JND.
pub const ECONOMY_DB: f64 = 0.5;

/// Least gain of C for which a line is added. A smaller one cannot be distinguished from the scatter of a recording.
const LEAST_GAIN: f64 = 0.003;

/// Largest number of divisions of a gap: into halves, and each of these again.
const DIVISIONS: u32 = 2;

/// The axis whose value the nodes of a line share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Nodes of one speed.
    Speed,
    /// Nodes of one force.
    Force,
}

impl Direction {
    /// Returns the axis of `grid` along which such lines are added, and the axis along a line.
    fn axes(self, grid: &Grid) -> [&[f32]; 2] {
        self.of([&grid.speeds_mm_s, &grid.forces_n])
    }

    /// Converts a pair for (line, node) to one for (speed, force), or the reverse.
    fn of<T>(self, [line, node]: [T; 2]) -> [T; 2] {
        match self {
            Self::Speed => [line, node],
            Self::Force => [node, line],
        }
    }

    /// Returns the node with the indices `line` among the lines and `node` on its line.
    fn node(self, line: usize, node: usize) -> NodeIndex {
        self.of([line, node]).into()
    }
}

/// A line that could be added.
#[derive(Clone, Debug)]
struct Candidate {
    pub texture: usize,
    pub direction: Direction,
    pub value: f32,
    pub gain: f64,
}

/// Returns the lines that would improve the grid of texture `texture`.
///
/// The error of a mean over a gap is proportional to the square of its width, so the second division promises a quarter
/// of the gain of the first.
fn candidates(
    texture: usize,
    grid: &Grid,
    field: &RecordedSpectra,
    ways: &TwoWays,
) -> Vec<Candidate> {
    let most = highest_order(grid);
    let mut candidates = Vec::new();
    for direction in [Direction::Speed, Direction::Force] {
        let [along, across] = direction.axes(grid);
        let across = across.len();
        let place = |index: usize, other: usize| direction.node(index, other);
        // Mean gain at every value of the axis.
        let gains: Vec<Option<f64>> = (0..along.len())
            .map(|index| {
                let nodes = (0..across).map(|other| place(index, other));
                let gains: Vec<f64> = nodes
                    .filter_map(|node| gain(grid, field, ways, most, direction, node))
                    .collect();
                let mean = gains.iter().sum::<f64>() / gains.len().max(1) as f64;
                (!gains.is_empty()).then_some(mean)
            })
            .collect();
        for gap in 1..along.len() {
            // A gap at the edge of the grid has a gain at its inner end alone.
            let ends: Vec<f64> = gains[gap - 1..=gap].iter().flatten().copied().collect();
            // Next to silence, nothing can be filled in.
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
                // Only odd parts: the even ones belong to the previous division.
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

/// Returns the model of a filled node with this `spectrum`.
fn filled_model(spectrum: &LogSpectrum, highest_order: usize) -> Model {
    Model {
        flags: NodeFlags::INTERPOLATED,
        ..spectrum.economical_model(ECONOMY_DB, highest_order)
    }
}

/// Returns the highest order among the recorded nodes of `grid`.
pub fn highest_order(grid: &Grid) -> usize {
    let filled = [NodeFlags::INTERPOLATED, NodeFlags::EXTRAPOLATED];
    let recorded =
        (grid.models.iter()).filter(|model| !filled.iter().any(|&flag| model.flags.contains(flag)));
    let orders = recorded.map(|model| model.reflection.len());
    orders.max().unwrap_or(0)
}

/// Returns a value without the rounding noise of single precision.
fn rounded(value: f32) -> f32 {
    (value * 1e4).round() / 1e4
}

/// Returns the fall of C at `node`: C of the device's interpolation between its two neighbours, less C of the model of
/// order `most` that would be filled in. `None` if either cannot be computed.
fn gain(
    grid: &Grid,
    field: &RecordedSpectra,
    ways: &TwoWays,
    most: usize,
    direction: Direction,
    node: NodeIndex,
) -> Option<f64> {
    let recorded = field.spectrum(node)?;
    let [line, across] = direction.of(node.into());
    let [along, _] = direction.axes(grid);
    let [low, high] = [line.checked_sub(1)?, line + 1];
    if high >= along.len() {
        return None;
    }
    let [before, after] = [low, high].map(|line| direction.node(line, across));
    let filled = match direction {
        Direction::Speed => ways.along_speed(field, node)?,
        Direction::Force => ways.along_force(field, node)?,
    };
    field.spectrum(before).and(field.spectrum(after))?;
    let share = f64::from((along[line] - along[low]) / (along[high] - along[low]));
    let neighbours = [(before, 1.0 - share), (after, share)].map(|(place, weight)| Neighbour {
        weight,
        model: &grid.models[grid.index(place.0, place.1)],
    });
    let played = Method::of_device(grid.laws.level).predict(&neighbours)?;
    let cost = |spectrum: &LogSpectrum| recorded.cost(spectrum, DEFAULT_SMOOTHING_WIDTH_HZ);
    Some(cost(&LogSpectrum::of_model(&played)) - cost(&LogSpectrum::of_model(&filled.model(most))))
}

/// Everything that the recordings of one texture determine.
struct Told {
    field: RecordedSpectra,
    /// Weight of the version whose surface part moves with the speed.
    moving: f64,
    /// Lines that could be added.
    pub candidates: Vec<Candidate>,
    /// Models for the nodes that `fit` filled in, by the node's index.
    pub holes: Vec<Option<Model>>,
    highest_order: usize,
    /// Models by the bits of speed, mm/s, and force, N; `None` where the recordings determine none.
    known: Mutex<HashMap<[u64; 2], Option<Model>>>,
}

impl Told {
    /// Derives everything from `field` that concerns the grid of texture `texture`.
    pub fn of(texture: usize, grid: &Grid, field: RecordedSpectra) -> Self {
        let ways = TwoWays::of(&field);
        let highest_order = highest_order(grid);
        let forces = grid.forces_n.len();
        let hole = |(index, model): (usize, &Model)| {
            // Beyond the recorded nodes (extrapolated) there is nothing to interpolate between.
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
            moving: ways.moving,
            field,
        }
    }

    /// Returns the model at a speed, mm/s, and a force, N; `None` where the recordings determine none.
    pub(crate) fn model_at(&self, speed_mm_s: f64, force_n: f64) -> Option<Model> {
        let place = [speed_mm_s.to_bits(), force_n.to_bits()];
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(model) = known().get(&place) {
            return model.clone();
        }
        // Computed without the lock, because it takes long. Two threads may compute the same model, with the same
        // result.
        let spectrum = self.field.at(speed_mm_s, force_n, self.moving);
        let model = spectrum.map(|spectrum| filled_model(&spectrum, self.highest_order));
        known().insert(place, model.clone());
        model
    }
}
