//! WAV files of 32-bit floats, the format in which recordings are written.

use std::io::Cursor;

use hound::{SampleFormat, WavSpec, WavWriter};

/// Returns the bytes of a file with `channels` channels, whose `samples` are interleaved.
///
/// # Errors
/// The number of samples is not a multiple of the number of channels. More samples than a WAV file can hold, four
/// gigabytes, are not noticed.
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
