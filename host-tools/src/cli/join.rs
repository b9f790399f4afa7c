//! `stylus join`

use std::path::PathBuf;

use stylus_fit::scene::joined;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_support::Result;
use stylus_support::atomic_file;
use stylus_support::number::counted;

use super::files::Overwrite;
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    /// Libraries, such as those of several fits with --strokes; all textures and scenes are kept as they are
    #[arg(required = true, num_args = 2.., value_name = "LIB")]
    libraries: Vec<PathBuf>,
    /// Library file to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let (paths, out) = (&arguments.libraries, &arguments.out);
    arguments.overwrite.file(out)?;
    let bytes: Vec<Vec<u8>> = paths.iter().map(|path| read_library(path)).collect::<Result<_>>()?;
    let mut libraries = Vec::new();
    for (path, bytes) in paths.iter().zip(&bytes) {
        libraries.push((path.as_path(), decode_library(path, bytes)?));
    }
    let written = joined(&libraries)?;
    // The stylus will decode these bytes, so they are decoded here before they are written.
    let library = decode_library(out, &written)?;
    atomic_file::write(out, &written)?;
    print(&format!(
        "-> {}: {}, {}, {}",
        out.display(),
        counted(library.len(), "texture"),
        counted(library.scene_count(), "scene"),
        counted(written.len(), "byte")
    ))
}
