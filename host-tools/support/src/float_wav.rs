//! WAV files of 32-bit floats, as recordings are written.

use std::io::Cursor;

use hound::{SampleFormat, WavSpec, WavWriter};

/// The bytes of a file with so many channels, of samples that go from channel to channel.
///
/// # Errors
/// More samples than a WAV file holds, or not as many of each channel.
pub fn float_wav(
    channels: usize,
    sample_rate: u32,
    samples: impl IntoIterator<Item = f64>,
) -> hound::Result<Vec<u8>> {
    let spec = WavSpec {
        channels: channels as u16,
        sample_rate,
        bits_per_sample: 32,
        sample_format: SampleFormat::Float,
    };
    let mut file = Cursor::new(Vec::new());
    let mut writer = WavWriter::new(&mut file, spec)?;
    for sample in samples {
        writer.write_sample(sample as f32)?;
    }
    writer.finalize()?;
    Ok(file.into_inner())
}
