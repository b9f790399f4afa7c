//! A stroke as a file for other devices: MPEG haptics (ISO/IEC 23090-31), Meta's `.haptic`, Apple's AHAP, or WAV.
//!
//! Invariant: a file holds what [`playing`](crate::playing) renders, as far as its format can. What a format cannot
//! hold is known before anything is written.

mod arithmetic_coder;
mod envelope;
mod hjif;
mod set_partitioning;
mod stroke;
mod tone_files;
mod wavelet;

use std::path::Path;

use serde_json::Value;

use crate::dsp::spectrum::PowerSpectrum;
use crate::playing::render::{WavFormat, write_wav};
use crate::support::atomic_file;
use crate::support::error::{Error, Result};
use envelope::{Envelope, RANGE_HZ};
pub use stroke::{MAX_SECONDS, Stroke};

/// Format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// MPEG haptics, ISO/IEC 23090-31, as JSON: wavelets up to 4 kHz
    Hjif,
    /// Meta's .haptic: one tone of varying amplitude and frequency
    Haptic,
    /// Apple's AHAP: one tone of varying intensity and sharpness
    Ahap,
    /// WAV: the samples, 32-bit float, in m/s²
    Wav,
}

/// A stroke, made ready for a file of one format.
#[derive(Debug)]
pub struct Export<'a> {
    stroke: &'a Stroke,
    content: Content,
    full_scale_m_s2: f64,
}

/// What a file will hold, in m/s².
#[derive(Debug)]
enum Content {
    /// Samples at [`hjif::RATE_HZ`].
    Wavelets(Vec<f64>),
    Haptic(Envelope),
    Ahap(Envelope),
    Samples,
}

impl<'a> Export<'a> {
    /// Makes `stroke` ready for `format`. The formats hold numbers up to 1, which stand for `full_scale_m_s2`, or without
    /// one for the largest number that the file would hold; WAV holds m/s².
    ///
    /// # Errors
    /// A silent stroke, a full scale below the largest number, or one for WAV.
    pub fn new(stroke: &'a Stroke, format: Format, full_scale_m_s2: Option<f64>) -> Result<Self> {
        let envelope = || Envelope::of(&stroke.accelerations(), stroke.rate_hz());
        let content = match format {
            Format::Hjif => Content::Wavelets(hjif::resampled(stroke)?),
            Format::Haptic => Content::Haptic(envelope()),
            Format::Ahap => Content::Ahap(envelope()),
            Format::Wav if full_scale_m_s2.is_some() => {
                let problem = "a WAV file holds m/s² and takes no full scale: leave --full-scale out, or use render \
                               --pcm16";
                return Err(Error::Request(problem.to_owned()));
            }
            Format::Wav => Content::Samples,
        };
        let largest = match &content {
            Content::Wavelets(samples) => largest(samples.iter().copied()),
            Content::Haptic(envelope) | Content::Ahap(envelope) => {
                largest(envelope.points.iter().map(|point| point.amplitude_m_s2))
            }
            Content::Samples => 1.0,
        };
        if largest <= 0.0 {
            return Err(Error::Request(format!(
                "{} is silent: give a motion with a speed and a force above zero",
                stroke.name()
            )));
        }
        let full_scale_m_s2 = full_scale_m_s2.unwrap_or(largest);
        if full_scale_m_s2 < largest {
            return Err(Error::Request(format!(
                "{} reaches {largest:.4} m/s² in this format, above the full scale of {full_scale_m_s2} m/s²: give \
                 --full-scale at least that, or leave it out",
                stroke.name()
            )));
        }
        Ok(Self {
            stroke,
            content,
            full_scale_m_s2,
        })
    }

    /// Returns what the file cannot hold of the stroke, with figures; `None` if it holds all.
    pub fn loss(&self) -> Option<String> {
        let stroke = self.stroke;
        let samples = stroke.accelerations();
        let spectrum = PowerSpectrum::welch(&samples, stroke.rate_hz());
        match &self.content {
            Content::Samples => None,
            Content::Wavelets(_) => {
                let (limit, all) = (f64::from(hjif::RATE_HZ) / 2.0, stroke.rate_hz() / 2.0);
                let share = spectrum.power_between(limit, all) / spectrum.power_between(0.0, all);
                (all > limit).then(|| {
                    format!(
                        "hjif holds nothing above {limit} Hz, which is {:.1} dB of the stroke's power",
                        10.0 * share.log10()
                    )
                })
            }
            Content::Haptic(envelope) | Content::Ahap(envelope) => {
                let tone = envelope.tone(samples.len(), stroke.rate_hz());
                let tone = PowerSpectrum::welch(&tone, stroke.rate_hz());
                let (low_hz, high_hz) = RANGE_HZ;
                Some(format!(
                    "this format holds no noise and no line: it holds one tone between {low_hz} and {high_hz} Hz, with \
                     the power and the mean frequency of the stroke every 20 ms. Octaves of that tone against the \
                     stroke: {}",
                    octaves(&spectrum, &tone)
                ))
            }
        }
    }

    /// Returns the sentences that the file says of itself.
    pub fn description(&self) -> String {
        match self.content {
            Content::Samples => self.stroke.name().to_owned(),
            _ => format!(
                "{}. 1.0 is {:.6} m/s².",
                self.stroke.name(),
                self.full_scale_m_s2
            ),
        }
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let json = match &self.content {
            Content::Wavelets(samples) => {
                hjif::file(samples, self.full_scale_m_s2, &self.description())
            }
            Content::Haptic(envelope) => {
                tone_files::haptic(envelope, self.full_scale_m_s2, &self.description())
            }
            Content::Ahap(envelope) => {
                tone_files::ahap(envelope, self.full_scale_m_s2, &self.description())
            }
            Content::Samples => return self.write_wav(path),
        };
        atomic_file::write(path, &text_of(&json))
    }

    fn write_wav(&self, path: &Path) -> Result<()> {
        let samples = self.stroke.rendered().samples.iter().copied();
        let rate = self.stroke.rendered().sample_rate_hz;
        write_wav(path, rate, WavFormat::Float32, samples).map(drop)
    }
}

fn text_of(json: &Value) -> Vec<u8> {
    let mut text = serde_json::to_vec(json).expect("keys are text and numbers finite");
    text.push(b'\n');
    text
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |largest: f64, value| largest.max(value.abs()))
}

/// Levels of `other` against `reference` in the octaves from 31.5 Hz to 1 kHz (base ten, IEC 61260-1), as text.
fn octaves(reference: &PowerSpectrum, other: &PowerSpectrum) -> String {
    const LABELS: [&str; 6] = ["31.5", "63", "125", "250", "500", "1000"];
    let levels = LABELS.iter().zip(-5..=0).map(|(label, octave)| {
        let edge_hz = |half: f64| 10f64.powf(3.0 + 0.3 * (f64::from(octave) + half));
        let power = |of: &PowerSpectrum| of.power_between(edge_hz(-0.5), edge_hz(0.5));
        let level = 10.0 * (power(other) / power(reference)).log10();
        format!("{label} Hz {level:+.1} dB")
    });
    levels.collect::<Vec<_>>().join(", ")
}
