//! The bytes of a lattice's θ: in the fewest, if the spectrum of every node allows it.
//!
//! All textures have the first 32 stages in 16 bits or more. *Fine* ones have 24 bits there and 16 bits in the stages
//! after them. *Compact* ones have 24 bits in the first stages alone and one byte per stage after the 32nd, with a
//! range per node: half of the bytes at order 400.

use std::fmt;

use model_format::{CodeSpec, NodeSpec, SAMPLE_RATE_HZ, limits};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::dsp::model::Model;
use crate::dsp::model_error::ModelError;
use crate::texture::grid::Grid;
use crate::texture::quantise::{COMPACT_FINE_STAGES, compact_codes, stored_reflection, with_codes};

/// Largest errors of a node that compact θ may make.
///
/// The RMS and the third octave are far below any just noticeable difference, that of amplitude being 2.2 dB
/// ([`crate::dsp::spectrum::AMPLITUDE_JND_DB`]), and below the scatter of two takes of one surface.
pub const LARGEST_ERROR: ModelError = ModelError {
    rms_db: 0.1,
    third_octave_db: 0.2,
    line_db: 0.2,
};

/// The choice of a user.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ThetaChoice {
    /// Compact for each texture whose nodes all keep their spectrum.
    #[default]
    Auto,
    /// 24 bits in the first 32 stages, 16 bits in others.
    Fine,
    /// One byte in stages after the 32nd, whatever the error.
    Compact,
}

/// The form in which a texture's θ is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StoredTheta {
    /// 16 bits or more in all stages.
    Fine,
    /// One byte in stages after the 32nd.
    Compact,
}

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

/// The form in which a texture's θ is stored, and the reason.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ThetaReport {
    /// The texture.
    pub texture: String,
    /// The form.
    pub stored: StoredTheta,
    /// Number of nodes with more than 32 stages.
    pub long_nodes: usize,
    /// Largest errors of the compact form over all nodes; none if it was not asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_error: Option<ModelError>,
    /// The node that is farthest beyond the bounds of the compact form, if one is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forbidden_by: Option<NodeError>,
}

/// The error of a node in its compact form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeError {
    /// Speed of the node, mm/s.
    pub speed_mm_s: f32,
    /// Force of the node, N.
    pub force_n: f32,
    /// The error.
    pub error: ModelError,
}

impl NodeError {
    fn share(&self) -> f64 {
        self.error.share_of(LARGEST_ERROR)
    }
}

impl ThetaReport {
    /// The report of a texture whose compact form was not made.
    fn unjudged(texture: &str, long_nodes: usize) -> Self {
        Self {
            texture: texture.to_owned(),
            stored: StoredTheta::Fine,
            long_nodes,
            largest_error: None,
            forbidden_by: None,
        }
    }

    /// The report of a texture whose nodes have these errors in the compact form.
    fn judged(texture: &str, long_nodes: usize, errors: &[NodeError], choice: ThetaChoice) -> Self {
        let largest = errors.iter().map(|node| node.error);
        let worst = errors.iter().max_by(|a, b| a.share().total_cmp(&b.share()));
        let forbidden_by = worst.filter(|node| node.share() > 1.0).copied();
        Self {
            stored: match (choice, forbidden_by) {
                (ThetaChoice::Auto, Some(_)) => StoredTheta::Fine,
                _ => StoredTheta::Compact,
            },
            largest_error: largest.reduce(ModelError::max),
            forbidden_by,
            ..Self::unjudged(texture, long_nodes)
        }
    }
}

/// Lines that say what `reports` hold. Textures without more to say than others share a line.
pub fn summary(reports: &[ThetaReport]) -> Vec<String> {
    let mut short: Vec<&str> = Vec::new();
    let mut asked: Vec<&str> = Vec::new();
    let mut compact: Vec<&str> = Vec::new();
    let mut largest = ModelError::default();
    let mut others = Vec::new();
    for report in reports {
        let texture = report.texture.as_str();
        match (report.stored, report.largest_error, report.forbidden_by) {
            (_, None, _) if report.long_nodes == 0 => short.push(texture),
            (_, None, _) => asked.push(texture),
            (StoredTheta::Compact, Some(error), None) => {
                compact.push(texture);
                largest = largest.max(error);
            }
            (stored, Some(_), forbidding) => others.extend(forbidding.map(|node| {
                let bits = match stored {
                    StoredTheta::Fine => "16 bits after stage 32, because in 8 bits",
                    StoredTheta::Compact => "8 bits after stage 32, as asked:",
                };
                let (speed_mm_s, force_n) = (node.speed_mm_s, node.force_n);
                let error = Words(node.error);
                format!("{texture}: θ in {bits} the node at {speed_mm_s} mm/s, {force_n} N has errors of {error}")
            })),
        }
    }
    let alike = [
        (short, "no node has more than 32 stages of θ".to_owned()),
        (asked, "θ in 16 bits after stage 32, as asked".to_owned()),
        (
            compact,
            format!(
                "θ in 8 bits after stage 32, with errors of at most {}",
                Words(largest)
            ),
        ),
    ];
    let alike = alike
        .into_iter()
        .filter(|(textures, _)| !textures.is_empty());
    let alike = alike.map(|(textures, words)| format!("{}: {words}", textures.join(", ")));
    alike.chain(others).collect()
}

/// An error as a person reads it.
struct Words(ModelError);

impl fmt::Display for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(error) = self;
        write!(
            f,
            "{:.3} dB RMS, {:.3} dB in a third octave",
            error.rms_db, error.third_octave_db
        )?;
        if error.line_db > 0.0 {
            write!(f, ", {:.3} dB at a line", error.line_db)?;
        }
        Ok(())
    }
}

/// Length of the coefficients of a node of `order` in a library, bytes, with the fractions and the step of its θ. A
/// lattice's fractions are as many for each node of a texture, whose highest order is `highest_order`.
pub fn bytes_per_node(theta: StoredTheta, order: usize, highest_order: usize) -> usize {
    /// A step of a tail.
    const STEP_BYTES: usize = 2;
    let wide = order.min(limits::MAX_FINE_STAGES);
    match theta {
        StoredTheta::Compact => order + wide + highest_order.min(COMPACT_FINE_STAGES) + STEP_BYTES,
        StoredTheta::Fine => 2 * order + highest_order.min(limits::MAX_FINE_STAGES),
    }
}

#[cfg(test)]
mod tests;
