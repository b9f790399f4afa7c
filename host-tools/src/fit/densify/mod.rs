//! Denser grids: lines of nodes between the recorded ones, filled on the host by what a bilinear mean on the device
//! cannot do, which is to move a surface's spectrum with the speed. The device stays as it is; it interpolates over
//! shorter distances.
//!
//! Lines of a speed or of a force are added one by one, the one first that promises most, until the slot is full or no
//! line promises anything. What a line promises is measured on the recordings: at the ends of the gap that it divides,
//! the error of the device's own interpolation over the removed node, less that of the spectrum that would have been
//! put there. A removed node's neighbours are two gaps apart, so that this is the worst case of a gap, twice as wide;
//! it is the order of the gaps that it is used for.

mod lines;

use model_format::{NodeFlags, Structure, TextureSpec, limits};
use serde::Serialize;

use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::model::Model;
use crate::fit::{FittedTexture, Options};
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};
use crate::texture::certificate;
use crate::texture::domain::{Method, Neighbour};
use crate::texture::grid::Grid;
use crate::texture::grid::as_written;
use crate::texture::library::texture_spec;
use crate::texture::parts::{Between, bytes as bytes_of_parts, on_grid};
use crate::texture::recorded_spectra::recorded_spectra;
use crate::texture::recorded_spectra::spectra::{NodeIndex, RecordedSpectra, TwoWays};

pub use lines::Direction;

/// Worst error of a third octave that a densified node's order may leave, dB: well below the amplitude JND.
pub const ECONOMY_DB: f64 = 0.5;

/// Bytes that a library's headers may take beside its nodes: names, axes and lengths, with room to spare.
const HEADER_BYTES: usize = 64 + limits::MAX_NAME_BYTES;

/// A line of nodes that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AddedLine {
    /// The texture.
    pub texture: String,
    /// The axis that the line's value belongs to.
    pub direction: Direction,
    /// The speed, mm/s, or the force, N.
    pub value: f32,
    /// By how much C falls, on average over the removed nodes at both ends of the gap.
    pub promised_gain: f64,
}

/// A denser grid per texture.
#[derive(Clone, Debug)]
pub struct Densified {
    /// The textures, ready to be encoded.
    pub specs: Vec<TextureSpec>,
    /// Their grids before quantisation, in the same order.
    pub grids: Vec<Grid>,
    /// The lines, in the order in which they were chosen.
    pub lines: Vec<AddedLine>,
}

/// Fills `textures` as densely as a slot of the device allows, telling `progress` of every line looked at.
///
/// `signals` are the reduced signals of the trials of `set`, those of dropped trials empty.
///
/// # Errors
/// A texture that the structure of `options` cannot hold.
pub fn densify(
    textures: &[FittedTexture],
    set: &RecordingSet,
    signals: &[Vec<f64>],
    options: &Options,
    progress: impl Fn(),
) -> Result<Densified> {
    let fields: Vec<RecordedSpectra> = textures
        .iter()
        .map(|texture| recorded_spectra(&texture.name, &texture.grid, set, signals))
        .collect();
    let mut grids: Vec<Grid> = Vec::new();
    let mut candidates = Vec::new();
    for (index, (texture, field)) in textures.iter().zip(&fields).enumerate() {
        let ways = TwoWays::of(field);
        grids.push(with_holes_filled(&texture.grid, field, &ways));
        candidates.extend(lines::candidates(index, &texture.grid, field, &ways));
    }
    candidates.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let structure = options.structure.structure();
    let mut left = limits::MAX_LIBRARY_BYTES.saturating_sub(
        grids
            .iter()
            .map(|grid| bytes(grid, structure))
            .sum::<usize>(),
    );
    let mut lines = Vec::new();
    for candidate in candidates {
        progress();
        let (grid, field) = (&grids[candidate.texture], &fields[candidate.texture]);
        let Some(denser) = with_line(grid, field, candidate.direction, candidate.value) else {
            continue;
        };
        let more = bytes(&denser, structure) - bytes(grid, structure);
        if more > left {
            continue;
        }
        left -= more;
        grids[candidate.texture] = denser;
        lines.push(AddedLine {
            texture: textures[candidate.texture].name.clone(),
            direction: candidate.direction,
            value: candidate.value,
            promised_gain: candidate.gain,
        });
    }
    let specs = textures
        .iter()
        .zip(&grids)
        .map(|(texture, grid)| {
            certificate::certified(texture_spec(
                &texture.name,
                texture.provenance,
                grid,
                options.structure,
            )?)
        })
        .collect::<Result<Vec<_>>>()?;
    model_format::encode(&specs)
        .map_err(|failure| Error::Model(format!("the denser grid does not fit: {failure}")))?;
    Ok(Densified {
        specs,
        grids,
        lines,
    })
}

