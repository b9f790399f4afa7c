//! `stylus inspect`

use std::path::PathBuf;

use host_tools::scene::{CostReport, surface_names};
use host_tools::support::error::Result;
use model_format::scene::{MotionOfScene, Scene};
use model_format::{Library, NodeFlags, Texture};
use serde::Serialize;
use stylus_kernel::scene::cost;

use super::table::table;
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// The library
    library: PathBuf,
    /// Print everything, node by node, as JSON
    #[arg(long)]
    json: bool,
}

/// A texture in a few words and numbers.
#[derive(Serialize)]
pub struct Summary {
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
    #[serde(skip_serializing_if = "Vec::is_empty")]
    nodes: Vec<NodeSummary>,
}

/// A scene in a few words and numbers.
#[derive(Serialize)]
struct SceneSummary {
    name: String,
    surfaces: Vec<String>,
    regions: usize,
    constant_motion: bool,
    /// What it calls for, but for textures.
    effects: Vec<&'static str>,
    /// Instructions of a tick at most, in the kernel's own model.
    worst_case_instructions: u32,
}

/// Everything in a library.
#[derive(Serialize)]
struct Content {
    textures: Vec<Summary>,
    scenes: Vec<SceneSummary>,
}

impl SceneSummary {
    fn of(scene: &Scene, library: &Library<'_>) -> Result<Self> {
        let names = surface_names(scene, library);
        let report = CostReport::new(scene, &names, library, cost::BUDGET)?;
        let effects = [
            (
                "transitions",
                scene.transition_mm > 0.0 && scene.regions.len() > 1,
            ),
            ("taps", scene.surfaces.iter().any(|s| s.tap.is_some())),
            (
                "stick-slip",
                scene.surfaces.iter().any(|s| s.stick_slip.is_some()),
            ),
            ("equaliser", !scene.equaliser.is_empty()),
        ];
        Ok(Self {
            name: scene.name.as_str().to_owned(),
            surfaces: names,
            regions: scene.regions.len(),
            constant_motion: scene.motion != MotionOfScene::Followed,
            effects: effects
                .into_iter()
                .filter_map(|(effect, is_there)| is_there.then_some(effect))
                .collect(),
            worst_case_instructions: report.worst_case.instructions,
        })
    }
}

/// A line a scene.
fn scene_table(scenes: &[SceneSummary]) -> String {
    let header = [
        "scene",
        "surfaces",
        "regions",
        "motion",
        "effects",
        "instructions at most",
    ];
    let rows: Vec<Vec<String>> = scenes
        .iter()
        .map(|scene| {
            let motion = if scene.constant_motion {
                "constant"
            } else {
                "the stylus's"
            };
            vec![
                scene.name.clone(),
                scene.surfaces.join(", "),
                scene.regions.to_string(),
                motion.to_owned(),
                scene.effects.join(", "),
                scene.worst_case_instructions.to_string(),
            ]
        })
        .collect();
    table(&header, &rows)
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

impl Summary {
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
            nodes,
        }
    }
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

/// A line a texture.
pub fn summary_table(textures: &[Summary]) -> String {
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

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let textures: Vec<Summary> = library
        .textures()
        .map(|texture| Summary::of(&texture, arguments.json))
        .collect();
    let scenes = library
        .scenes()
        .map(|scene| SceneSummary::of(&scene, &library))
        .collect::<Result<Vec<_>>>()?;
    if arguments.json {
        return print_json(&Content { textures, scenes });
    }
    print(&format!(
        "{}: {} texture(s), {} bytes, format version {}, checked\n",
        arguments.library.display(),
        library.len(),
        bytes.len(),
        model_format::FORMAT_VERSION
    ))?;
    print(&summary_table(&textures))?;
    print("\norder: lowest / middle / highest of the nodes")?;
    if scenes.is_empty() {
        return Ok(());
    }
    print(&format!("\n{}", scene_table(&scenes)))
}
