//! The excitation of a texture's models as the recordings have it: the shape of the prediction residual, and the slow
//! changes of its level. Each is kept where a test on data that was not fitted finds it, and costs nothing elsewhere.
//!
//! A residual is that of the coefficients that are played, at the trial's own node. Two properties of it are judged in
//! every other block of each trial, by models of the blocks between (`judge`):
//! - its local kurtosis, in windows of 10 ms, which changes of level hardly touch;
//! - the spread of its levels, in windows of 50 ms.
//!
//! **The codebook** (`codebook`) is 0.8 to 2 s of the residual, divided by its level over 100 ms if a level track is
//! kept beside, and whitened: pieces of 20 to 80 ms of it have, on average, a flat spectrum. Without that, the codebook
//! of one piece of a recording adds its own third octaves to the model's. The material is taken at equal ranks of the
//! local kurtosis, so that the codebook has the distribution of the whole (`material`). Where regions of the grid
//! differ, each has its own (`regions`).
//!
//! **The level track** (`level`) has 100 ms of smoothing and steps of 20 ms beside a codebook, which has what is
//! faster, and 20 ms and 5 ms beside Gaussian noise. It is joined from all trials, because a single one may be unlike
//! the others; each is divided by its own RMS, because the nodes have the differences between trials.
//!
//! **Moments** (`choice`) take the place of both where levels vary and blocks that were left out are nearer to them:
//! 5 s of the residual with its level, whitened alike and coded in 3 bits, in pieces of up to 1 s. More material does
//! more than longer pieces or finer codes: 2 s of it are no better than a codebook with a track.
//!
//! These choices come from twelve pairs of recorded takes, one fitted and the other judged; none is in the repository.

mod choice;
mod codebook;
mod evidence;
mod level;
mod low_rate;
mod material;
mod regions;
#[cfg(test)]
mod tests;
mod texture;
mod trace;

use model_format::limits;
use rayon::prelude::*;

use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};

use super::Fit;
use super::options::{ExcitationChoice, ModulationChoice, Options};
use super::trial::Signal;

pub use choice::Distances;
pub use evidence::Evidence;
use texture::{Axes, Parts};
pub use texture::{CodebookReport, ExcitationReport, TrackReport};
use trace::Trace;

/// Returns whether `options` leave anything to add: Gaussian noise of steady level needs nothing.
pub(super) fn is_wanted(options: &Options) -> bool {
    options.excitation != ExcitationChoice::Gaussian || options.modulation != ModulationChoice::None
}

/// Adds the excitation of the texture `index` of `fit`, which was fitted to `set` with `options`, in at most `room`
/// bytes, telling `progress` of each trial that is done. `members` are the indices of the texture's trials in the set,
/// and `read` gives the signal of one of them: what is left of the recording if something else plays a part of it. If
/// `are_blocks_fitted`, what is made is of the trials' fitted blocks alone, see [`super::part`].
///
/// # Errors
/// Those of `read`.
pub(super) fn add_to(
    (set, members): (&RecordingSet, &[usize]),
    (fit, index): (&mut Fit, usize),
    options: &Options,
    (room, are_blocks_fitted): (usize, bool),
    read: impl Fn(usize) -> Result<Signal> + Sync,
    progress: impl Fn() + Sync,
) -> Result<()> {
    let texture = &fit.textures[index];
    let mut traces = traces((set, members), (fit, index), &read, &progress)?;
    if are_blocks_fitted {
        traces = choice::fitted(&traces);
    }
    let axes = Axes {
        speeds_mm_s: &texture.grid.speeds_mm_s,
        forces_n: &texture.grid.forces_n,
    };
    let Parts {
        excitation,
        modulation,
        report,
    } = texture::parts(&texture.name, &traces, axes, options, room);
    for parts in [
        &mut fit.textures[index].grid.parts,
        &mut fit.specs[index].parts,
    ] {
        parts.excitation.clone_from(&excitation);
        parts.modulation.clone_from(&modulation);
    }
    fit.excitations.push(report);
    Ok(())
}

/// Bytes that each texture may take for its excitation beside the models, so that they all have room in a library.
pub(super) fn bytes_per_texture(fit: &Fit) -> Result<usize> {
    let encoded = model_format::encode(&fit.specs).map_err(|failure| {
        Error::Model(format!("the textures do not make a library: {failure}"))
    })?;
    let left = limits::MAX_LIBRARY_BYTES.saturating_sub(encoded.len());
    Ok(left / fit.specs.len().max(1))
}

/// Traces of those `members` of the texture `index` that the fit used, as far as they have a residual.
fn traces(
    (set, members): (&RecordingSet, &[usize]),
    (fit, index): (&Fit, usize),
    read: &(impl Fn(usize) -> Result<Signal> + Sync),
    progress: &(impl Fn() + Sync),
) -> Result<Vec<Trace>> {
    let nodes = &fit.specs[index].nodes;
    let grid = &fit.textures[index].grid;
    let traces: Vec<Option<Trace>> = members
        .par_iter()
        .filter(|&&member| fit.trials[member].used)
        .map(|&member| {
            let (trial, report) = (&set.trials[member], &fit.trials[member]);
            let place = |axis: &[f32], value: f64| axis.partition_point(|&v| v < value as f32);
            let at = (
                place(&grid.speeds_mm_s, trial.speed_mm_s),
                place(&grid.forces_n, trial.force_n),
            );
            let trace = match nodes.get(grid.index(at.0, at.1)) {
                Some(node) if node.output_power > 0.0 => {
                    let signal = read(member)?;
                    Trace::of(&signal, at, &node.codes, &report.verdicts)
                }
                _ => None,
            };
            progress();
            Ok(trace)
        })
        .collect::<Result<_>>()?;
    Ok(traces.into_iter().flatten().collect())
}
