//! The chunks of a WAV file, as far as its samples need them.
//!
//! The reader of samples gets the format and the samples alone. Chunks of titles, pictures and cue points never reach
//! it, and every length that a header states is compared with the file before anything is sized by it.

use std::fs::File;
use std::io::{BufReader, Chain, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use super::rate::rate_fault;
use super::source::{MAX_CHANNELS, RECORDING};
use crate::support::error::{Error, Result};
use crate::support::number::counted;

/// Longest format chunk, bytes; the extensible format takes 40.
const MOST_FORMAT_BYTES: u32 = 128;

/// Longest chunk of facts, bytes.
const MOST_FACT_BYTES: u32 = 128;

/// Most chunks before the samples.
const MOST_CHUNKS: usize = 1000;

/// Widest sample, bytes: a float of double precision.
const MOST_SAMPLE_BYTES: usize = 8;

/// The file's format and samples, as a WAV file of their own.
pub(super) type Samples = Chain<Cursor<Vec<u8>>, BufReader<File>>;

/// Opens the WAV file at `path`, and checks what its header says of itself.
///
/// A file whose samples are fewer than declared passes; that is for the reader of the samples to judge.
///
/// # Errors
/// A file that cannot be read, a chunk that is longer than the file, and a format that no recording has.
pub(super) fn open(path: &Path) -> Result<Samples> {
    let failed = |failure| Error::io("read", path)(failure);
    let file = RECORDING.open(path)?;
    let mut left = file.metadata().map_err(failed)?.len();
    let mut file = BufReader::new(file);
    let mut header = take(&mut file, 12).map_err(failed)?;
    left = left.saturating_sub(12);
    let is_wav = header.starts_with(b"RIFF") && header.get(8..) == Some(b"WAVE");
    for _ in 0..if is_wav { MOST_CHUNKS } else { 0 } {
        let chunk = take(&mut file, 8).map_err(failed)?;
        left = left.saturating_sub(8);
        let Some((id, length)) = head(&chunk) else {
            // The reader of samples says what is missing.
            header.extend(chunk);
            return Ok(Cursor::new(header).chain(file));
        };
        if id == *b"data" {
            header.extend(chunk);
            return Ok(Cursor::new(header).chain(file));
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
        let most = match &id {
            b"fmt " => MOST_FORMAT_BYTES,
            b"fact" => MOST_FACT_BYTES,
            _ => {
                skip(&mut file, padded).map_err(failed)?;
                continue;
            }
        };
        if length > most {
            let problem = format!(
                "its header has a part '{}' of {length} bytes, where {most} can be: convert it again",
                id.escape_ascii()
            );
            return Err(Error::file(path, problem));
        }
        let content = take(&mut file, padded).map_err(failed)?;
        if id == *b"fmt " {
            check_format(path, &content)?;
        }
        header.extend(chunk);
        header.extend(content);
    }
    if is_wav {
        let problem =
            format!("has more than {MOST_CHUNKS} parts before its samples: convert it again");
        return Err(Error::file(path, problem));
    }
    Ok(Cursor::new(header).chain(file))
}

/// Formats of samples in a WAV file's header: integers, and those that an extension names.
const PCM: u16 = 1;
const EXTENSIBLE: u16 = 0xfffe;

/// First byte of the extension's own format, in a format chunk.
const EXTENDED_FORMAT: usize = 24;

/// Returns whether the file at `path` is a WAV file of integer samples, whose full scale no file tells.
pub fn holds_integers(path: &Path) -> bool {
    let Ok(samples) = open(path) else {
        return false;
    };
    let (header, _) = samples.into_inner();
    let header = header.into_inner();
    let Some(format) = header.windows(4).position(|id| id == b"fmt ") else {
        return false;
    };
    let word = |at: usize| {
        let bytes = header.get(format + 8 + at..)?.first_chunk::<2>()?;
        Some(u16::from_le_bytes(*bytes))
    };
    match word(0) {
        Some(EXTENSIBLE) => word(EXTENDED_FORMAT) == Some(PCM),
        tag => tag == Some(PCM),
    }
}

/// Checks the numbers of a format chunk that size the reader's memory. Fewer bytes are for that reader to refuse.
fn check_format(path: &Path, format: &[u8]) -> Result<()> {
    let [_, _, c0, c1, r0, r1, r2, r3, _, _, _, _, b0, b1, ..] = *format else {
        return Ok(());
    };
    let channels = usize::from(u16::from_le_bytes([c0, c1]));
    let rate_hz = u32::from_le_bytes([r0, r1, r2, r3]);
    let frame_bytes = usize::from(u16::from_le_bytes([b0, b1]));
    if channels == 0 || channels > MAX_CHANNELS {
        let problem = format!("{channels} channels: give 1 to {MAX_CHANNELS}, one per axis");
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
    rate_fault(f64::from(rate_hz), remedy).map_or(Ok(()), |fault| {
        Err(Error::file(path, format!("its header states {fault}")))
    })
}

/// Splits the head of a chunk: its name and the length of its content.
fn head(chunk: &[u8]) -> Option<([u8; 4], u32)> {
    let (id, length) = chunk.split_first_chunk::<4>()?;
    Some((*id, u32::from_le_bytes(length.try_into().ok()?)))
}

/// Reads `count` bytes, or those up to the end.
fn take(file: &mut impl Read, count: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn skip(file: &mut BufReader<File>, count: u64) -> std::io::Result<()> {
    file.seek(SeekFrom::Current(count.cast_signed())).map(drop)
}