/// About how many bytes a grid takes in a library of `structure`; not fewer than it does.
fn bytes(grid: &Grid, structure: Structure) -> usize {
    const NODE_BYTES: usize = 16;
    let orders = || grid.models.iter().map(|model| model.reflection.len());
    let width = structure.coefficient_bytes();
    let models: usize = orders().map(|order| NODE_BYTES + width * order).sum();
    // A lattice's fractions of theta are as many for each node.
    let fractions = match structure {
        Structure::NormalisedLattice => orders().max().unwrap_or(0).min(limits::MAX_FINE_STAGES),
        Structure::DirectForm16 | Structure::DirectForm32 => 0,
    };
    let axes = 4 * (grid.speeds_mm_s.len() + grid.forces_n.len());
    HEADER_BYTES + axes + models + fractions * grid.models.len() + bytes_of_parts(&grid.parts)
}

/// Replaces what `fit` filled between recorded nodes by what their spectra tell.
fn with_holes_filled(grid: &Grid, field: &RecordedSpectra, ways: &TwoWays) -> Grid {
    let mut grid = grid.clone();
    let forces = grid.forces_n.len();
    for (index, model) in grid.models.iter_mut().enumerate() {
        let hole = model.flags.contains(NodeFlags::INTERPOLATED)
            && !model.flags.contains(NodeFlags::SILENT);
        if hole && let Some(spectrum) = field.without((index / forces, index % forces), ways) {
            *model = filled(&spectrum);
        }
    }
    grid
}

fn filled(spectrum: &LogSpectrum) -> Model {
    Model {
        flags: NodeFlags::INTERPOLATED,
        ..spectrum.economical_model(ECONOMY_DB)
    }
}

/// `grid` with a line of nodes more; `None` where the axis is full or has the value.
fn with_line(
    grid: &Grid,
    field: &RecordedSpectra,
    direction: Direction,
    value: f32,
) -> Option<Grid> {
    use rayon::prelude::*;
    let mut denser = grid.clone();
    let axis = match direction {
        Direction::Speed => &mut denser.speeds_mm_s,
        Direction::Force => &mut denser.forces_n,
    };
    let at = axis.partition_point(|&known| known < value);
    if axis.len() >= limits::MAX_AXIS_LEN || axis.get(at) == Some(&value) {
        return None;
    }
    let places = places_with(grid, direction, at, value);
    axis.insert(at, value);
    denser.parts = on_grid(&grid.parts, &places);
    let forces = denser.forces_n.len();
    let places = 0..denser.speeds_mm_s.len() * forces;
    denser.models = places
        .into_par_iter()
        .map(|index| {
            let (speed, force) = (index / forces, index % forces);
            let old = |at_line: usize, before: usize| before - usize::from(before > at_line);
            match direction {
                Direction::Speed if speed == at => new_node(
                    grid,
                    field,
                    value,
                    denser.forces_n[force],
                    [(at - 1, force), (at, force)],
                ),
                Direction::Force if force == at => new_node(
                    grid,
                    field,
                    denser.speeds_mm_s[speed],
                    value,
                    [(speed, at - 1), (speed, at)],
                ),
                Direction::Speed => grid.models[grid.index(old(at, speed), force)].clone(),
                Direction::Force => grid.models[grid.index(speed, old(at, force))].clone(),
            }
        })
        .collect();
    Some(denser)
}

/// Places, on `grid`, of the nodes of a denser one, with a line of nodes at `value` before line `at` of an axis, and
/// not before its first.
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
        share: speed.share.max(force.share),
    };
    let of_speed = |&speed: &Between| forces.iter().map(move |&force| place(speed, force));
    speeds.iter().flat_map(of_speed).collect()
}

/// A node between two of the grid's: by the spectrum there, or, where the field has none, as the device would play it.
fn new_node(
    grid: &Grid,
    field: &RecordedSpectra,
    speed_mm_s: f32,
    force_n: f32,
    around: [NodeIndex; 2],
) -> Model {
    let ends = around.map(|(speed, force)| &grid.models[grid.index(speed, force)]);
    let is_silent = |model: &&Model| model.flags.contains(NodeFlags::SILENT);
    if !ends.iter().any(is_silent)
        && let Some(spectrum) = field.at(as_written(speed_mm_s), as_written(force_n))
    {
        return filled(&spectrum);
    }
    let [a, b] = around.map(|(speed, force)| (grid.speeds_mm_s[speed], grid.forces_n[force]));
    let share = if a.0 == b.0 {
        (force_n - a.1) / (b.1 - a.1)
    } else {
        (speed_mm_s - a.0) / (b.0 - a.0)
    };
    let neighbours =
        [(1.0 - share, a.0, ends[0]), (share, b.0, ends[1])].map(|(weight, speed_mm_s, model)| {
            Neighbour {
                weight: f64::from(weight),
                speed_mm_s: f64::from(speed_mm_s),
                model,
            }
        });
    let mut model = Method::of_device(grid.laws.level)
        .predict(&neighbours, f64::from(speed_mm_s))
        .expect("a mean of angles is stable");
    model.flags = if model.output_power > 0.0 {
        NodeFlags::INTERPOLATED
    } else {
        NodeFlags::SILENT
    };
    model
}
