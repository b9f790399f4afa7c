//! `stylus render`

use std::path::PathBuf;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::render::Rendering;
use host_tools::playing::render::render_wav;
use host_tools::support::error::Result;

use super::files::PinArguments;
use super::input::{Along, warn_of_motion, warn_off_grid};
use crate::cli::files::WavFile;
use host_tools::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to render from
    library: PathBuf,
    /// Name of the texture
    #[arg(long, value_name = "NAME")]
    texture: String,
    #[command(flatten)]
    along: Along,
    #[command(flatten)]
    wav: WavFile,
    #[command(flatten)]
    pin: PinArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.wav.check()?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let texture = texture_named(&library, &arguments.texture)?;
    let name = format!("texture '{}'", texture.name());
    let (motion, seconds) = arguments.along.motion(&name, None)?;
    warn_of_motion(&motion);
    warn_off_grid(&motion, &texture);
    let source = format!("'{}' ({})", texture.name(), texture.provenance());
    if arguments.pin.is_asked()? {
        let mut rendering = Rendering::new(texture, &motion, seconds, arguments.along.seed)?;
        return arguments
            .pin
            .render(&mut rendering, &arguments.wav, &source);
    }
    let summary = render_wav(
        texture,
        &motion,
        seconds,
        arguments.along.seed,
        arguments.wav.path(),
        arguments.wav.format(),
    )?;
    arguments
        .wav
        .print(&source, texture.sample_rate_hz(), summary)
}
