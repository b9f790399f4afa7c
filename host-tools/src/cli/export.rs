//! `stylus export`

use std::path::PathBuf;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::export::{Export, Format};
use host_tools::support::error::Result;
use host_tools::texture::library::{decode_library, read_library};

use super::files::Overwrite;
use super::input::{Along, positive, warn_of_motion, warn_off_grid};
use super::output::{print, warn};

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to export from
    library: PathBuf,
    /// Name of the texture
    #[arg(long, value_name = "NAME")]
    texture: String,
    #[command(flatten)]
    along: Along,
    /// Format of the file
    #[arg(long, value_enum)]
    format: Format,
    /// Acceleration that the number 1 stands for, in m/s² [default: the largest of the file, 1 for WAV]
    #[arg(long, value_name = "M_S2", value_parser = positive)]
    full_scale: Option<f64>,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.overwrite.file(&arguments.out)?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let texture = texture_named(&library, &arguments.texture)?;
    let name = format!("texture '{}'", texture.name());
    let (motion, seconds) = arguments.along.motion(&name, None)?;
    warn_of_motion(&motion);
    warn_off_grid(&motion, &texture);
    let rendering = (seconds, arguments.along.seed);
    let (format, full_scale) = (arguments.format, arguments.full_scale);
    let export = Export::new(texture, &motion, rendering, format, full_scale)?;
    export.warnings.iter().for_each(|warning| warn(warning));
    export.write(&arguments.out)?;
    let out = arguments.out.display();
    print(&format!("{out}: {}", export.description))
}
