//! A stroke as a file for other devices: MPEG haptics (ISO/IEC 23090-31), Meta's `.haptic`, Apple's AHAP, or WAV.
//!
//! Invariant: a file contains what [`playing`](crate::playing) renders, as far as its format allows. What a format
//! cannot represent is known before anything is written.

mod envelope;
mod hjif;
#[cfg(test)]
mod tests;
mod wavelet_stream;

use std::path::Path;

use model_format::Texture;
use serde_json::Value;
use stylus_dsp::spectrum::{BAND_COUNT, BAND_LABELS_HZ, PowerSpectrum, third_octave_hz};
use stylus_support::float_wav::float_wav;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, progress};

use crate::playing::motion::MotionPath;
use crate::playing::render::{Rendered, Rendering};
use crate::recording::resample;
use envelope::{Envelope, RANGE_HZ};

/// Longest stroke in a file, s. It limits the memory for samples and text to a few hundred megabytes.
pub const MAX_SECONDS: f64 = 600.0;

/// Format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// MPEG haptics, ISO/IEC 23090-31, as JSON: wavelets, up to 4 kHz
    Hjif,
    /// Meta's .haptic: one tone of varying amplitude and frequency
    Haptic,
    /// Apple's AHAP: one tone of varying intensity and sharpness
    Ahap,
    /// WAV: 32-bit float
    Wav,
}

/// A stroke in a file's format.
#[derive(Debug)]
pub struct Export {
    bytes: Vec<u8>,
    /// Description of the content, which every file except WAV contains.
    pub description: String,
    /// Sentences on the properties of the stroke that the file cannot represent, with figures, and on samples at the
    /// kernel's full scale.
    pub warnings: Vec<String>,
}

impl Export {
    /// Renders `seconds` of `texture` along `motion`, with a progress bar, and converts the result to a file. The
    /// number 1 in the file stands for `full_scale_m_s2`. If it is not given, the number 1 stands for the largest
    /// acceleration in the file, or for 1 m/s² in WAV.
    ///
    /// # Errors
    /// A duration above [`MAX_SECONDS`], a silent stroke, a full scale that is too small, and the errors of
    /// [`Rendering::new`].
    pub fn new(
        texture: Texture<'_>,
        motion: &MotionPath,
        (seconds, seed): (f64, u64),
        format: Format,
        full_scale_m_s2: Option<f64>,
    ) -> Result<Self> {
        let (name, origin) = (texture.name(), texture.provenance());
        let refused = |problem: String| Err(Error::Request(format!("texture '{name}': {problem}")));
        if seconds > MAX_SECONDS {
            return refused(format!(
                "a file holds at most {MAX_SECONDS} s, not {seconds}: give fewer --seconds, or use stylus render"
            ));
        }
        let rendered = rendered(texture, motion, seconds, seed)?;
        let rate_hz = f64::from(rendered.sample_rate_hz);
        let mut samples = rendered.accelerations_m_s2();
        let envelope = Envelope::of(&samples, rate_hz);
        let mut warnings = Vec::from_iter(loss(&samples, rate_hz, &envelope, format));
        let count = rendered.saturations;
        if count > 0 {
            warnings.push(format!("the synthesis was at full scale in {count} samples"));
        }
        // The conversion may raise peaks, so the largest sample is sought after it.
        if format == Format::Hjif {
            samples = resample(&[samples], rendered.sample_rate_hz, hjif::RATE_HZ).remove(0);
        }
        let largest = match format {
            // These files hold the tone instead of the samples.
            Format::Haptic | Format::Ahap => largest(envelope.amplitudes_m_s2()),
            Format::Hjif | Format::Wav => largest(samples.iter().copied()),
        };
        let own = if format == Format::Wav { 1.0 } else { largest };
        let scale = full_scale_m_s2.unwrap_or(own);
        if largest <= 0.0 {
            return refused("the stroke is silent: give speeds and forces above zero".to_owned());
        }
        // Floats in a WAV file may exceed 1.
        if scale < largest && format != Format::Wav {
            return refused(format!(
                "the file reaches {largest:.4} m/s², more than {scale}: raise --full-scale, or leave it out"
            ));
        }
        let version = env!("CARGO_PKG_VERSION");
        let description = format!(
            "'{name}' ({origin}), a stroke of {seconds} s, seed {seed}, by stylus {version}. 1.0 is {scale:.6} m/s²."
        );
        samples.iter_mut().for_each(|sample| *sample /= scale);
        let text = |json: Value| json.to_string().into_bytes();
        let bytes = match format {
            Format::Hjif => text(hjif::file(&samples, &description)),
            Format::Haptic => text(envelope.haptic(scale, &description)),
            Format::Ahap => text(envelope.ahap(scale, &description)),
            Format::Wav => float_wav(1, rendered.sample_rate_hz, samples).expect("ten minutes fit"),
        };
        Ok(Self {
            bytes,
            description,
            warnings,
        })
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, &self.bytes)
    }
}

/// Renders `seconds` of `texture` along `motion`, with a progress bar.
fn rendered(texture: Texture<'_>, motion: &MotionPath, seconds: f64, seed: u64) -> Result<Rendered> {
    let rendering = Rendering::new(texture, motion, seconds, seed)?;
    let bar = progress::bar(rendering.len() as u64, "rendering");
    let rendered = rendering.rendered(|samples| bar.wrap_iter(samples).collect());
    bar.finish_and_clear();
    Ok(rendered)
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |most, value| most.max(value.abs()))
}

/// Returns what `format` loses of a stroke, with levels in dB; `None` if it loses nothing.
fn loss(stroke: &[f64], rate_hz: f64, envelope: &Envelope, format: Format) -> Option<String> {
    let spectrum = PowerSpectrum::welch(stroke, rate_hz);
    let limit_hz = f64::from(hjif::RATE_HZ) / 2.0;
    let decibels = |part: f64, whole: f64| format!("{:+.1} dB", 10.0 * (part / whole).log10());
    match format {
        Format::Haptic | Format::Ahap => {
            let tone = PowerSpectrum::welch(&envelope.tone(rate_hz), rate_hz);
            // An octave is three third octaves. The octaves from 31.5 Hz to 1 kHz are centred on every third of these.
            let levels = (2..BAND_COUNT).step_by(3).map(|band| {
                let edge_hz = |bands: f64| third_octave_hz(band as f64 + bands);
                let power = |of: &PowerSpectrum| of.power_between(edge_hz(-1.5), edge_hz(1.5));
                let level = decibels(power(&tone), power(&spectrum));
                format!("{} Hz {level}", BAND_LABELS_HZ[band])
            });
            let ((low_hz, high_hz), levels) = (RANGE_HZ, levels.collect::<Vec<_>>().join(", "));
            Some(format!(
                "this format holds no noise: it holds one tone from {low_hz} to {high_hz} Hz, of the stroke's power \
                 and mean frequency every 20 ms. Its octaves against the stroke's: {levels}"
            ))
        }
        Format::Hjif if rate_hz > 2.0 * limit_hz => {
            let [lost, all] = [limit_hz, 0.0].map(|from| spectrum.power_between(from, rate_hz));
            let lost = decibels(lost, all);
            Some(format!("hjif holds nothing above {limit_hz} Hz: {lost} of the power"))
        }
        Format::Hjif | Format::Wav => None,
    }
}
