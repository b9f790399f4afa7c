//! `stylus inspect`

use std::path::PathBuf;

use model_format::Wander;
use serde::Serialize;
use stylus_fit::scene::SceneSummary;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_fit::texture::summary::{CodebookSummary, LineSummary, TextureSummary};
use stylus_support::Result;
use stylus_support::number::counted;
use stylus_support::number::{fixed, significant};

use crate::cli::output::{print, print_json};
use crate::cli::table::{headed, table};

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
        // Only the JSON lists figures node by node.
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
        "{}: {}, {}, format version {}, checked\n",
        arguments.library.display(),
        counted(library.len(), "texture"),
        counted(bytes.len(), "byte"),
        model_format::FORMAT_VERSION
    ))?;
    print(&texture_table(&textures))?;
    print(
        "\nEach model is a normalised lattice: every stage only rotates, whatever the motion, so that none can become \
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

/// Returns a table of the lines that are tied to position, one per row; `None` if no texture has any.
fn line_table(textures: &[TextureSummary]) -> Option<String> {
    let of_texture = |texture: &TextureSummary| -> Vec<_> {
        let wander = |line: &LineSummary, of: fn(Wander) -> f32| {
            line.wander
                .map_or_else(|| "none".to_owned(), |wander| figure(of(wander)))
        };
        let row = |line: &LineSummary| {
            let [low, high] = line.amplitude_m_s2;
            [
                ("texture", texture.name.clone()),
                ("wavelength, mm", format!("{:.4}", line.wavelength_mm)),
                (
                    "amplitude m/s²",
                    level(texture, format!("{} to {}", figure(low), figure(high))),
                ),
                ("phase, turns", format!("{:.3}", line.phase_turns)),
                ("wander's RMS, mm", wander(line, |wander| wander.rms_mm)),
                ("correlated over, mm", wander(line, |wander| wander.correlation_mm)),
                ("bytes", line.bytes.to_string()),
            ]
        };
        texture.lines.iter().map(row).collect()
    };
    let (header, rows) = headed(textures.iter().flat_map(of_texture));
    (!rows.is_empty()).then(|| table(&header, &rows))
}

/// Returns `shown`, a level of `texture`, unless no level of it is known.
fn level(texture: &TextureSummary, shown: String) -> String {
    if texture.level_is_known {
        shown
    } else {
        "not known".to_owned()
    }
}

/// Formats a level with three significant digits, but with at most three decimals.
fn rounded(level: f64) -> String {
    // A silent texture has level 0, whose logarithm is infinite. The table has room for three decimals.
    let decimals = (2.0 - level.max(0.01).log10().floor()).clamp(0.0, 3.0) as usize;
    fixed(level, decimals)
}

/// Formats a number with at most four significant digits.
fn figure(value: f32) -> String {
    significant(f64::from(value)).to_string()
}

/// Returns a table with one row per texture.
pub fn texture_table(textures: &[TextureSummary]) -> String {
    let range = |axis: &[f32]| match axis {
        [only] => figure(*only),
        [first, .., last] => format!("{} to {}", figure(*first), figure(*last)),
        [] => String::new(),
    };
    let (header, rows) = headed(textures.iter().map(|texture| {
        let [low, middle, high] = texture.orders;
        let [least, most] = texture.rms_m_s2;
        let (speeds, forces) = (&texture.speeds_mm_s, &texture.forces_n);
        [
            ("texture", texture.name.clone()),
            ("from", texture.provenance.clone()),
            ("grid", format!("{} x {}", speeds.len(), forces.len())),
            ("mm/s", range(speeds)),
            ("N", range(forces)),
            ("order min, median, max", format!("{low}/{middle}/{high}")),
            (
                "noise RMS m/s²",
                level(
                    texture,
                    format!("{} to {}", rounded(least.into()), rounded(most.into())),
                ),
            ),
            ("silent", texture.silent_nodes.to_string()),
            ("filled", texture.filled_nodes.to_string()),
            ("doubtful", texture.doubtful_nodes.to_string()),
        ]
    }));
    table(&header, &rows)
}

/// Returns `values` with commas between them, or "none" without values.
fn joined(values: &[String]) -> String {
    if values.is_empty() {
        "none".to_owned()
    } else {
        values.join(", ")
    }
}

/// Returns a table with one row per texture: the laws of the level, and the bytes that the texture takes.
fn storage_table(textures: &[TextureSummary]) -> String {
    let (header, rows) = headed(textures.iter().map(|texture| {
        let parts = texture.parts.iter().map(|part| format!("{} {}", part.part, part.bytes));
        let [least, most] = texture.tail_range_rad;
        let tail = (texture.tail_stages > 0).then(|| format!("{least:.3} to {most:.3}"));
        [
            ("texture", texture.name.clone()),
            ("rate, Hz", texture.sample_rate_hz.to_string()),
            ("between nodes", texture.level_law.clone()),
            ("below the grid", texture.fade_law.clone()),
            ("stages of 24-bit θ", texture.fine_stages.to_string()),
            ("of 8-bit θ", texture.tail_stages.to_string()),
            ("within rad", tail.unwrap_or_default()),
            ("bytes of coefficients", texture.coefficient_bytes.to_string()),
            ("bytes of parts", joined(&parts.collect::<Vec<_>>())),
        ]
    }));
    table(&header, &rows)
}

/// Returns a table of the excitation of textures with codebooks; `None` if no texture has any.
fn excitation_table(textures: &[TextureSummary]) -> Option<String> {
    let row = |texture: &TextureSummary| {
        let each =
            |of: &dyn Fn(&CodebookSummary) -> String| joined(&texture.codebooks.iter().map(of).collect::<Vec<_>>());
        [
            ("texture", texture.name.clone()),
            ("codebooks", texture.codebooks.len().to_string()),
            ("seconds", each(&|codebook| format!("{:.1}", codebook.seconds))),
            ("peak", each(&|codebook| format!("{:.1}", codebook.peak))),
            ("nodes", each(&|codebook| codebook.nodes.to_string())),
        ]
    };
    let fed = |texture: &&TextureSummary| !texture.codebooks.is_empty();
    let (header, rows) = headed(textures.iter().filter(fed).map(row));
    (!rows.is_empty()).then(|| table(&header, &rows))
}

/// Returns a table with one row per scene.
fn scene_table(scenes: &[SceneSummary]) -> String {
    let (header, rows) = headed(scenes.iter().map(|scene| {
        let motion = if scene.constant_motion {
            "constant"
        } else {
            "the stylus's"
        };
        [
            ("scene", scene.name.clone()),
            ("surfaces", scene.surfaces.join(", ")),
            ("regions", scene.regions.to_string()),
            ("motion", motion.to_owned()),
            ("effects", scene.effects.join(", ")),
            ("instructions at most", scene.worst_case_instructions.to_string()),
        ]
    }));
    table(&header, &rows)
}
