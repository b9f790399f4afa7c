//! The choice of a texture's θ by its errors.

use model_format::{CodeSpec, NodeSpec, SAMPLE_RATE_HZ, limits};
use rayon::prelude::*;

use super::choice::{LARGEST_ERROR, StoredTheta, ThetaChoice};
use super::report::{NodeError, ThetaReport};
use crate::dsp::model::Model;
use crate::dsp::model_error::ModelError;
use crate::texture::grid::Grid;
use crate::texture::quantise::{COMPACT_FINE_STAGES, compact_codes, stored_reflection, with_codes};

/// Rounds the θ of texture `name` as `choice` asks. `nodes` are those of `grid`, quantised as a lattice with fine θ;
/// `sample_rate_hz` is that of the models.
pub fn store(
    name: &str,
    grid: &Grid,
    nodes: Vec<NodeSpec>,
    choice: ThetaChoice,
    sample_rate_hz: u32,
) -> (Vec<NodeSpec>, ThetaReport) {
    let long = grid.models.iter().filter(|model| is_long(model)).count();
    if choice == ThetaChoice::Fine || long == 0 {
        let report = ThetaReport::unjudged(name, long);
        return (nodes, report);
    }
    let compacted: Vec<(CodeSpec, Option<ModelError>)> = (grid.models.par_iter())
        .map(|model| compacted(model, sample_rate_hz))
        .collect();
    let errors = compacted.iter().zip(grid.nodes());
    let errors = errors.filter_map(|((_, error), (speed_mm_s, force_n, _))| {
        Some(NodeError {
            speed_mm_s,
            force_n,
            error: (*error)?,
        })
    });
    let report = ThetaReport::judged(name, long, &errors.collect::<Vec<_>>(), choice);
    match report.stored {
        StoredTheta::Fine => (nodes, report),
        StoredTheta::Compact => {
            let codes = compacted.into_iter().map(|(codes, _)| codes);
            let both = nodes.iter().zip(codes);
            let nodes = both.map(|(node, codes)| with_codes(node, codes));
            (nodes.collect(), report)
        }
    }
}

/// Returns whether all of `models`, of 5 kHz, may be stored with compact θ.
pub fn all_allow_compact(models: &[&Model]) -> bool {
    models.par_iter().all(|model| {
        let (_, error) = compacted(model, SAMPLE_RATE_HZ);
        error.is_none_or(|error| error.share_of(LARGEST_ERROR) <= 1.0)
    })
}

/// Returns whether a model is heard and has stages that compact θ stores in one byte.
fn is_long(model: &Model) -> bool {
    !model.is_silent() && model.reflection.len() > limits::MAX_FINE_STAGES
}

/// The compact codes of a model, and their error; none of a silent model, which is never played, and none where no
/// stage has fewer bits than with fine θ.
fn compacted(model: &Model, sample_rate_hz: u32) -> (CodeSpec, Option<ModelError>) {
    let codes = compact_codes(model);
    let rate_hz = f64::from(sample_rate_hz);
    let rounded = model.reflection.len() > COMPACT_FINE_STAGES;
    let error = (rounded && !model.is_silent())
        .then(|| ModelError::between(&model.reflection, &stored_reflection(&codes), rate_hz));
    (codes, error)
}
