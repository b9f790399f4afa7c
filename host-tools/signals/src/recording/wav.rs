//! Recordings as WAV files, with integer or float samples of any width.

use std::ops::Range;
use std::path::Path;

use stylus_support::{Error, Result};
use symphonia::core::audio::Channels;
use symphonia::core::codecs::audio::{AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error as WavError;
use symphonia::core::formats::{FormatOptions, FormatReader, TrackType};
use symphonia::core::io::{MediaSourceStream, MediaSourceStreamOptions, ReadOnlySource};
use symphonia::default::codecs::PcmDecoder;
use symphonia::default::formats::WavReader;

use super::defects::{Timing, Truncation};
use super::kind::remedy;
use super::rate::{MAX_CHANNELS, MAX_FRAMES, SampleRate, counts_before, length_fault};
use super::riff::{self, Wave};
use super::source::{Cut, Source};
use super::unit::{Stated, Unscaled};

/// Remark on a file whose header has a length that does not fit it.
const UNFINISHED: &str = "the lengths in its header do not fit the file, as those of a recorder that was stopped, or \
                          of a program that wrote to a pipe: the samples that are there are read";

/// Remark on 24 bits at the wrong end of 32.
const NARROW: &str = "no sample uses the upper 8 of its 32 bits: if a converter of 24 bits wrote them, multiply the \
                      scale by 256";

/// Returns true for samples of 32 bits that use the last of them, and none of the upper 8.
fn are_narrow(channels: &[Vec<f64>]) -> bool {
    let samples = || channels.iter().flatten();
    samples().all(|x| x.abs() < 2f64.powi(-8)) && samples().any(|x| x * 2f64.powi(30) % 1.0 != 0.0)
}

/// Returns true for a rate of sound cards, at which floats within ±1 are fractions of a full scale. Models, and what is
/// rendered from them, have lower rates.
fn is_of_sound_card(rate_hz: f64) -> bool {
    rate_hz > 10_000.0 && [8000.0, 11_025.0].iter().any(|base| rate_hz % base == 0.0)
}

/// Reads the part of a WAV file within `cut`. Every sample is exact: float samples are unchanged, and integer samples
/// are divided by their full scale. A given rate, Hz, counts before that of the header.
pub(super) fn read(path: &Path, given_hz: Option<f64>, cut: &Cut) -> Result<Source> {
    let Wave {
        samples,
        are_integers,
        is_unfinished,
    } = riff::open(path)?;
    let file_bytes = samples.get_ref().1.get_ref().size().map_err(Error::io("open", path))?;
    let samples = Box::new(ReadOnlySource::new(samples));
    let stream = MediaSourceStream::new(samples, MediaSourceStreamOptions::default());
    let mut format = WavReader::try_new(stream, FormatOptions::default()).map_err(|e| unusable(path, &e))?;
    let track = format.default_track(TrackType::Audio);
    let Some((track, parameters)) = track.and_then(|track| {
        let parameters = track.codec_params.as_ref()?.audio()?;
        Some((track, parameters))
    }) else {
        return Err(Error::file(path, "holds no samples"));
    };
    let declared_frames = track.num_frames;
    let channel_count = parameters.channels.as_ref().map_or(1, Channels::count);
    let bits = parameters.bits_per_sample.unwrap_or(8);
    let frame_bits = u64::from(bits) * channel_count as u64;
    let told_hz = f64::from(parameters.sample_rate.unwrap_or(0));
    let rate_hz = given_hz.unwrap_or(told_hz);
    let rate = SampleRate::new(rate_hz, "convert it again").map_err(|fault| Error::file(path, fault))?;
    let decoder = PcmDecoder::try_new(parameters, &AudioDecoderOptions::default()).map_err(|e| unusable(path, &e))?;
    let (first, end) = cut.frames(rate_hz);
    let held = (8 * file_bytes / frame_bits.max(8)) as usize;
    let (channels, position) = decoded(path, &mut format, decoder, (first..end, held))?;
    // Only the part that is used must be there.
    if let Some(declared) = declared_frames
        && (position as u64) < declared.min(end as u64)
    {
        let problem = format!("is truncated: it holds {position} of {declared} samples; copy or record it again");
        return Err(Error::file(path, problem));
    }
    let are_narrow = are_integers && bits == 32 && are_narrow(&channels);
    let is_of_sound_card = is_of_sound_card(told_hz) && channels.iter().flatten().all(|x| x.abs() <= 1.0);
    Ok(Source {
        rate,
        first_frame: first,
        channels,
        times_s: None,
        truncation: declared_frames.and_then(|declared| truncation(declared, frame_bits, file_bytes)),
        stated: Stated::default(),
        unscaled: (are_integers || is_of_sound_card).then_some(Unscaled::OfFullScale),
        remarks: (is_unfinished.then(|| UNFINISHED.to_owned()).into_iter())
            .chain(are_narrow.then(|| NARROW.to_owned()))
            .chain(given_hz.and_then(|given_hz| counts_before(given_hz, "its header says", told_hz)))
            .collect(),
        timing: Timing::default(),
    })
}

fn unusable(path: &Path, failure: &WavError) -> Error {
    let failure = format!("is not a readable WAV file: {failure}");
    let remedy = remedy(&failure).map_or(String::new(), |words| format!("; {words}"));
    Error::file(path, failure + &remedy)
}

/// Returns the samples of the `wanted` frames, by channel, and the number of frames that were read up to the end of
/// these. The file has room for at most `held` frames.
fn decoded(
    path: &Path,
    format: &mut WavReader<'_>,
    mut decoder: PcmDecoder,
    (wanted, held): (Range<usize>, usize),
) -> Result<(Vec<Vec<f64>>, usize)> {
    let mut channels: Vec<Vec<f64>> = Vec::new();
    let (mut packet_channels, mut position) = (Vec::new(), 0usize);
    while position < wanted.end {
        let packet = match format.next_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            // The caller judges a file that ends early by the number of its frames.
            Err(WavError::IoError(e)) if e.kind() == std::io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(unusable(path, &e)),
        };
        let decoded = decoder.decode(&packet).map_err(|e| unusable(path, &e))?;
        let (frames, planes) = (decoded.frames(), decoded.num_planes());
        if planes > MAX_CHANNELS {
            let problem = format!("{planes} channels: give 1 to {MAX_CHANNELS}, one per axis");
            return Err(Error::file(path, problem));
        }
        decoded.copy_to_vecs_planar(&mut packet_channels);
        // What the file has room for, and no more than a recording may have: growing would take twice the memory.
        let most = wanted.len().min(held).min(MAX_FRAMES);
        channels.resize_with(packet_channels.len(), || Vec::with_capacity(most));
        let from = wanted.start.saturating_sub(position).min(frames);
        let to = (wanted.end - position).min(frames);
        for (channel, samples) in channels.iter_mut().zip(&packet_channels) {
            channel.extend_from_slice(&samples[from..to.max(from)]);
        }
        let kept = channels.first().map_or(0, Vec::len);
        if let Some(fault) = length_fault(kept as f64, channels.len()) {
            return Err(Error::file(path, fault));
        }
        position += frames;
    }
    Ok((channels, position))
}

