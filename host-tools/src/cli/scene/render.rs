//! `stylus scene render`

use std::path::PathBuf;

use host_tools::playing::render::{WavFormat, write_wav};
use host_tools::scene::SceneRendering;
use host_tools::support::error::Result;

use super::source::{Along, Source, plan, provenance};
use crate::cli::input::positive;
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    along: Along,
    /// WAV file to write: 32-bit float, m/s²
    #[arg(long, value_name = "WAV")]
    out: PathBuf,
    /// Write 16-bit samples with this full scale in m/s² instead, for listening
    #[arg(long, value_name = "FULL_SCALE", value_parser = positive)]
    pcm16: Option<f64>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    let (motion, seconds) = arguments.along.motion(&compiled.scene)?;
    let plan = plan(&compiled, &library)?;
    let format = arguments
        .pcm16
        .map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
            full_scale_m_s2,
        });
    let mut rendering = SceneRendering::new(plan, &motion, seconds, arguments.along.seed)?;
    let rate_hz = rendering.sample_rate_hz();
    let summary = write_wav(&arguments.out, rate_hz, format, rendering.by_ref())?;
    print(&format!(
        "{}: {} samples of the scene '{}' ({}) at {rate_hz} Hz",
        arguments.out.display(),
        summary.samples,
        compiled.scene.name,
        provenance(&compiled, &library)
    ))?;
    if summary.clipped > 0 {
        eprintln!(
            "warning: {} samples were clipped; give --pcm16 a larger full scale",
            summary.clipped
        );
    }
    if rendering.saturations() > 0 {
        eprintln!(
            "warning: the synthesis was at full scale in {} samples",
            rendering.saturations()
        );
    }
    Ok(())
}
