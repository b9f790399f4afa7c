//! `stylus render`

use std::path::PathBuf;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::{WavFormat, render_wav};
use host_tools::support::error::Result;
use model_format::{MillimetresPerSecond, Newton};

use super::input::{not_negative, positive};
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to render from
    library: PathBuf,
    /// Name of the texture
    #[arg(long, value_name = "NAME")]
    texture: String,
    /// Tangential speed, in mm/s
    #[arg(
        long,
        value_name = "MM_S",
        value_parser = not_negative,
        requires = "force",
        required_unless_present = "motion"
    )]
    speed: Option<f64>,
    /// Normal force, in newtons
    #[arg(long, value_name = "N", value_parser = not_negative, requires = "speed", required_unless_present = "motion")]
    force: Option<f64>,
    /// Motion instead: CSV with time_s, speed_mm_s, force_n
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<PathBuf>,
    /// Duration, in seconds [default: the motion's]
    #[arg(long, value_name = "S", value_parser = positive, required_unless_present = "motion")]
    seconds: Option<f64>,
    /// WAV file to write: 32-bit float, m/s²
    #[arg(long, value_name = "WAV")]
    out: PathBuf,
    /// Write 16-bit samples with this full scale in m/s² instead, for listening
    #[arg(long, value_name = "FULL_SCALE", value_parser = positive)]
    pcm16: Option<f64>,
    /// Seed of the noise: the same seed gives the same samples
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let texture = texture_named(&library, &arguments.texture)?;
    let motion = match &arguments.motion {
        Some(path) => MotionPath::from_csv(path)?,
        None => MotionPath::constant(
            MillimetresPerSecond(arguments.speed.unwrap_or(0.0) as f32),
            Newton(arguments.force.unwrap_or(0.0) as f32),
        )?,
    };
    let seconds = arguments.seconds.unwrap_or_else(|| motion.duration_s());
    let format = arguments
        .pcm16
        .map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
            full_scale_m_s2,
        });
    let summary = render_wav(
        texture,
        &motion,
        seconds,
        arguments.seed,
        &arguments.out,
        format,
    )?;
    print(&format!(
        "{}: {} samples of '{}' ({}) at {} Hz",
        arguments.out.display(),
        summary.wav.samples,
        texture.name(),
        texture.provenance(),
        texture.sample_rate_hz()
    ))?;
    if summary.wav.clipped > 0 {
        eprintln!(
            "warning: {} samples were clipped; give --pcm16 a larger full scale",
            summary.wav.clipped
        );
    }
    if summary.saturations > 0 {
        eprintln!(
            "warning: the synthesis was at full scale in {} samples",
            summary.saturations
        );
    }
    Ok(())
}
