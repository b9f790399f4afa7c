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
//! These choices come from twelve pairs of recorded takes, one fitted and the other judged; none is in the repository.

mod codebook;
mod evidence;
mod judge;
mod level;
mod material;
mod regions;
mod report;
mod residual;
#[cfg(test)]
mod tests;
mod texture;
mod trace;

use model_format::limits;
use rayon::prelude::*;

use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};

use super::options::{ExcitationChoice, ModulationChoice, Options};
use super::trial::{Signal, signal};
use super::{Fit, FittedTexture};

pub use evidence::Evidence;
pub use report::{CodebookReport, ExcitationReport, TrackReport};
use texture::{Axes, Parts};
use trace::Trace;

/// Adds the excitation of each texture of `fit`, which was fitted to `set` with `options`, telling `progress` of each
/// trial read. Recordings are read again, so that no more of them than is worked on is in memory.
///
/// # Errors
/// A recording that cannot be read any more; a library without room for its textures.
pub fn add(
    set: &RecordingSet,
    fit: &mut Fit,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<()> {
    let read = |_, trial: &Trial| signal(trial, options.reduction);
    add_from(set, fit, options, read, progress)
}

/// As [`add`], with the signal of a trial from `read`, which gets its index in the set: what is left of the recording
/// if something else plays a part of it.
///
/// # Errors
/// Those of [`add`] and of `read`.
pub fn add_from(
    set: &RecordingSet,
    fit: &mut Fit,
    options: &Options,
    read: impl Fn(usize, &Trial) -> Result<Signal> + Sync,
    progress: impl Fn() + Sync,
) -> Result<()> {
    if options.excitation == ExcitationChoice::Gaussian
        && options.modulation == ModulationChoice::None
    {
        return Ok(());
    }
    let room = bytes_per_texture(fit)?;
    for index in 0..fit.textures.len() {
        let texture = &fit.textures[index];
        let traces = traces(texture, fit, index, set, options, &read, &progress)?;
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
    }
    Ok(())
}

/// Bytes that each texture may take for its excitation beside the models, so that they all have room in a library.
fn bytes_per_texture(fit: &Fit) -> Result<usize> {
    let encoded = model_format::encode_uncertified(&fit.specs).map_err(|failure| {
        Error::Model(format!("the textures do not make a library: {failure}"))
    })?;
    let left = limits::MAX_LIBRARY_BYTES.saturating_sub(encoded.len());
    Ok(left / fit.specs.len().max(1))
}

/// Traces of all trials of a texture that the fit used, as far as they have a residual.
fn traces(
    texture: &FittedTexture,
    fit: &Fit,
    index: usize,
    set: &RecordingSet,
    options: &Options,
    read: &(impl Fn(usize, &Trial) -> Result<Signal> + Sync),
    progress: &(impl Fn() + Sync),
) -> Result<Vec<Trace>> {
    let nodes = &fit.specs[index].nodes;
    let grid = &texture.grid;
    let traces: Vec<Option<Trace>> = set
        .trials
        .par_iter()
        .zip(&fit.trials)
        .enumerate()
        .filter(|(_, (trial, report))| trial.texture == texture.name && report.used)
        .map(|(index, (trial, report))| {
            let place = |axis: &[f32], value: f64| axis.partition_point(|&v| v < value as f32);
            let at = (
                place(&grid.speeds_mm_s, trial.speed_mm_s),
                place(&grid.forces_n, trial.force_n),
            );
            let trace = match nodes.get(grid.index(at.0, at.1)) {
                Some(node) if node.output_power > 0.0 => {
                    let signal = read(index, trial)?;
                    Trace::of(
                        &signal,
                        at,
                        &node.codes,
                        &report.verdicts,
                        options.estimator,
                    )
                }
                _ => None,
            };
            progress();
            Ok(trace)
        })
        .collect::<Result<_>>()?;
    Ok(traces.into_iter().flatten().collect())
}
