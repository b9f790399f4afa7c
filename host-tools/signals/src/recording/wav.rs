//! Recordings as WAV files, with integer or float samples of any width.

use std::io::Read;
use std::ops::Range;
use std::path::Path;

use stylus_support::{Error, Result};

use super::defects::{Timing, Truncation};
use super::rate::{SampleRate, counts_before, length_fault};
use super::riff::{self, Wave, skip};
use super::trial::{Cut, Source};
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
    let mut wave = riff::open(path)?;
    let format = wave.format;
    let told_hz = f64::from(format.rate_hz);
    let rate_hz = given_hz.unwrap_or(told_hz);
    let rate =
        SampleRate::new(rate_hz, "mend its header, or convert it again").map_err(|fault| Error::file(path, fault))?;
    let (first, end) = cut.frames(rate_hz);
    let (declared, held) = (wave.declared_frames, wave.held_frames);
    // Only the part that is used must be there.
    if held < declared.min(end as u64) {
        let problem = format!("is truncated: it holds {held} of {declared} samples; copy or record it again");
        return Err(Error::file(path, problem));
    }
    let channels = samples(path, &mut wave, first as u64..held.min(end as u64))?;
    let are_narrow = format.are_integers && format.sample_bytes == 4 && are_narrow(&channels);
    let is_of_sound_card = is_of_sound_card(told_hz) && channels.iter().flatten().all(|x| x.abs() <= 1.0);
    Ok(Source {
        rate,
        first_frame: first,
        channels,
        times_s: None,
        truncation: (held < declared).then_some(Truncation { declared, held }),
        stated: Stated::default(),
        unscaled: (format.are_integers || is_of_sound_card).then_some(Unscaled::OfFullScale),
        remarks: (wave.is_unfinished.then(|| UNFINISHED.to_owned()).into_iter())
            .chain(are_narrow.then(|| NARROW.to_owned()))
            .chain(given_hz.and_then(|given_hz| counts_before(given_hz, "its header says", told_hz)))
            .collect(),
        timing: Timing::default(),
    })
}

/// Returns the samples of the `wanted` frames, which are there, by channel.
fn samples(path: &Path, wave: &mut Wave, wanted: Range<u64>) -> Result<Vec<Vec<f64>>> {
    let format = wave.format;
    // A start behind the end, however far, is no place in the file.
    let begin = wanted.start.min(wanted.end);
    let count = wanted.end - begin;
    if let Some(fault) = length_fault(count as f64, format.channels) {
        return Err(Error::file(path, fault));
    }
    // In its final size, because growing would take twice the memory.
    let channel = |_| Vec::with_capacity(count as usize);
    let mut channels: Vec<Vec<f64>> = (0..format.channels).map(channel).collect();
    let mut frame = vec![0; format.frame_bytes()];
    let mut read = || {
        skip(&mut wave.file, begin * frame.len() as u64)?;
        for _ in 0..count {
            wave.file.read_exact(&mut frame)?;
            for (channel, sample) in channels.iter_mut().zip(frame.chunks_exact(format.sample_bytes)) {
                channel.push(format.value(sample));
            }
        }
        Ok(())
    };
    read().map_err(Error::io("read", path))?;
    Ok(channels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{MAX_CHANNELS, most_frames};
    use stylus_support::float_wav::float_wav;
    use test_helpers::{holds, new_file};

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
        let (_folder, path) = new_file("a.wav");
        std::fs::write(&path, file).unwrap();
        read(&path, None, &Cut::WHOLE)
    }

    /// The file whose chunk of the format is `content`, with `data` as its samples.
    fn of_format(content: &[u16], data: &[u8]) -> Vec<u8> {
        let content = content.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<_>>();
        let lengths = [20 + content.len() + data.len(), content.len(), data.len()];
        let [riff, format, samples] = lengths.map(|bytes| (bytes as u32).to_le_bytes());
        let head = [b"RIFF", &riff[..], b"WAVEfmt ", &format, &content, b"data", &samples];
        [head.concat(), data.to_vec()].concat()
    }

    #[test]
    fn samples_of_every_width_are_exact_and_other_codings_are_refused_with_the_remedy() {
        let (third, wide) = (1.0 / 3.0, i32::MIN.to_le_bytes());
        for (tag, bits, sample, value) in [
            (1, 8, &[0][..], -1.0),
            (1, 8, &[129], 1.0 / 128.0),
            // Twelve bits stand at the upper end of two bytes.
            (1, 12, &[0x10, 0x80], 16.0 / 32768.0 - 1.0),
            (1, 16, &[0xff, 0xff], -1.0 / 32768.0),
            (1, 24, &[1, 0, 0x40], 0.5 + 2f64.powi(-23)),
            (1, 32, &wide, -1.0),
            (3, 32, &0.1f32.to_le_bytes(), f64::from(0.1f32)),
            (3, 64, &f64::to_le_bytes(third), third),
        ] {
            let plain = [tag, 1, 5000, 0, 0, 0, 0, bits];
            // In the extensible form with the number of used bits, a mask of channels, and the tag's long form.
            let mut extended = [&plain[..], &[22, bits, 0, 0, tag], &[0; 7]].concat();
            extended[0] = 0xfffe;
            for format in [&plain[..], &extended] {
                let found = read_bytes(&of_format(format, &sample.repeat(3))).unwrap();
                assert_eq!(found.channels, [[value; 3]], "{format:?}");
                assert_eq!(found.unscaled.is_some(), tag == 1);
            }
        }
        for (tag, bits) in [(6, 8), (2, 4), (1, 33), (1, 0), (3, 16)] {
            let refused = read_bytes(&of_format(&[tag, 1, 5000, 0, 0, 0, 0, bits], &[0; 64]));
            holds(&refused.unwrap_err(), &["a.wav", &format!("coding {tag}"), "ffmpeg"]);
        }
        let end = of_format(&[1, 1, 5000, 0, 0, 0, 0, 16], &[]);
        for (file, words) in [
            (&b"ID3\x03 and so on"[..], "another kind"),
            (&end[..12], "no samples"),
            (&of_format(&[1, 1, 5000], &[0; 64]), "cut off"),
            (&[&end[..12], &end[36..]].concat(), "no format"),
        ] {
            holds(&read_bytes(file).unwrap_err(), &["a.wav", words]);
        }
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
        let (_folder, path) = new_file("a.wav");
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
