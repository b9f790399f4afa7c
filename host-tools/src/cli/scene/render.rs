//! `stylus scene render`

use host_tools::playing::render::{RenderSummary, Rendering, write_wav};
use host_tools::support::error::Result;

use super::source::{Along, Source};
#[cfg(feature = "device")]
use crate::cli::pin::PinArguments;
use crate::cli::wav_file::WavFile;
use host_tools::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    along: Along,
    #[command(flatten)]
    wav: WavFile,
    #[cfg(feature = "device")]
    #[command(flatten)]
    pin: PinArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    (arguments.wav).check(&arguments.source.inputs(&arguments.along))?;
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    let (motion, seconds) = arguments.along.motion(&compiled.scene)?;
    let plan = compiled.plan(&library)?;
    let mut rendering = Rendering::of_plan(plan, &motion, seconds, arguments.along.seed)?;
    let source = format!(
        "the scene '{}' ({})",
        compiled.scene.name,
        compiled.provenance(&library)
    );
    #[cfg(feature = "device")]
    if arguments.pin.is_asked() {
        return arguments
            .pin
            .render(&mut rendering, &arguments.wav, &source);
    }
    let rate_hz = rendering.sample_rate_hz();
    let wav = &arguments.wav;
    let written = write_wav(wav.path(), rate_hz, wav.format(), rendering.by_ref())?;
    let summary = RenderSummary {
        wav: written,
        saturations: rendering.saturations(),
    };
    wav.print(&source, rate_hz, summary)
}
