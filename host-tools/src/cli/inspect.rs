//! `stylus inspect`

use std::path::PathBuf;

use host_tools::scene::SceneSummary;
use host_tools::support::error::Result;
use host_tools::texture::library::{decode_library, read_library};
use host_tools::texture::summary::{CodebookSummary, LineSummary, TextureSummary, TrackSummary};
use serde::Serialize;

use crate::cli::output::{print, print_json};
use crate::cli::table::{folded_table, table};

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to inspect
    library: PathBuf,
    /// Print all figures, node by node, as JSON
    #[arg(long)]
    json: bool,
}

/// The content of a library as JSON.
#[derive(Serialize)]
struct Content {
    textures: Vec<TextureSummary>,
    scenes: Vec<SceneSummary>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let textures: Vec<TextureSummary> = library
        .textures()
        .map(|texture| TextureSummary::of(&texture, arguments.json))
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
    print(&texture_table(&textures))?;
    print(
        "\norder: lowest / middle / highest of the nodes\n\
         Each is a normalised lattice: every stage only rotates, whatever the motion, so that none can become \
         unstable.\n",
    )?;
    print(&storage_table(&textures))?;
    if let Some(excitations) = excitation_table(&textures) {
        print(&format!("\n{excitations}"))?;
        print("\npeak: standard deviations; dB: lowest to highest level of the track\n")?;
    }
    if let Some(lines) = line_table(&textures) {
        print(&format!("\n{lines}"))?;
    }
    if scenes.is_empty() {
        return Ok(());
    }
    print(&format!("\n{}", scene_table(&scenes)))
}

/// Table of the lines that are locked to place, one per row; none if no texture has any.
fn line_table(textures: &[TextureSummary]) -> Option<String> {
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

/// Table with one line per texture.
pub fn texture_table(textures: &[TextureSummary]) -> String {
    let header = [
        "texture",
        "from",
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
    folded_table(&header, &rows, 1)
}

/// Table of the laws of the level and of the bytes that each texture takes, with one line per texture.
fn storage_table(textures: &[TextureSummary]) -> String {
    let header = [
        "texture",
        "between nodes",
        "below the grid",
        "stages of 24-bit θ",
        "of 8-bit θ",
        "within rad",
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
            texture.tail_stages.to_string(),
            if texture.tail_stages == 0 {
                String::new()
            } else {
                let [least, most] = texture.tail_range_rad;
                format!("{least:.3} to {most:.3}")
            },
            texture.coefficient_bytes.to_string(),
            if parts.is_empty() {
                "none".to_owned()
            } else {
                parts.join(", ")
            },
        ]
    };
    folded_table(&header, &textures.iter().map(row).collect::<Vec<_>>(), 1)
}

/// Table of what excites the textures that have more than steady Gaussian noise; `None` if none has.
fn excitation_table(textures: &[TextureSummary]) -> Option<String> {
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
    (!rows.is_empty()).then(|| folded_table(&header, &rows, 1))
}

/// Table with one line per scene.
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
    folded_table(&header, &rows, 1)
}
