//! Summary of a texture: its grid, its orders and its nodes.

use model_format::{
    CodebookSpec, ExcitationSpec, FINE_THETA_STEP_RAD, NodeFlags, PartKind, Provenance, Tail, TailSpec, Texture, Wander,
};
use serde::Serialize;

/// Summary of a texture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureSummary {
    /// Name.
    pub name: String,
    /// Provenance of its recordings.
    pub provenance: String,
    /// False if its levels are not in m/s², because nothing states the acceleration of its recordings' integers.
    pub level_is_known: bool,
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// Lowest, median and highest order.
    pub orders: [usize; 3],
    /// Lowest and highest RMS of nodes that are not silent, m/s²; 0 if all are.
    pub rms_m_s2: [f32; 2],
    /// Number of nodes that are silent.
    pub silent_nodes: usize,
    /// Number of nodes that were filled from neighbours.
    pub filled_nodes: usize,
    /// Number of nodes with a doubtful recording.
    pub doubtful_nodes: usize,
    /// Law of the level between nodes.
    pub level_law: String,
    /// Law of the level below the lowest speed and force.
    pub fade_law: String,
    /// Number of stages with 24 bits of θ.
    pub fine_stages: usize,
    /// Highest number of stages with 8 bits of θ.
    pub tail_stages: usize,
    /// Smallest and largest range of θ of a node's tail, rad; 0 without tails.
    pub tail_range_rad: [f64; 2],
    /// Length of the coefficients of all nodes, bytes.
    pub coefficient_bytes: usize,
    /// The optional parts.
    pub parts: Vec<PartSummary>,
    /// The codebooks of the residual.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub codebooks: Vec<CodebookSummary>,
    /// Lines that are tied to position.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<LineSummary>,
    /// The nodes, speed-major; empty if they were not asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<NodeSummary>,
}

/// An optional part of a texture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartSummary {
    /// Name of the part.
    pub part: String,
    /// Length, bytes.
    pub bytes: usize,
}

/// A codebook of the residual.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CodebookSummary {
    /// Duration, s.
    pub seconds: f64,
    /// Highest peak, standard deviations.
    pub peak: f32,
    /// Number of nodes that use it.
    pub nodes: usize,
}

/// A line that is tied to position.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LineSummary {
    /// Wavelength, mm.
    pub wavelength_mm: f32,
    /// Phase at the origin of the path, turns.
    pub phase_turns: f64,
    /// Lowest and highest amplitude of a node, m/s².
    pub amplitude_m_s2: [f32; 2],
    /// Wander of the line; `None` if it does not wander.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wander: Option<Wander>,
    /// Length, bytes.
    pub bytes: usize,
}

/// A node.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeSummary {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f32,
    /// Normal force, N.
    pub force_n: f32,
    /// Order of the model.
    pub order: usize,
    /// RMS of the output, m/s².
    pub rms_m_s2: f32,
    /// RMS of the prediction error, m/s².
    pub prediction_error_rms_m_s2: f32,
    /// Properties, as text.
    pub flags: Vec<&'static str>,
}

const FLAG_NAMES: [(NodeFlags, &str); 4] = [
    (NodeFlags::SILENT, "silent"),
    (NodeFlags::INTERPOLATED, "interpolated"),
    (NodeFlags::EXTRAPOLATED, "extrapolated"),
    (NodeFlags::DOUBTFUL, "doubtful"),
];

