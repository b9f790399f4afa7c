//! `stylus scene compile`

use std::path::PathBuf;

use host_tools::scene::{CostReport, SceneFile, with_scenes};
use host_tools::support::atomic_file;
use host_tools::support::error::{Error, Result};
use model_format::Library;
use model_format::scene::Scene;
use stylus_kernel::scene::cost;

use super::check::headline;
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    /// Texts of scenes
    #[arg(required = true, value_name = "SCENE.toml")]
    scenes: Vec<PathBuf>,
    /// The library that has their textures; scenes that it has already stay, but for those of the same name
    #[arg(long, value_name = "LIB")]
    library: PathBuf,
    /// Library to write, with the scenes; may be the same
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let mut scenes: Vec<Scene> = Vec::new();
    let mut lines = Vec::new();
    for path in &arguments.scenes {
        let compiled = SceneFile::read(path)?.compile(&library)?;
        let name = &compiled.scene.name;
        if let Some(other) = scenes.iter().position(|scene| scene.name == *name) {
            let other = arguments.scenes[other].display();
            let problem = format!("its scene is called '{name}', as that of {other} is");
            return Err(Error::file(path, problem));
        }
        let report = CostReport::new(
            &compiled.scene,
            &compiled.surface_names,
            &library,
            cost::BUDGET,
        )?;
        if !report.fits {
            eprintln!(
                "warning: {}: takes {} instructions of a tick in the worst case, and the stylus has {}; it will refuse it",
                path.display(),
                report.worst_case.instructions,
                report.budget_instructions
            );
        }
        lines.push(headline(&compiled));
        scenes.push(compiled.scene);
    }
    let written = with_scenes(&library, &scenes)?;
    // What is uploaded is what the stylus will decode.
    let checked = decode_library(&arguments.out, &written).map(|l: Library<'_>| l.scene_count())?;
    atomic_file::write(&arguments.out, &written)?;
    for line in lines {
        print(&line)?;
    }
    print(&format!(
        "-> {}: {} texture(s), {checked} scene(s), {} bytes",
        arguments.out.display(),
        library.len(),
        written.len()
    ))
}
