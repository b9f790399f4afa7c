//! Spectra of the recorded nodes of a texture, and what they predict at other speeds and forces.

pub mod spectra;
pub mod surface_and_tool;

use model_format::NodeFlags;

use crate::dsp::log_spectrum::LogSpectrum;
use crate::recording::RecordingSet;
use crate::texture::grid::{Grid, as_written};

use spectra::RecordedSpectra;

/// The spectra of a texture's recorded nodes: all trials of a node together, from `signals`, which belong to the trials
/// of `set`. Silent nodes have none.
pub fn recorded_spectra(
    texture: &str,
    grid: &Grid,
    set: &RecordingSet,
    signals: &[Vec<f64>],
) -> RecordedSpectra {
    let nodes: Vec<_> = grid.nodes().collect();
    let spectra = nodes.iter().map(|(speed, force, model)| {
        let without = [
            NodeFlags::SILENT,
            NodeFlags::INTERPOLATED,
            NodeFlags::EXTRAPOLATED,
        ];
        if without.iter().any(|&flag| model.flags.contains(flag)) {
            return None;
        }
        let of_node: Vec<&[f64]> = set
            .trials
            .iter()
            .zip(signals)
            .filter(|(trial, _)| {
                trial.texture == texture
                    && trial.speed_mm_s as f32 == *speed
                    && trial.force_n as f32 == *force
            })
            .map(|(_, signal)| signal.as_slice())
            .collect();
        LogSpectrum::estimate(&of_node)
    });
    let as_written = |axis: &[f32]| axis.iter().map(|&value| as_written(value)).collect();
    RecordedSpectra::new(
        as_written(&grid.speeds_mm_s),
        as_written(&grid.forces_n),
        spectra.collect(),
    )
}
