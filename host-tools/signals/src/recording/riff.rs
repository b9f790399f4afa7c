//! The chunks of a WAV file that are needed to read its samples.
//!
//! The reader of samples receives only the format and the samples. Chunks of titles, pictures and cue points never
//! reach it, and every length that a header states is compared with the file before it determines the size of anything.

use std::io::{BufReader, Chain, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use stylus_support::bounded_file::Format;
use stylus_support::files::Opened;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::rate::MAX_CHANNELS;
use super::rate::SampleRate;

/// Longest format chunk, bytes; the extensible format takes 40.
const MOST_FORMAT_BYTES: u32 = 128;

/// Longest fact chunk, bytes.
const MOST_FACT_BYTES: u32 = 128;

/// Largest number of chunks before the samples.
const MOST_CHUNKS: usize = 1000;

/// Widest sample, bytes: a float of double precision.
const MOST_SAMPLE_BYTES: usize = 8;

/// Least stated length of samples that means an unknown length: 2³¹ less the header, or more. Programs write such a
/// length if they do not know it yet. Samples of this length would exceed the largest recording.
const LEAST_UNKNOWN: u64 = 0x7fff_0000;

/// Largest length of samples that a header can state, bytes; the largest 32-bit number means that there is no length.
const MOST_BYTES: u64 = u32::MAX as u64 - 1;

/// Least length of data after the samples that can be samples too, bytes: no title tag is as long.
const LEAST_REST: u64 = 512;

/// Tag of the extensible format, in which the tag of the actual format is further on.
const EXTENSIBLE: u16 = 0xfffe;

/// Tag of integer samples.
const PCM: u16 = 1;

/// Offset of the tag within an extensible format chunk.
const EXTENDED_FORMAT: usize = 24;

/// The format and the samples of a WAV file.
pub(super) struct Wave {
    /// Format and samples, as a separate WAV file.
    pub samples: Chain<Cursor<Vec<u8>>, BufReader<Opened>>,
    /// True for integer samples, whose acceleration at full scale the file does not state.
    pub are_integers: bool,
    /// True if a length in the header does not fit the file. If it is that of the samples, they are read to the file's
    /// end.
    pub is_unfinished: bool,
}

/// The chunks before the samples.
#[derive(Default)]
struct Head {
    /// Bytes of the chunks that the reader of samples needs.
    chunks: Vec<u8>,
    /// Bytes of one sample on all channels.
    frame_bytes: u64,
    are_integers: bool,
    /// Length of the samples in a file of more than 4 GiB, in which their chunk does not state it.
    long_bytes: Option<u64>,
}

/// Opens the WAV file at `path`, and checks what its header states.
///
/// A file with fewer samples than declared is accepted; the reader of the samples decides about it. A file whose
/// lengths were never written, or are those that a program writes to a pipe, is read to its end.
///
/// # Errors
/// The file cannot be read, a chunk is longer than the file or than its kind can be, more than 1000 chunks precede the
/// samples, or no recording has its format.
pub(super) fn open(path: &Path) -> Result<Wave> {
    let failed = |failure| Error::io("read", path)(failure);
    let file = Format::Wave.open(path)?;
    let file_bytes = file.size().map_err(failed)?;
    let mut left = file_bytes.saturating_sub(12);
    let mut file = BufReader::new(file);
    let mut header = take(&mut file, 12).map_err(failed)?;
    let kinds = [b"RIFF", b"RF64", b"BW64"];
    let is_wav = kinds.iter().any(|kind| header.starts_with(*kind)) && header.ends_with(b"WAVE");
    let riff_bytes = header.get(4..).and_then(<[u8]>::first_chunk::<4>);
    let riff_end = riff_bytes.map_or(0, |bytes| 8 + u64::from(u32::from_le_bytes(*bytes)));
    if is_wav {
        // Only the length that the samples' own chunk states is used.
        header.splice(..8, [*b"RIFF", [u8::MAX; 4]].concat());
    }
    let mut head = Head::default();
    // A file of another format is left for the reader of samples to refuse.
    for _ in 0..if is_wav { MOST_CHUNKS } else { 0 } {
        let chunk = take(&mut file, 8).map_err(failed)?;
        left = left.saturating_sub(8);
        match self::head(&chunk) {
            // The reader of samples reports what is missing.
            None => return Ok(head.wave(header, &chunk, file, false)),
            Some((id, declared)) if id == *b"data" => {
                let declared = head.length_of_samples(declared);
                let held = held(&mut file, declared, left).map_err(failed)?;
                // A recorder that was stopped may have cut the last frame.
                let held = held.map(|bytes| bytes - bytes % head.frame_bytes.max(1));
                let length = held.unwrap_or(declared).min(MOST_BYTES) as u32;
                let end = file_bytes - left + u64::from(length);
                // The length of the whole may include chunks after the samples and a padding byte.
                let is_told = end..=file_bytes.max(end) + 1;
                let is_unfinished =
                    held.is_some() || (head.long_bytes.is_none() && declared <= left && !is_told.contains(&riff_end));
                let chunk = [*b"data", length.to_le_bytes()].concat();
                return Ok(head.wave(header, &chunk, file, is_unfinished));
            }
            Some((id, length)) if u64::from(length) > left => {
                let problem = format!(
                    "its header declares a part '{}' of {length} bytes, and {left} bytes follow: copy or convert it \
                     again",
                    id.escape_ascii()
                );
                return Err(Error::file(path, problem));
            }
            Some((_, length)) => {
                let padded = u64::from(length) + u64::from(length % 2);
                left = left.saturating_sub(padded);
                head.read(path, &mut file, &chunk, padded)?;
            }
        }
    }
    if is_wav {
        let problem = format!("has more than {MOST_CHUNKS} parts before its samples: convert it again");
        return Err(Error::file(path, problem));
    }
    Ok(head.wave(header, &[], file, false))
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

impl Head {
    /// Returns the length of the samples, bytes. Their own chunk states `declared`.
    fn length_of_samples(&self, declared: u32) -> u64 {
        self.long_bytes
            .filter(|_| declared == u32::MAX)
            .unwrap_or(declared.into())
    }

    /// Returns the file with these chunks, where `last` is the beginning of the last chunk.
    fn wave(self, mut header: Vec<u8>, last: &[u8], file: BufReader<Opened>, is_unfinished: bool) -> Wave {
        header.extend(self.chunks);
        header.extend(last);
        Wave {
            samples: Cursor::new(header).chain(file),
            are_integers: self.are_integers,
            is_unfinished,
        }
    }

    /// Reads the content of a `chunk` before the samples, `padded` bytes, or skips it.
    fn read(&mut self, path: &Path, file: &mut BufReader<Opened>, chunk: &[u8], padded: u64) -> Result<()> {
        let failed = |failure| Error::io("read", path)(failure);
        let Some((id, length)) = head(chunk) else {
            return Ok(());
        };
        let most = match &id {
            b"fmt " => MOST_FORMAT_BYTES,
            b"fact" => MOST_FACT_BYTES,
            b"ds64" => {
                let content = take(file, padded).map_err(failed)?;
                // The length of the whole file comes first.
                let bytes = content.get(8..).and_then(<[u8]>::first_chunk::<8>);
                self.long_bytes = bytes.map(|bytes| u64::from_le_bytes(*bytes));
                return Ok(());
            }
            _ => return skip(file, padded).map_err(failed),
        };
        if length > most {
            let problem = format!(
                "its header has a part '{}' of {length} bytes, where {most} can be: convert it again",
                id.escape_ascii()
            );
            return Err(Error::file(path, problem));
        }
        let content = take(file, padded).map_err(failed)?;
        if id == *b"fmt " {
            check_format(path, &content)?;
            let word = |at: usize| {
                let bytes = content.get(at..)?.first_chunk::<2>()?;
                Some(u16::from_le_bytes(*bytes))
            };
            let tag = match word(0) {
                Some(EXTENSIBLE) => word(EXTENDED_FORMAT),
                tag => tag,
            };
            self.are_integers = tag == Some(PCM);
            self.frame_bytes = word(12).map_or(0, u64::from);
        }
        self.chunks.extend(chunk);
        self.chunks.extend(content);
        Ok(())
    }
}

/// Checks the numbers of a format chunk that determine the size of the reader's memory. A chunk that is too short is
/// left for that reader to refuse.
fn check_format(path: &Path, format: &[u8]) -> Result<()> {
    let [_, _, c0, c1, r0, r1, r2, r3, _, _, _, _, b0, b1, ..] = *format else {
        return Ok(());
    };
    let channels = usize::from(u16::from_le_bytes([c0, c1]));
    let rate_hz = u32::from_le_bytes([r0, r1, r2, r3]);
    let frame_bytes = usize::from(u16::from_le_bytes([b0, b1]));
    if channels == 0 || channels > MAX_CHANNELS {
        let problem = format!(
            "{channels} channels: give 1 to {MAX_CHANNELS}, one per axis; `sox FILE.wav OUT.wav remix 1 2 3` keeps the \
             first three"
        );
        return Err(Error::file(path, problem));
    }
    if frame_bytes > channels * MOST_SAMPLE_BYTES {
        let problem = format!(
            "its header declares {frame_bytes} bytes for one sample of {}: convert it again",
            counted(channels, "channel")
        );
        return Err(Error::file(path, problem));
    }
    let remedy = "mend its header, or convert it again";
    let refused = |fault| Error::file(path, format!("its header states {fault}"));
    SampleRate::new(f64::from(rate_hz), remedy).map(drop).map_err(refused)
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

fn skip(file: &mut BufReader<Opened>, count: u64) -> std::io::Result<()> {
    file.seek(SeekFrom::Current(count.cast_signed())).map(drop)
}
