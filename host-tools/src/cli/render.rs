//! `stylus render` and `stylus export`: a stroke as a file, of the stylus's own samples or for other devices.

use std::path::PathBuf;

use stylus_signals::export::{Export, Format};
use stylus_signals::playing::render::Rendering;
use stylus_support::Result;

use super::files::{Overwrite, RenderedFile};
use super::input::{TextureAlong, positive};
use super::output::{print, warn};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: TextureAlong,
    #[command(flatten)]
    file: RenderedFile,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.file.check()?;
    arguments.source.with(|texture, motion, seconds, seed| {
        let source = format!("'{}' ({})", texture.name(), texture.provenance());
        let rendering = Rendering::new(texture, motion, seconds, seed)?;
        arguments.file.render(rendering, &source)
    })
}

#[derive(clap::Args)]
pub struct ExportArguments {
    #[command(flatten)]
    source: TextureAlong,
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

pub fn export(arguments: &ExportArguments) -> Result<()> {
    arguments.overwrite.file(&arguments.out)?;
    arguments.source.with(|texture, motion, seconds, seed| {
        let (format, full_scale) = (arguments.format, arguments.full_scale);
        let export = Export::new(texture, motion, (seconds, seed), format, full_scale)?;
        export.warnings.iter().for_each(|warning| warn(warning));
        export.write(&arguments.out)?;
        let out = arguments.out.display();
        print(&format!("{out}: {}", export.description))
    })
}
