//! `stylus inspect`

mod scene;
mod texture;

use std::path::PathBuf;

use host_tools::scene::SceneSummary;
use host_tools::support::error::Result;
use host_tools::texture::summary::TextureSummary;
use serde::Serialize;

use scene::scene_table;
pub use texture::texture_table;
use texture::{excitation_table, line_table, storage_table};

use crate::cli::output::{print, print_json};
use host_tools::texture::library::{decode_library, read_library};

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
