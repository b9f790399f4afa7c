//! `stylus simulate-rig`

use std::path::PathBuf;

use crate::cli::output::print;
use host_tools::rig::{self, Scene};
use host_tools::support::error::{Error, Result};

#[derive(clap::Args)]
pub struct Arguments {
    /// Scene to simulate [default: the paper's protocol on paper, organza, vinyl and denim]
    #[arg(long, value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Folder to write the recordings to
    #[arg(long, value_name = "DIR", required_unless_present = "print_scene")]
    out: Option<PathBuf>,
    /// Seed of everything that is random: the same seed gives the same recordings
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print the scene, to start one's own from, and do nothing
    #[arg(long)]
    print_scene: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let scene = match &arguments.scene {
        None => Scene::paper(),
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
            Scene::from_toml(path, &text)?
        }
    };
    let Some(out) = arguments.out.as_deref().filter(|_| !arguments.print_scene) else {
        return print(scene.text().trim_end());
    };
    let summary = rig::simulate_to_folder(&scene, arguments.seed, out)?;
    print(summary.to_string().trim_end())?;
    print(&format!("-> {}", out.display()))
}
