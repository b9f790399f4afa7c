//! The account of a texture's θ: the choice, and its reasons.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::choice::{LARGEST_ERROR, StoredTheta, ThetaChoice};
use crate::dsp::model_error::ModelError;

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
    pub(super) fn unjudged(texture: &str, long_nodes: usize) -> Self {
        Self {
            texture: texture.to_owned(),
            stored: StoredTheta::Fine,
            long_nodes,
            largest_error: None,
            forbidden_by: None,
        }
    }

    /// The report of a texture whose nodes have these errors in the compact form.
    pub(super) fn judged(
        texture: &str,
        long_nodes: usize,
        errors: &[NodeError],
        choice: ThetaChoice,
    ) -> Self {
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
