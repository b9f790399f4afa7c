//! Samples as a mono WAV file, which is written whole or not at all.

use std::io::BufWriter;
use std::path::Path;

use hound::{SampleFormat, WavSpec, WavWriter};
use model_format::{OutputSample, Texture};
use stylus_support::files::Written;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, progress};

use super::samples::{Rendering, exact_m_s2};
use crate::playing::motion::MotionPath;

/// Upper bound of the length of a WAV file's headers, bytes. Headers and samples share the 4 GiB that the file's length
/// fields can count.
const WAV_HEADER_ROOM: u64 = 1024;

/// Format of the samples in a WAV file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WavFormat {
    /// 32-bit floating point, in m/s².
    Float32,
    /// 16-bit integers.
    Pcm16 {
        /// Acceleration of the code 32 768, m/s². Samples beyond the codes -32 768 and 32 767 are clipped.
        full_scale_m_s2: f64,
    },
}

impl WavFormat {
    fn spec(self, sample_rate_hz: u32) -> WavSpec {
        let (bits_per_sample, sample_format) = match self {
            Self::Float32 => (32, SampleFormat::Float),
            Self::Pcm16 { .. } => (16, SampleFormat::Int),
        };
        WavSpec {
            channels: 1,
            sample_rate: sample_rate_hz,
            bits_per_sample,
            sample_format,
        }
    }

    fn validate(self, samples: usize) -> Result<()> {
        if let Self::Pcm16 { full_scale_m_s2 } = self
            && !(full_scale_m_s2.is_finite() && full_scale_m_s2 > 0.0)
        {
            return Err(Error::Request(format!(
                "the full scale of 16-bit samples is {full_scale_m_s2} m/s²: give a positive number"
            )));
        }
        let bytes = samples as u64 * u64::from(self.spec(1).bits_per_sample / 8);
        if bytes > u64::from(u32::MAX) - WAV_HEADER_ROOM {
            return Err(Error::Request(format!(
                "{samples} samples exceed the 4 GiB of a WAV file: render a shorter duration"
            )));
        }
        Ok(())
    }
}

/// Summary of a written WAV file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WavSummary {
    /// Number of samples in the file.
    pub samples: u64,
    /// Number of samples that were clipped at the full scale of 16-bit samples.
    pub clipped: u64,
}

/// Writes samples as a mono WAV file, whole or not at all, without keeping them in memory. The same arguments give the
/// same bytes.
///
/// # Errors
/// A full scale that is not positive, more samples than the file's length fields can count, or a file that cannot be
/// written.
pub fn write_wav(
    path: &Path,
    sample_rate_hz: u32,
    format: WavFormat,
    samples: impl ExactSizeIterator<Item = OutputSample>,
) -> Result<WavSummary> {
    let mut clipped = 0;
    let samples = write_each(path, sample_rate_hz, format, samples, |writer, sample| match format {
        WavFormat::Float32 => writer.write_sample(sample.metres_per_second_squared().0),
        WavFormat::Pcm16 { full_scale_m_s2 } => {
            let (code, beyond) = pcm16(sample, full_scale_m_s2);
            clipped += u64::from(beyond);
            writer.write_sample(code)
        }
    })?;
    Ok(WavSummary { samples, clipped })
}

/// Writes values as a mono WAV file of 32-bit floats, whole or not at all, and returns their number.
pub fn write_floats_wav(path: &Path, sample_rate_hz: u32, samples: impl ExactSizeIterator<Item = f32>) -> Result<u64> {
    write_each(path, sample_rate_hz, WavFormat::Float32, samples, |writer, value| {
        writer.write_sample(value)
    })
}

/// Writes each of `samples` with `write`, and returns their number.
fn write_each<Sample>(
    path: &Path,
    sample_rate_hz: u32,
    format: WavFormat,
    samples: impl ExactSizeIterator<Item = Sample>,
    mut write: impl FnMut(&mut WavWriter<&mut BufWriter<&mut Written>>, Sample) -> hound::Result<()>,
) -> Result<u64> {
    // Refused before the work, so that no long rendering ends in an error.
    format.validate(samples.len())?;
    atomic_file::write_with(path, |file| {
        let failed = |error| match error {
            hound::Error::IoError(error) => Error::io("write", path)(error),
            other => Error::file(path, format!("cannot be written as WAV: {other}")),
        };
        let mut writer = WavWriter::new(file, format.spec(sample_rate_hz)).map_err(failed)?;
        let mut written = 0;
        for sample in samples {
            write(&mut writer, sample).map_err(failed)?;
            written += 1;
        }
        writer.finalize().map_err(failed)?;
        Ok(written)
    })
}

/// Returns the 16-bit code of a sample, rounded to nearest, and true if it was clipped.
fn pcm16(sample: OutputSample, full_scale_m_s2: f64) -> (i16, bool) {
    let exact = (exact_m_s2(sample) / full_scale_m_s2 * 32_768.0).round();
    let code = exact.clamp(f64::from(i16::MIN), f64::from(i16::MAX));
    (code as i16, code.total_cmp(&exact).is_ne())
}