impl TextureSummary {
    /// Summarises `texture`, with every node if `with_nodes`.
    pub fn of(texture: &Texture<'_>, with_nodes: bool) -> Self {
        let mut orders: Vec<usize> = texture.nodes().map(|n| n.coefficients.order()).collect();
        orders.sort_unstable();
        let count = |flag: NodeFlags| texture.nodes().filter(|n| n.flags.contains(flag)).count();
        let loud = || {
            texture
                .nodes()
                .map(|node| node.output_power.sqrt())
                .filter(|rms| *rms > 0.0)
        };
        let nodes = with_nodes.then(|| node_summaries(texture));
        Self {
            name: texture.name().to_owned(),
            provenance: texture.provenance().to_string(),
            level_is_known: texture.provenance() != Provenance::Unscaled,
            sample_rate_hz: texture.sample_rate_hz(),
            speeds_mm_s: texture.speed_axis().values().collect(),
            forces_n: texture.force_axis().values().collect(),
            orders: [
                // A texture has at least one node.
                orders[0],
                orders[orders.len() / 2],
                orders[orders.len() - 1],
            ],
            rms_m_s2: [
                loud().fold(f32::INFINITY, f32::min).min(loud().fold(0.0, f32::max)),
                loud().fold(0.0, f32::max),
            ],
            silent_nodes: count(NodeFlags::SILENT),
            filled_nodes: count(NodeFlags::INTERPOLATED) + count(NodeFlags::EXTRAPOLATED),
            doubtful_nodes: count(NodeFlags::DOUBTFUL),
            level_law: texture.level_law().to_string(),
            fade_law: texture.fade_law().to_string(),
            fine_stages: texture.fine_stages(),
            tail_stages: tails(texture).map(|tail| tail.codes.len()).max().unwrap_or(0),
            tail_range_rad: tail_range_rad(texture),
            coefficient_bytes: texture.coefficient_bytes(),
            parts: texture
                .parts()
                .map(|(part, bytes)| PartSummary {
                    part: part.to_string(),
                    bytes,
                })
                .collect(),
            codebooks: codebook_summaries(texture),
            lines: line_summaries(texture),
            nodes: nodes.unwrap_or_default(),
        }
    }
}

/// Returns the tails of the nodes that have one.
fn tails<'a>(texture: &Texture<'a>) -> impl Iterator<Item = Tail<'a>> {
    texture
        .nodes()
        .map(|node| node.coefficients.tail)
        .filter(|tail| !tail.codes.is_empty())
}

fn tail_range_rad(texture: &Texture<'_>) -> [f64; 2] {
    let steps = || tails(texture).map(|tail| tail.step);
    let range = |step: Option<u16>| {
        let codes = f64::from(TailSpec::MAX_CODE) * f64::from(step.unwrap_or(0));
        codes * FINE_THETA_STEP_RAD
    };
    [range(steps().min()), range(steps().max())]
}

fn codebook_summaries(texture: &Texture<'_>) -> Vec<CodebookSummary> {
    let rate_hz = f64::from(texture.sample_rate_hz());
    let excitation: Option<ExcitationSpec> = texture.excitation().map(Into::into);
    let of = |part: &ExcitationSpec| -> Vec<CodebookSummary> {
        let nodes = |number: usize| part.of_nodes.iter().filter(move |&&n| usize::from(n) == number);
        let codebooks = part.codebooks.iter().enumerate();
        let summary = |(index, codebook): (usize, &CodebookSpec)| CodebookSummary {
            // Codes in blocks are fewer than their samples, which only the decoded texture counts.
            seconds: texture.excitation().map_or(0, |own| own.codebooks()[index].samples()) as f64 / rate_hz,
            peak: codebook.peak,
            nodes: nodes(index + 1).count(),
        };
        codebooks.map(summary).collect()
    };
    excitation.as_ref().map(of).unwrap_or_default()
}

fn line_summaries(texture: &Texture<'_>) -> Vec<LineSummary> {
    let Some(lines) = texture.lines() else {
        return Vec::new();
    };
    let bytes = texture
        .parts()
        .find(|(kind, _)| *kind == PartKind::Lines)
        .map_or(0, |(_, bytes)| bytes);
    lines
        .iter()
        .map(|line| LineSummary {
            wavelength_mm: line.wavelength_mm(),
            phase_turns: f64::from(line.phase()) / 65_536.0,
            amplitude_m_s2: [
                line.amplitudes().fold(f32::INFINITY, f32::min),
                line.amplitudes().fold(0.0, f32::max),
            ],
            wander: line.wander().and_then(|index| lines.wanders().nth(index)),
            // All lines take the same number of bytes.
            bytes: bytes / lines.len(),
        })
        .collect()
}

fn node_summaries(texture: &Texture<'_>) -> Vec<NodeSummary> {
    let speeds: Vec<f32> = texture.speed_axis().values().collect();
    let forces: Vec<f32> = texture.force_axis().values().collect();
    let places = speeds
        .iter()
        .flat_map(|&speed| forces.iter().map(move |&force| (speed, force)));
    texture
        .nodes()
        .zip(places)
        .map(|(node, (speed_mm_s, force_n))| NodeSummary {
            speed_mm_s,
            force_n,
            order: node.coefficients.order(),
            rms_m_s2: node.output_power.sqrt(),
            prediction_error_rms_m_s2: node.prediction_error_power.sqrt(),
            flags: FLAG_NAMES
                .iter()
                .filter(|(flag, _)| node.flags.contains(*flag))
                .map(|(_, name)| *name)
                .collect(),
        })
        .collect()
}
