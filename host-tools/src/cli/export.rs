//! `stylus export`

use std::path::PathBuf;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::export::{Export, Format, Stroke};
use host_tools::support::error::Result;
use host_tools::texture::library::{decode_library, read_library};

use super::files::Overwrite;
use super::input::{Along, positive, warn_beyond, warn_if_silent};
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
    /// Acceleration that the number 1 stands for, in m/s² [default: the largest of the file]
    #[arg(long, value_name = "M_S2", value_parser = positive)]
    full_scale: Option<f64>,
    /// File to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let inputs = std::iter::once(&arguments.library).chain(arguments.along.file());
    let inputs: Vec<PathBuf> = inputs.cloned().collect();
    arguments.overwrite.file(&arguments.out, &inputs)?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let texture = texture_named(&library, &arguments.texture)?;
    let name = format!("texture '{}'", texture.name());
    let (motion, seconds) = arguments.along.motion(&name, None)?;
    warn_if_silent(&motion);
    warn_beyond(&motion, &texture);
    let stroke = Stroke::render(texture, &motion, seconds, arguments.along.seed)?;
    let export = Export::new(&stroke, arguments.format, arguments.full_scale)?;
    if let Some(loss) = export.loss() {
        warn(&loss);
    }
    export.write(&arguments.out)?;
    let out = arguments.out.display();
    print(&format!("{out}: {}", export.description()))?;
    let saturations = stroke.rendered().saturations;
    if saturations > 0 {
        warn(&format!(
            "the synthesis was at full scale in {saturations} samples"
        ));
    }
    Ok(())
}
