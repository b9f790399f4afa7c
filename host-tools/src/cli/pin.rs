//! Arguments of renderings at the stylus's pin.

use host_tools::playing::pin::{PinSummary, RATE_HZ, render_pin_wav, settings};
use host_tools::playing::render::Rendering;
use host_tools::support::error::Result;

use super::output::{print, warn};
use super::wav_file::WavFile;

/// The choice of the pin, and the settings of its stylus.
#[derive(clap::Args)]
pub struct PinArguments {
    /// Write what the stylus puts out at its pin instead: volts above mid-scale, 32-bit float, at 40 kHz
    #[arg(long, conflicts_with = "pcm16")]
    pin: bool,
    /// Setting of the stylus for --pin, such as output-gain=0.02 [default: the defaults]
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting, requires = "pin")]
    settings: Vec<(String, f32)>,
}

impl PinArguments {
    /// Returns true if the pin is to be rendered.
    pub fn is_asked(&self) -> bool {
        self.pin
    }

    /// Renders the pin into `wav`, and prints what is in the file and what the safety stages changed.
    ///
    /// # Errors
    /// A setting that is refused, and those of [`render_pin_wav`].
    pub fn render(&self, rendering: &mut Rendering<'_>, wav: &WavFile, source: &str) -> Result<()> {
        let changes = self.settings.iter();
        let settings = settings(changes.map(|(name, value)| (name.as_str(), *value)))?;
        let summary = render_pin_wav(rendering, &settings, wav.path())?;
        report(wav, source, summary)
    }
}

fn report(wav: &WavFile, source: &str, summary: PinSummary) -> Result<()> {
    print(&format!(
        "{}: {} codes of {source} at {RATE_HZ} Hz, as volts above mid-scale at the pin of a stylus",
        wav.path().display(),
        summary.codes,
    ))?;
    let limited = summary.limited;
    for (what, samples) in [
        ("the synthesis was at full scale", summary.saturations),
        ("the hard limit cut the output", limited.hard),
        ("the slew limit held the output back", limited.slew),
        ("the thermal limiter attenuated the output", limited.thermal),
    ] {
        if samples > 0 {
            warn(&format!("{what} in {samples} samples of the kernel"));
        }
    }
    Ok(())
}

/// Parses a setting's name and value.
fn setting(text: &str) -> std::result::Result<(String, f32), String> {
    let (name, value) = text.split_once('=').ok_or("must be NAME=VALUE")?;
    let value = value
        .trim()
        .parse()
        .map_err(|_| "the value must be a number")?;
    Ok((name.trim().to_owned(), value))
}
