//! Summary of a texture: its grid, its orders and its nodes.

use host_tools::scene::parts;
use model_format::{
    CodebookSpec, ExcitationSpec, LEVEL_FRACTION_BITS, NodeFlags, PartKind, PartsSpec, Texture,
    level_amplitude,
};
use serde::Serialize;

use crate::cli::table::table;

/// Summary of a texture.
#[derive(Serialize)]
pub struct TextureSummary {
    name: String,
    structure: String,
    provenance: String,
    sample_rate_hz: u32,
    speeds_mm_s: Vec<f32>,
    forces_n: Vec<f32>,
    /// Lowest, middle and highest order.
    orders: [usize; 3],
    /// Lowest and highest RMS of nodes that are not silent, m/s².
    rms_m_s2: [f32; 2],
    silent_nodes: usize,
    filled_nodes: usize,
    doubtful_nodes: usize,
    /// Law of the level between nodes.
    level_law: String,
    /// Law of the level below the lowest speed and force.
    fade_law: String,
    /// Number of stages with 24 bits of θ.
    fine_stages: usize,
    /// Length of the coefficients of all nodes.
    coefficient_bytes: usize,
    /// The optional parts.
    parts: Vec<PartSummary>,
    /// The codebooks of the residual.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    codebooks: Vec<CodebookSummary>,
    /// The track of the level.
    #[serde(skip_serializing_if = "Option::is_none")]
    level_track: Option<TrackSummary>,
    /// Lines that are locked to place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    lines: Vec<LineSummary>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    nodes: Vec<NodeSummary>,
}

#[derive(Serialize)]
struct PartSummary {
    part: String,
    bytes: usize,
}

#[derive(Serialize)]
struct CodebookSummary {
    seconds: f64,
    /// Highest peak, standard deviations.
    peak: f32,
    /// Number of nodes that have it.
    nodes: usize,
}

#[derive(Serialize)]
struct TrackSummary {
    seconds: f64,
    step_s: f64,
    /// Lowest and highest level, dB.
    range_db: [f64; 2],
}

#[derive(Serialize)]
struct LineSummary {
    wavelength_mm: f32,
    phase_turns: f64,
    /// Lowest and highest amplitude of a node, m/s².
    amplitude_m_s2: [f32; 2],
    bytes: usize,
}

#[derive(Serialize)]
struct NodeSummary {
    speed_mm_s: f32,
    force_n: f32,
    order: usize,
    rms_m_s2: f32,
    prediction_error_rms_m_s2: f32,
    flags: Vec<&'static str>,
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
        let nodes = if with_nodes {
            node_summaries(texture)
        } else {
            Vec::new()
        };
        Self {
            name: texture.name().to_owned(),
            structure: texture.structure().to_string(),
            provenance: texture.provenance().to_string(),
            sample_rate_hz: texture.sample_rate_hz(),
            speeds_mm_s: texture.speed_axis().values().collect(),
            forces_n: texture.force_axis().values().collect(),
            orders: [
                orders[0],
                orders[orders.len() / 2],
                orders[orders.len() - 1],
            ],
            rms_m_s2: [
                loud()
                    .fold(f32::INFINITY, f32::min)
                    .min(loud().fold(0.0, f32::max)),
                loud().fold(0.0, f32::max),
            ],
            silent_nodes: count(NodeFlags::SILENT),
            filled_nodes: count(NodeFlags::INTERPOLATED) + count(NodeFlags::EXTRAPOLATED),
            doubtful_nodes: count(NodeFlags::DOUBTFUL),
            level_law: texture.level_law().to_string(),
            fade_law: texture.fade_law().to_string(),
            fine_stages: texture.fine_stages(),
            coefficient_bytes: texture.coefficient_bytes(),
            parts: texture
                .parts()
                .map(|(part, bytes)| PartSummary {
                    part: part.to_string(),
                    bytes,
                })
                .collect(),
            codebooks: codebook_summaries(texture),
            level_track: track_summary(texture),
            lines: line_summaries(texture),
            nodes,
        }
    }
}

fn codebook_summaries(texture: &Texture<'_>) -> Vec<CodebookSummary> {
    let rate_hz = f64::from(texture.sample_rate_hz());
    let PartsSpec { excitation, .. } = parts(texture);
    let of = |part: &ExcitationSpec| -> Vec<CodebookSummary> {
        let nodes = |number: usize| {
            part.of_nodes
                .iter()
                .filter(move |&&n| usize::from(n) == number)
        };
        let codebooks = part.codebooks.iter().enumerate();
        let summary = |(index, codebook): (usize, &CodebookSpec)| CodebookSummary {
            seconds: codebook.codes.len() as f64 / rate_hz,
            peak: codebook.peak,
            nodes: nodes(index + 1).count(),
        };
        codebooks.map(summary).collect()
    };
    excitation.as_ref().map(of).unwrap_or_default()
}