/// Size of the shortest header, bytes.
const LEAST_HEADER: u64 = 44;

/// Returns the lengths of a file of `file_bytes` that cannot hold the frames that its header declares.
fn truncation(declared: u64, frame_bits: u64, file_bytes: u64) -> Option<Truncation> {
    let frame_bytes = (frame_bits / 8).max(1);
    let held = file_bytes.saturating_sub(LEAST_HEADER) / frame_bytes;
    (held < declared).then_some(Truncation { declared, held })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::most_frames;
    use stylus_support::float_wav::float_wav;
    use test_helpers::holds;

    /// A file with two channels.
    fn right() -> Vec<u8> {
        let samples = (0..4000).map(|n| (f64::from(n) * 0.37).sin());
        float_wav(2, 5000, samples).unwrap()
    }

    fn data_of(file: &[u8]) -> usize {
        file.windows(4).position(|id| id == b"data").unwrap()
    }

    /// The file with these lengths in its header.
    fn with_lengths(riff: u32, data: u32) -> Vec<u8> {
        let mut file = right();
        let at = data_of(&file) + 4;
        file[4..8].copy_from_slice(&riff.to_le_bytes());
        file[at..at + 4].copy_from_slice(&data.to_le_bytes());
        file
    }

    fn read_bytes(file: &[u8]) -> Result<Source> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wav");
        std::fs::write(&path, file).unwrap();
        read(&path, None, &Cut::WHOLE)
    }

    #[test]
    fn lengths_that_were_never_written_do_not_count_and_are_told() {
        let expected = read_bytes(&right()).unwrap();
        assert!(expected.remarks.is_empty());
        let (data, riff) = (16_000, right().len() as u32 - 8);
        let header = data_of(&right()) as u32;
        for (riff, data) in [
            (header, 0),
            (0, 0),
            (riff, 0),
            (u32::MAX, u32::MAX),
            (u32::MAX, u32::MAX - header),
            (0x8000_0024, 0x8000_0000),
            (0x7fff_ffff, 0x7fff_ffff - header),
            (0x7fff_f024, 0x7fff_f000),
            (riff, u32::MAX),
            (0, data),
            (header, data),
            (u32::MAX, data),
            (data / 2 + header, data / 2),
        ] {
            let found = read_bytes(&with_lengths(riff, data)).unwrap();
            assert_eq!(found.channels, expected.channels, "{riff:x} {data:x}");
            assert_eq!(found.truncation, None, "{riff:x} {data:x}");
            holds(&found.remarks.concat(), &["lengths"]);
        }
    }

    #[test]
    fn the_longest_recording_takes_as_much_memory_whatever_its_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wav");
        for channels in 1..=MAX_CHANNELS {
            let longest = most_frames(channels);
            for frames in [longest, longest + 1] {
                let bytes = (4 * channels * frames) as u32;
                let mut header = float_wav(channels, 48_000, []).unwrap();
                let data = data_of(&header) + 4;
                header[data..].copy_from_slice(&bytes.to_le_bytes());
                header[4..8].copy_from_slice(&(data as u32 + bytes - 4).to_le_bytes());
                std::fs::write(&path, &header).unwrap();
                // Zeros that take no space on the disk.
                std::fs::OpenOptions::new()
                    .write(true)
                    .open(&path)
                    .unwrap()
                    .set_len(header.len() as u64 + u64::from(bytes))
                    .unwrap();
                match read(&path, None, &Cut::WHOLE) {
                    Ok(found) => assert_eq!((found.channels[0].len(), longest), (frames, frames)),
                    Err(fault) => {
                        assert!(frames > longest, "{fault}");
                        holds(&fault, &["a.wav", &format!("{longest} samples per channel")]);
                    }
                }
            }
        }
    }

    #[test]
    fn floats_of_a_sound_card_are_of_a_full_scale_and_those_of_a_rig_are_not() {
        for (rate_hz, peak, expected) in [
            (44_100, 1.0, Some(Unscaled::OfFullScale)),
            (48_000, 0.01, Some(Unscaled::OfFullScale)),
            (192_000, 0.5, Some(Unscaled::OfFullScale)),
            (48_000, 1.5, None),
            (5000, 0.5, None),
            (10_000, 0.5, None),
            (51_200, 0.5, None),
        ] {
            let samples = (0..4000).map(|n| peak * (f64::from(n) * 0.37).sin()).chain([peak, 0.0]);
            let found = read_bytes(&float_wav(2, rate_hz, samples).unwrap()).unwrap();
            assert_eq!(found.unscaled, expected, "{rate_hz} Hz, {peak}");
        }
    }

    #[test]
    fn a_frame_that_was_cut_is_left_out() {
        let mut file = with_lengths(0, 0);
        file.truncate(file.len() - 3);
        let found = read_bytes(&file).unwrap();
        assert_eq!(found.channels[1].len(), 1999);
    }

    #[test]
    fn what_stands_behind_the_samples_is_no_sample() {
        let expected = read_bytes(&right()).unwrap();
        let list = [&b"LIST\x58\x02\0\0"[..], &[7; 600]].concat();
        let tags = [list.clone(), [&b"ID3\x03"[..], &[9; 600]].concat(), vec![0; 600]];
        for tag in tags {
            let found = read_bytes(&[right(), tag].concat()).unwrap();
            assert_eq!(found.channels, expected.channels);
            assert!(found.remarks.is_empty());
        }
        // An empty recording stays empty, whatever follows it.
        let file = right();
        let data = data_of(&file);
        let empty = [&file[..data], b"data\0\0\0\0", &list].concat();
        let found = read_bytes(&empty).unwrap();
        assert!(found.channels.iter().all(Vec::is_empty));
    }

    #[test]
    fn a_long_file_states_its_length_elsewhere() {
        let (file, expected) = (right(), read_bytes(&right()).unwrap());
        let data = data_of(&file);
        let lengths = [16_100u64, 16_000, 2000].map(u64::to_le_bytes).concat();
        let ones = u32::MAX.to_le_bytes();
        let long = [
            b"RF64",
            &ones[..],
            b"WAVEds64\x1c\0\0\0",
            &lengths,
            &[0; 4],
            &file[12..data],
            b"data",
            &ones,
            &file[data + 8..],
            b"LIST\x58\x02\0\0",
            &[7; 600],
        ]
        .concat();
        let found = read_bytes(&long).unwrap();
        assert_eq!(found.channels, expected.channels);
        assert!(found.remarks.is_empty());
    }
}
