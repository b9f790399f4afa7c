//! WAV files of 32-bit floats, the format in which recordings are written.

use std::io::{Cursor, Error};

use hound::{SampleFormat, WavSpec, WavWriter};

/// Upper bound of the length of a file's headers and comment, bytes.
const HEADER_ROOM: u32 = 1024;

/// Largest number of samples. The file's length fields, which hound lets overflow, count headers and samples together.
const MOST_SAMPLES: usize = ((u32::MAX - HEADER_ROOM) / 4) as usize;

/// Returns the bytes of a file with `channels` channels, whose `samples` are interleaved.
///
/// # Errors
/// The number of samples is not a multiple of the number of channels, or is more than a WAV file can hold.
pub fn float_wav(channels: usize, sample_rate: u32, samples: impl IntoIterator<Item = f64>) -> hound::Result<Vec<u8>> {
    at_most(MOST_SAMPLES, channels, sample_rate, samples)
}

/// Returns the file of [`float_wav`] if it has at most `most` samples.
fn at_most(
    most: usize,
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
    for (index, sample) in samples.into_iter().enumerate() {
        if index == most {
            let problem = "more samples than the 4 GiB of a WAV file hold: make it shorter";
            return Err(Error::other(problem).into());
        }
        writer.write_sample(sample as f32)?;
    }
    writer.finalize()?;
    Ok(file.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_beyond_the_length_fields_are_refused_and_what_is_taken_fits_them() {
        let file = |count| at_most(6, 3, 5000, std::iter::repeat_n(0.5, count));
        let headers = file(6).unwrap().len() - 4 * 6;
        assert!(headers < HEADER_ROOM as usize);
        assert!(u32::try_from(headers + 4 * MOST_SAMPLES).is_ok());
        let refusal = file(9).unwrap_err().to_string();
        assert!(refusal.ends_with("make it shorter"), "{refusal}");
    }
}
