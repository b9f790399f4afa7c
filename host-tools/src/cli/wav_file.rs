//! WAV file that a command renders into, with its line on standard output and its warnings.

use std::path::{Path, PathBuf};

use host_tools::playing::render::{RenderSummary, WavFormat};
use host_tools::support::error::Result;

use super::input::positive;
use super::output::{print, warn};
use super::overwrite::Overwrite;

/// The WAV file and its format.
#[derive(clap::Args)]
pub struct WavFile {
    /// WAV file to write: 32-bit float, m/s²
    #[arg(long, value_name = "WAV")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Write 16-bit samples with this full scale in m/s² instead, for listening
    #[arg(long, value_name = "FULL_SCALE", value_parser = positive)]
    pcm16: Option<f64>,
}

impl WavFile {
    /// Checks that the file can be written, by a command with these inputs.
    ///
    /// # Errors
    /// As [`Overwrite::file`].
    pub fn check(&self, inputs: &[PathBuf]) -> Result<()> {
        self.overwrite.file(&self.out, inputs)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.out
    }

    /// Format of the file.
    pub fn format(&self) -> WavFormat {
        self.pcm16
            .map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
                full_scale_m_s2,
            })
    }

    /// Prints the number of samples of `source` in the file, and warns of clipped samples and of samples at full scale.
    pub fn print(&self, source: &str, sample_rate_hz: u32, summary: RenderSummary) -> Result<()> {
        print(&format!(
            "{}: {} samples of {source} at {sample_rate_hz} Hz",
            self.out.display(),
            summary.wav.samples,
        ))?;
        if summary.wav.clipped > 0 {
            warn(&format!(
                "{} samples were clipped; give --pcm16 a larger full scale",
                summary.wav.clipped
            ));
        }
        if summary.saturations > 0 {
            warn(&format!(
                "the synthesis was at full scale in {} samples",
                summary.saturations
            ));
        }
        Ok(())
    }
}
