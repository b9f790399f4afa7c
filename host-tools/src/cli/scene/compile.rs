//! `stylus scene compile`

use std::path::PathBuf;

use model_format::Library;
use model_format::scene::Scene;
use stylus_fit::scene::{CostReport, SceneFile, with_scenes};
use stylus_kernel::scene::cost;
use stylus_support::atomic_file;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::check::headline;
use crate::cli::files::Overwrite;
use crate::cli::output::{print, warn};
use stylus_fit::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    /// Scene files
    #[arg(required = true, value_name = "SCENE.toml")]
    scenes: Vec<PathBuf>,
    /// Library with their textures; its scenes are kept, except those of the same name
    #[arg(long, value_name = "LIB")]
    library: PathBuf,
    /// Library file to write, with the scenes; may be the same
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let out = &arguments.out;
    // The output may be the library itself, which is then replaced like any other file.
    (arguments.overwrite).file_in_place(out, &arguments.library)?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let mut scenes: Vec<Scene> = Vec::new();
    let mut lines = Vec::new();
    for path in &arguments.scenes {
        let compiled = SceneFile::read(path)?.compile(&library)?;
        let name = &compiled.scene.name;
        // A scene replaces that of the same name in the library, so one of two given ones would be lost.
        if let Some(other) = scenes.iter().position(|scene| scene.name == *name) {
            let other = arguments.scenes[other].display();
            let problem = format!("its scene is called '{name}', like that of {other}; rename one");
            return Err(Error::file(path, problem));
        }
        let report = CostReport::new(&compiled.scene, &compiled.surface_names, &library, cost::BUDGET)?;
        if !report.fits {
            warn(&format!(
                "{}: takes {} instructions per sample in the worst case, and the budget is {}; the stylus \
                 will refuse it",
                path.display(),
                report.worst_case.instructions,
                report.budget_instructions
            ));
        }
        lines.push(headline(&compiled));
        scenes.push(compiled.scene);
    }
    let written = with_scenes(&library, &scenes)?;
    // The stylus will decode these bytes, so they are decoded here before they are written.
    let checked = decode_library(out, &written).map(|l: Library<'_>| l.scene_count())?;
    atomic_file::write(out, &written)?;
    for line in lines {
        print(&line)?;
    }
    print(&format!(
        "-> {}: {}, {}, {}",
        out.display(),
        counted(library.len(), "texture"),
        counted(checked, "scene"),
        counted(written.len(), "byte")
    ))
}