/// Summary of a rendering into a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSummary {
    /// The written file.
    pub wav: WavSummary,
    /// Number of samples at the kernel's full scale.
    pub saturations: u32,
}

/// Renders `seconds` of `texture` along `motion` into a WAV file of any length, with a progress bar.
///
/// # Errors
/// The errors of [`Rendering::new`] and of [`write_wav`]. After an error, an earlier file stays, and no new file is
/// left.
pub fn render_wav(
    texture: Texture<'_>,
    motion: &MotionPath,
    seconds: f64,
    seed: u64,
    path: &Path,
    format: WavFormat,
) -> Result<RenderSummary> {
    let mut rendering = Rendering::new(texture, motion, seconds, seed)?;
    let bar = progress::bar(rendering.len() as u64, "rendering");
    let rate = rendering.sample_rate_hz();
    let wav = write_wav(path, rate, format, bar.wrap_iter(&mut rendering))?;
    bar.finish_and_clear();
    Ok(RenderSummary {
        wav,
        saturations: rendering.saturations(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples::render;
    use super::super::test_motions::sweep;
    use super::*;
    use proptest::prelude::*;
    use test_helpers::{library, new_file, texture};

    #[test]
    fn a_float_wav_holds_the_samples_in_metres_per_second_squared() {
        let library = library(4000);
        let folder = tempfile::tempdir().unwrap();
        let (path, motion) = (folder.path().join("a.wav"), sweep());
        let summary = render_wav(texture(&library), &motion, 0.25, 3, &path, WavFormat::Float32).unwrap();
        let rendered = render(texture(&library), &motion, 0.25, 3).unwrap();
        assert_eq!(
            summary.wav,
            WavSummary {
                samples: 1000,
                clipped: 0
            }
        );
        let reader = hound::WavReader::open(&path).unwrap();
        let spec = WavSpec {
            channels: 1,
            sample_rate: 4000,
            bits_per_sample: 32,
            sample_format: SampleFormat::Float,
        };
        assert_eq!(reader.spec(), spec);
        let written: Vec<f32> = reader.into_samples().map(|sample| sample.unwrap()).collect();
        let expected: Vec<f32> = rendered
            .samples
            .iter()
            .map(|sample| sample.metres_per_second_squared().0)
            .collect();
        assert_eq!(written, expected);
    }

    proptest! {
        #[test]
        fn a_16_bit_wav_is_within_half_a_step_and_what_does_not_fit_is_clipped_and_counted(
            samples in prop::collection::vec(any::<i32>(), 1..200), full_scale_m_s2 in 0.1..5000.0f64,
        ) {
            let (_folder, path) = new_file("a.wav");
            let format = WavFormat::Pcm16 { full_scale_m_s2 };
            let summary = write_wav(&path, 5000, format, samples.iter().copied().map(OutputSample)).unwrap();
            let reader = hound::WavReader::open(&path).unwrap();
            let written: Vec<i16> = reader.into_samples().map(|sample| sample.unwrap()).collect();
            prop_assert_eq!(summary.samples, samples.len() as u64);
            prop_assert_eq!(written.len(), samples.len());
            let mut clipped = 0;
            for (sample, code) in samples.iter().zip(written) {
                let steps = f64::from(*sample) / 1_048_576.0 / full_scale_m_s2 * 32_768.0;
                if (-32_768.5..32_767.5).contains(&steps) {
                    prop_assert!((f64::from(code) - steps).abs() <= 0.5 + 1e-9);
                } else {
                    prop_assert_eq!(code, if steps > 0.0 { i16::MAX } else { i16::MIN });
                    clipped += 1;
                }
            }
            prop_assert_eq!(summary.clipped, clipped);
        }
    }

    #[test]
    fn a_full_scale_that_is_not_positive_is_refused_and_leaves_what_was_there() {
        let (_folder, path) = new_file("a.wav");
        std::fs::write(&path, "before").unwrap();
        for full_scale_m_s2 in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let format = WavFormat::Pcm16 { full_scale_m_s2 };
            let error = write_wav(&path, 5000, format, [OutputSample::SILENCE].into_iter()).unwrap_err();
            assert!(matches!(error, Error::Request(_)));
        }
        assert_eq!(std::fs::read(&path).unwrap(), b"before");
    }

    #[test]
    fn more_than_a_wav_file_can_hold_is_refused_before_the_work() {
        let (_folder, path) = new_file("a.wav");
        let samples = std::iter::repeat_n(OutputSample::SILENCE, 1 << 30);
        let error = write_wav(&path, 5000, WavFormat::Float32, samples).unwrap_err();
        assert!(error.to_string().contains("4 GiB"), "{error}");
        assert!(!path.exists());
    }
}