fn track_summary(texture: &Texture<'_>) -> Option<TrackSummary> {
    let track = parts(texture).modulation?;
    let step_s = f64::from(track.step_samples) / f64::from(texture.sample_rate_hz());
    let level_db = |entry: Option<&i8>| {
        let unit = f64::from(1u32 << LEVEL_FRACTION_BITS);
        20.0 * (f64::from(level_amplitude(*entry.expect("no track is empty"))) / unit).log10()
    };
    Some(TrackSummary {
        seconds: track.entries.len() as f64 * step_s,
        step_s,
        range_db: [
            level_db(track.entries.iter().min()),
            level_db(track.entries.iter().max()),
        ],
    })
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
            // All lines take as many.
            bytes: bytes / lines.len(),
        })
        .collect()
}

/// Table of the lines that are locked to place, one per row; none if no texture has any.
pub fn line_table(textures: &[TextureSummary]) -> Option<String> {
    let header = [
        "texture",
        "locked to place, mm",
        "amplitude m/s²",
        "phase, turns",
        "bytes",
    ];
    let of_texture = |texture: &TextureSummary| -> Vec<Vec<String>> {
        let lines = texture.lines.iter();
        let row = |line: &LineSummary| {
            let [low, high] = line.amplitude_m_s2;
            vec![
                texture.name.clone(),
                format!("{:.4}", line.wavelength_mm),
                format!("{low:.3} to {high:.3}"),
                format!("{:.3}", line.phase_turns),
                line.bytes.to_string(),
            ]
        };
        lines.map(row).collect()
    };
    let rows: Vec<Vec<String>> = textures.iter().flat_map(of_texture).collect();
    (!rows.is_empty()).then(|| table(&header, &rows))
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

/// Table with one line per texture.
pub fn texture_table(textures: &[TextureSummary]) -> String {
    let header = [
        "texture",
        "from",
        "structure",
        "grid",
        "mm/s",
        "N",
        "order",
        "RMS m/s²",
        "silent",
        "filled",
        "doubtful",
    ];
    let range = |axis: &[f32]| match axis {
        [only] => only.to_string(),
        [first, .., last] => format!("{first} to {last}"),
        [] => String::new(),
    };
    let rows: Vec<Vec<String>> = textures
        .iter()
        .map(|texture| {
            let [low, middle, high] = texture.orders;
            vec![
                texture.name.clone(),
                texture.provenance.clone(),
                texture.structure.clone(),
                format!("{} x {}", texture.speeds_mm_s.len(), texture.forces_n.len()),
                range(&texture.speeds_mm_s),
                range(&texture.forces_n),
                format!("{low} / {middle} / {high}"),
                format!("{:.3} to {:.3}", texture.rms_m_s2[0], texture.rms_m_s2[1]),
                texture.silent_nodes.to_string(),
                texture.filled_nodes.to_string(),
                texture.doubtful_nodes.to_string(),
            ]
        })
        .collect();
    table(&header, &rows)
}

/// Table of the laws of the level and of the bytes that each texture takes, with one line per texture.
pub fn storage_table(textures: &[TextureSummary]) -> String {
    let header = [
        "texture",
        "between nodes",
        "below the grid",
        "stages of 24-bit θ",
        "bytes of coefficients",
        "bytes of parts",
    ];
    let row = |texture: &TextureSummary| {
        let parts = texture.parts.iter();
        let parts: Vec<String> = parts
            .map(|part| format!("{} {}", part.part, part.bytes))
            .collect();
        vec![
            texture.name.clone(),
            texture.level_law.clone(),
            texture.fade_law.clone(),
            texture.fine_stages.to_string(),
            texture.coefficient_bytes.to_string(),
            if parts.is_empty() {
                "none".to_owned()
            } else {
                parts.join(", ")
            },
        ]
    };
    table(&header, &textures.iter().map(row).collect::<Vec<_>>())
}

/// Table of what excites the textures that have more than steady Gaussian noise; `None` if none has.
pub fn excitation_table(textures: &[TextureSummary]) -> Option<String> {
    let header = [
        "texture",
        "codebooks",
        "seconds",
        "peak",
        "nodes",
        "level track s",
        "step ms",
        "dB",
    ];
    let joined = |values: Vec<String>| {
        if values.is_empty() {
            "none".to_owned()
        } else {
            values.join(", ")
        }
    };
    let row = |texture: &TextureSummary| {
        let each = |of: &dyn Fn(&CodebookSummary) -> String| {
            joined(texture.codebooks.iter().map(of).collect())
        };
        let track = texture.level_track.as_ref();
        let of_track =
            |of: &dyn Fn(&TrackSummary) -> String| track.map_or_else(|| "none".to_owned(), of);
        vec![
            texture.name.clone(),
            texture.codebooks.len().to_string(),
            each(&|codebook| format!("{:.1}", codebook.seconds)),
            each(&|codebook| format!("{:.1}", codebook.peak)),
            each(&|codebook| codebook.nodes.to_string()),
            of_track(&|track| format!("{:.1}", track.seconds)),
            of_track(&|track| format!("{:.0}", 1000.0 * track.step_s)),
            of_track(&|track| format!("{:+.1} to {:+.1}", track.range_db[0], track.range_db[1])),
        ]
    };
    let fed =
        |texture: &&TextureSummary| !texture.codebooks.is_empty() || texture.level_track.is_some();
    let rows: Vec<Vec<String>> = textures.iter().filter(fed).map(row).collect();
    (!rows.is_empty()).then(|| table(&header, &rows))
}
