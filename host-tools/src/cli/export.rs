//! `stylus export`

use std::path::PathBuf;

use stylus_signals::export::{Export, Format};
use stylus_support::Result;

use super::files::Overwrite;
use super::input::{TextureAlong, positive};
use super::output::{print, warn};

#[derive(clap::Args)]
pub struct Arguments {
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

pub fn run(arguments: &Arguments) -> Result<()> {
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
