//! The parts of a WAV file that are needed to read its samples: their format, and where they are.
//!
//! Titles, pictures and cue points are passed by, and every length that a header states is compared with the file
//! before it determines the size of anything.

use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use stylus_support::bounded_file::Format;
use stylus_support::files::Opened;
use stylus_support::{Error, Result};

use super::rate::MAX_CHANNELS;

/// Longest beginning of a part that is read, bytes: the extensible format takes 40.
const MOST_READ: u64 = 40;

/// Largest number of parts before the samples.
const MOST_CHUNKS: usize = 1000;

/// Least stated length of samples that means an unknown length: 2³¹ less the header, or more. Programs write such a
/// length if they do not know it yet. Samples of this length would exceed the largest recording.
const LEAST_UNKNOWN: u64 = 0x7fff_0000;

/// Least length of data after the samples that can be samples too, bytes: no title tag is as long.
const LEAST_REST: u64 = 512;

/// Tag of the extensible format, in which the tag of the actual format is further on.
const EXTENSIBLE: u16 = 0xfffe;

/// Tag of integer samples.
const PCM: u16 = 1;

/// Tag of float samples.
const FLOAT: u16 = 3;

/// Offset of the tag within an extensible format.
const EXTENDED_FORMAT: usize = 24;

/// A WAV file whose header was read.
pub(super) struct Wave {
    /// The file, at its first sample.
    pub file: BufReader<Opened>,
    pub format: SampleFormat,
    /// Number of frames that the header states; up to the file's end if it states none, or one that does not fit.
    pub declared_frames: u64,
    /// Number of these frames that are there.
    pub held_frames: u64,
    /// True if a length in the header does not fit the file. If it is that of the samples, they are read to the file's
    /// end.
    pub is_unfinished: bool,
}

/// How samples are written.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleFormat {
    pub channels: usize,
    pub rate_hz: u32,
    /// Bytes of one sample of one channel.
    pub sample_bytes: usize,
    /// True for integer samples, whose acceleration at full scale the file does not state.
    pub are_integers: bool,
}

impl SampleFormat {
    /// Reads the content of the format's chunk in the file at `path`.
    fn of(path: &Path, chunk: &[u8]) -> Result<Self> {
        let refused = |problem: String| Err(Error::file(path, problem));
        let word = |at: usize| {
            let bytes = chunk.get(at..)?.first_chunk::<2>()?;
            Some(u16::from_le_bytes(*bytes))
        };
        let tag = match word(0) {
            Some(EXTENSIBLE) => word(EXTENDED_FORMAT),
            tag => tag,
        };
        let numbers = (tag, word(2), word(4), word(6), word(14));
        let (Some(tag), Some(channels), Some(low), Some(high), Some(bits)) = numbers else {
            return refused("is not a readable WAV file: its format is cut off: convert it again".to_owned());
        };
        let channels = usize::from(channels);
        if channels == 0 || channels > MAX_CHANNELS {
            return refused(format!(
                "{channels} channels: give 1 to {MAX_CHANNELS}, one per axis; `sox FILE.wav OUT.wav remix 1 2 3` keeps \
                 the first three"
            ));
        }
        if !matches!((tag, bits), (PCM, 1..=32) | (FLOAT, 32 | 64)) {
            return refused(format!(
                "its samples have coding {tag} with {bits} bits: `ffmpeg -i FILE -c:a pcm_s16le OUT.wav` converts it"
            ));
        }
        Ok(Self {
            channels,
            rate_hz: u32::from(low) | u32::from(high) << 16,
            sample_bytes: usize::from(bits.div_ceil(8)),
            are_integers: tag == PCM,
        })
    }

    /// Bytes of one sample of all channels.
    pub fn frame_bytes(self) -> usize {
        self.channels * self.sample_bytes
    }

    /// Returns the value of a sample. Floats are unchanged, and integers are divided by their full scale: both exactly.
    pub fn value(self, sample: &[u8]) -> f64 {
        match (self.are_integers, sample) {
            (false, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]).into(),
            (false, _) => sample.first_chunk().map_or(0.0, |bytes| f64::from_le_bytes(*bytes)),
            // Integers of 8 bits alone have no sign: silence is 128.
            (true, &[byte]) => (f64::from(byte) - 128.0) / 128.0,
            (true, _) => {
                let mut wide = [0; 4];
                wide[4 - sample.len()..].copy_from_slice(sample);
                f64::from(i32::from_le_bytes(wide)) / 2f64.powi(31)
            }
        }
    }
}

