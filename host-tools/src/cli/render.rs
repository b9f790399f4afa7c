//! `stylus render`

use std::path::PathBuf;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::motion::MotionPath;
#[cfg(feature = "device")]
use host_tools::playing::render::Rendering;
use host_tools::playing::render::render_wav;
use host_tools::support::error::Result;
use model_format::{MillimetresPerSecond, Newton};

#[cfg(feature = "device")]
use super::files::PinArguments;
use super::input::{force, positive, speed, warn_if_silent};
use crate::cli::files::WavFile;
use host_tools::texture::library::{decode_library, read_library};

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
        value_parser = speed,
        allow_negative_numbers = true,
        requires = "force",
        required_unless_present = "motion"
    )]
    speed: Option<f64>,
    /// Normal force, in newtons
    #[arg(
        long,
        value_name = "N",
        value_parser = force,
        allow_negative_numbers = true,
        requires = "speed",
        required_unless_present = "motion"
    )]
    force: Option<f64>,
    /// Motion instead: CSV with time_s, speed_mm_s, force_n
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<PathBuf>,
    /// Duration, in seconds [default: the motion's]
    #[arg(long, value_name = "S", value_parser = positive, required_unless_present = "motion")]
    seconds: Option<f64>,
    #[command(flatten)]
    wav: WavFile,
    #[cfg(feature = "device")]
    #[command(flatten)]
    pin: PinArguments,
    /// Seed of the noise: the same seed gives the same samples
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let inputs = std::iter::once(&arguments.library).chain(&arguments.motion);
    arguments.wav.check(&inputs.cloned().collect::<Vec<_>>())?;
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
    let seconds = match (arguments.seconds, &arguments.motion) {
        (Some(seconds), _) => seconds,
        (None, Some(path)) => motion.end_s(path)?,
        (None, None) => motion.duration_s(),
    };
    warn_if_silent(&motion);
    let source = format!("'{}' ({})", texture.name(), texture.provenance());
    #[cfg(feature = "device")]
    if arguments.pin.is_asked() {
        let mut rendering = Rendering::new(texture, &motion, seconds, arguments.seed)?;
        return arguments
            .pin
            .render(&mut rendering, &arguments.wav, &source);
    }
    let summary = render_wav(
        texture,
        &motion,
        seconds,
        arguments.seed,
        arguments.wav.path(),
        arguments.wav.format(),
    )?;
    arguments
        .wav
        .print(&source, texture.sample_rate_hz(), summary)
}