/// Opens the WAV file at `path`, and checks what its header states.
///
/// A file with fewer samples than declared is accepted; the reader of the samples decides about it. A file whose
/// lengths were never written, or are those that a program writes to a pipe, is read to its end.
///
/// # Errors
/// The file cannot be read or is of another kind, a part is longer than the file, more than 1000 parts precede the
/// samples or there are none, or no recording has its format.
pub(super) fn open(path: &Path) -> Result<Wave> {
    let failed = |failure| Error::io("read", path)(failure);
    let file = Format::Wave.open(path)?;
    let file_bytes = file.size().map_err(failed)?;
    let mut left = file_bytes.saturating_sub(12);
    let mut file = BufReader::new(file);
    let header = take(&mut file, 12).map_err(failed)?;
    let kinds = [b"RIFF", b"RF64", b"BW64"];
    if !(kinds.iter().any(|kind| header.starts_with(*kind)) && header.ends_with(b"WAVE")) {
        let problem = "is not a readable WAV file: it begins as another kind of file; `ffmpeg -i FILE OUT.wav` \
                       converts sound";
        return Err(Error::file(path, problem));
    }
    let riff_bytes = header.get(4..).and_then(<[u8]>::first_chunk::<4>);
    let riff_end = riff_bytes.map_or(0, |bytes| 8 + u64::from(u32::from_le_bytes(*bytes)));
    let mut format = None;
    // Length of the samples in a file of more than 4 GiB, in which their part does not state it.
    let mut long_bytes = None;
    for _ in 0..MOST_CHUNKS {
        let Some((id, length)) = head(&take(&mut file, 8).map_err(failed)?) else {
            return Err(Error::file(path, "holds no samples"));
        };
        left = left.saturating_sub(8);
        if id == *b"data" {
            let format: SampleFormat =
                format.ok_or_else(|| Error::file(path, "states no format of its samples: convert it again"))?;
            let declared = long_bytes.filter(|_| length == u32::MAX).unwrap_or(length.into());
            let held = held(&mut file, declared, left).map_err(failed)?;
            let length = held.unwrap_or(declared);
            let end = file_bytes - left + length;
            // The length of the whole may include parts after the samples and a padding byte.
            let is_told = end..=file_bytes.max(end) + 1;
            let is_other = long_bytes.is_none() && declared <= left && !is_told.contains(&riff_end);
            // A recorder that was stopped may have cut the last frame.
            let frames = |bytes: u64| bytes / format.frame_bytes() as u64;
            return Ok(Wave {
                file,
                format,
                declared_frames: frames(length),
                held_frames: frames(length.min(left)),
                is_unfinished: held.is_some() || is_other,
            });
        }
        if u64::from(length) > left {
            let problem = format!(
                "its header declares a part '{}' of {length} bytes, and {left} bytes follow: copy or convert it again",
                id.escape_ascii()
            );
            return Err(Error::file(path, problem));
        }
        let padded = u64::from(length) + u64::from(length % 2);
        left = left.saturating_sub(padded);
        let content = take(&mut file, padded.min(MOST_READ)).map_err(failed)?;
        skip(&mut file, padded - content.len() as u64).map_err(failed)?;
        match &id {
            b"fmt " => format = Some(SampleFormat::of(path, &content)?),
            b"ds64" => {
                // The length of the whole file comes first.
                let bytes = content.get(8..).and_then(<[u8]>::first_chunk::<8>);
                long_bytes = bytes.map(|bytes| u64::from_le_bytes(*bytes));
            }
            _ => {}
        }
    }
    let problem = format!("has more than {MOST_CHUNKS} parts before its samples: convert it again");
    Err(Error::file(path, problem))
}

/// Returns the length of the samples, `left` bytes, if they extend to the end of `file`; otherwise `None`. They do if
/// the header states no length, or if the data after the stated length is not a chunk. The position in the file stays
/// the same.
fn held(file: &mut BufReader<Opened>, declared: u64, left: u64) -> std::io::Result<Option<u64>> {
    // More than the file has: a length that was never known, or a file that ends early.
    if declared > left {
        return Ok((declared >= LEAST_UNKNOWN).then_some(left));
    }
    let padded = declared + declared % 2;
    let rest = left.saturating_sub(padded);
    if rest == 0 || (declared > 0 && rest < LEAST_REST) {
        return Ok(None);
    }
    let begin = file.stream_position()?;
    skip(file, padded)?;
    let beginning = take(file, LEAST_REST)?;
    file.seek(SeekFrom::Start(begin))?;
    let is_text = beginning.iter().take(3).all(|byte| (0x20..0x7f).contains(byte));
    let ends = head(beginning.get(..8).unwrap_or_default()).is_some_and(|(_, length)| u64::from(length) <= rest);
    let is_other = if declared == 0 {
        is_text && ends
    } else {
        // Chunks and appended tags begin with text, and padding consists of zeros.
        is_text || beginning.iter().all(|byte| *byte == 0)
    };
    Ok((!is_other).then_some(left))
}

/// Splits the header of a chunk into its name and the length of its content.
fn head(chunk: &[u8]) -> Option<([u8; 4], u32)> {
    let (id, length) = chunk.split_first_chunk::<4>()?;
    Some((*id, u32::from_le_bytes(length.try_into().ok()?)))
}

/// Reads `count` bytes, or fewer if the file ends.
fn take(file: &mut impl Read, count: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Passes by `count` bytes.
pub(super) fn skip(file: &mut BufReader<Opened>, count: u64) -> std::io::Result<()> {
    file.seek(SeekFrom::Current(count.cast_signed())).map(drop)
}
