//! The format of a partial file.
//!
//! A file is a row of frames. A frame is the length of its content (u32, little-endian), the content, and the content's
//! FNV-1a hash (u64, little-endian). The content of the first is a [`Header`], of those between a [`UnitHead`] and a
//! [`StoredUnit`], of the last an [`End`], each as [postcard](https://postcard.jamesmunns.com/wire-format) writes it
//! after a byte for the kind. Reading is strict: nothing may be missing, damaged, doubled or left over.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::Shard;
use super::identity::{MADE_BY, MapOptions, Stamp};
use crate::fit::lines::{Findings, Line, NoLines};
use crate::fit::trial::Analysis;
use crate::support::bounded_file::Limit;
use crate::support::error::{Error, Result};
use crate::support::fnv::Fnv;

/// First bytes of a header's content.
const MAGIC: [u8; 8] = *b"stylus-p";

/// Version of the format. It changes with anything that a file holds, and with whatever the map computes.
const VERSION: u16 = 1;

/// Largest content of a frame, bytes: 16 000 trials of a texture with lines.
const MOST_BYTES: u32 = 1 << 28;

/// A partial file, which is read frame by frame and has as many as there are trials.
const PARTIAL: Limit = Limit {
    of: "a partial result",
    bytes: u64::MAX,
};

/// The shard that a file is of, and its inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Header {
    magic: [u8; 8],
    version: u16,
    made_by: String,
    pub options: MapOptions,
    /// Identity of the set.
    pub set: u64,
    /// Trials of the set.
    pub trials: u64,
    pub shard: Shard,
}

impl Header {
    pub fn new(options: MapOptions, set: u64, trials: usize, shard: Shard) -> Self {
        Self {
            magic: MAGIC,
            version: VERSION,
            made_by: MADE_BY.to_owned(),
            options,
            set,
            trials: trials as u64,
            shard,
        }
    }
}

/// A unit's number and the identity of its inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct UnitHead {
    pub number: u64,
    pub identity: u64,
}

/// A trial as the map leaves it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct StoredTrial {
    pub stamp: Stamp,
    /// Hash of the recording's bytes, for the record of the fit.
    pub content: u64,
    pub analysis: Analysis,
}

/// A unit as the map leaves it: its trials in their order, and the lines of their texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct StoredUnit {
    findings: StoredFindings,
    trials: Vec<StoredTrial>,
}

/// [`Findings`] without the attributes that a text needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredFindings {
    lines: Vec<StoredLine>,
    time_locked_hz: Vec<f64>,
    speed_scatter: Option<f64>,
    followed_trials: u64,
    none_because: Option<NoLines>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredLine {
    wavelength_mm: f64,
    phase_turns: f64,
    harmonic_of: Option<(u64, u32)>,
    phase_agreement: f64,
    shown_at_speeds: (u64, u64),
    amplitude_range_m_s2: (f64, f64),
}

impl StoredUnit {
    pub fn of(trials: Vec<StoredTrial>) -> Self {
        let findings = trials.first().map(|trial| &trial.analysis.lines.findings);
        let Findings {
            lines,
            time_locked_hz,
            speed_scatter,
            followed_trials,
            none_because,
        } = findings.map_or_else(Findings::default, |findings| findings.as_ref().clone());
        let line = |line: Line| StoredLine {
            wavelength_mm: line.wavelength_mm,
            phase_turns: line.phase_turns,
            harmonic_of: line.harmonic_of.map(|(of, n)| (of as u64, n)),
            phase_agreement: line.phase_agreement,
            shown_at_speeds: (line.shown_at_speeds.0 as u64, line.shown_at_speeds.1 as u64),
            amplitude_range_m_s2: line.amplitude_range_m_s2,
        };
        Self {
            findings: StoredFindings {
                lines: lines.into_iter().map(line).collect(),
                time_locked_hz,
                speed_scatter,
                followed_trials: followed_trials as u64,
                none_because,
            },
            trials,
        }
    }

    /// The trials, each with the lines of their texture.
    pub fn into_trials(self) -> Vec<StoredTrial> {
        let found = self.findings;
        let line = |line: StoredLine| Line {
            wavelength_mm: line.wavelength_mm,
            phase_turns: line.phase_turns,
            harmonic_of: line.harmonic_of.map(|(of, n)| (of as usize, n)),
            phase_agreement: line.phase_agreement,
            shown_at_speeds: (
                line.shown_at_speeds.0 as usize,
                line.shown_at_speeds.1 as usize,
            ),
            amplitude_range_m_s2: line.amplitude_range_m_s2,
        };
        let findings = Arc::new(Findings {
            lines: found.lines.into_iter().map(line).collect(),
            time_locked_hz: found.time_locked_hz,
            speed_scatter: found.speed_scatter,
            followed_trials: found.followed_trials as usize,
            none_because: found.none_because,
        });
        let mut trials = self.trials;
        for trial in &mut trials {
            trial.analysis.lines.findings = Arc::clone(&findings);
        }
        trials
    }
}

/// The end of a file that is whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct End {
    /// Number of units before it.
    pub units: u64,
    /// Hash of the hashes of all frames before it.
    pub all: u64,
}

/// Kinds of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Header = 0,
    Unit = 1,
    End = 2,
}

/// A frame of `kind` with `content`.
///
/// # Errors
/// A content that is too large.
pub(super) fn frame(kind: Kind, content: &[&[u8]]) -> Result<Vec<u8>> {
    let length = 1 + content.iter().map(|part| part.len()).sum::<usize>();
    let most = MOST_BYTES as usize;
    if length > most {
        return Err(Error::Model(format!(
            "the trials of one texture take {length} bytes of a partial file, and a part of it holds {most}: fit with \
             --lines none, or make several textures of it"
        )));
    }
    let mut bytes = Vec::with_capacity(length + 12);
    bytes.extend((length as u32).to_le_bytes());
    bytes.push(kind as u8);
    content
        .iter()
        .for_each(|part| bytes.extend_from_slice(part));
    let hash = Fnv::of(&bytes[4..]);
    bytes.extend(hash.to_le_bytes());
    Ok(bytes)
}

/// A frame as it was read.
pub(super) struct Frame {
    /// First byte in the file, and the one after its last.
    pub place: std::ops::Range<u64>,
    pub hash: u64,
    content: Vec<u8>,
}

/// Faults of a frame, without the file.
pub(super) enum Fault {
    /// The file ends here, between two frames.
    Ended,
    /// The bytes from here on are no frame.
    Damaged,
    /// The system's.
    Io(std::io::Error),
}

/// Reads a partial file frame by frame.
pub(super) struct Reader {
    pub path: PathBuf,
    file: BufReader<File>,
    at: u64,
    size: u64,
    /// Hash of the hashes of all frames before the last one that was read, and with it.
    all: (Fnv, Fnv),
}

impl Reader {
    pub fn open(path: &Path) -> Result<Self> {
        let file = PARTIAL.open(path)?;
        let size = file.metadata().map_err(Error::io("read", path))?.len();
        Ok(Self {
            path: path.to_owned(),
            file: BufReader::with_capacity(1 << 16, file),
            at: 0,
            size,
            all: Default::default(),
        })
    }

    /// Reads the frame at `place`, which was read before.
    pub fn frame_at(&mut self, place: &std::ops::Range<u64>) -> Result<Frame> {
        self.file
            .seek(SeekFrom::Start(place.start))
            .map_err(Error::io("read", &self.path))?;
        self.at = place.start;
        match self.next() {
            Ok(frame) if frame.place == *place => Ok(frame),
            Ok(_) | Err(Fault::Ended | Fault::Damaged) => Err(self.damaged(place.start)),
            Err(Fault::Io(source)) => Err(Error::io("read", &self.path)(source)),
        }
    }

    /// Reads the next frame.
    pub fn next(&mut self) -> std::result::Result<Frame, Fault> {
        let begin = self.at;
        if begin == self.size {
            return Err(Fault::Ended);
        }
        let mut length = [0; 4];
        let mut hash = [0; 8];
        let left = self.size - begin;
        if left < 13 {
            return Err(Fault::Damaged);
        }
        self.file.read_exact(&mut length).map_err(Fault::Io)?;
        let length = u32::from_le_bytes(length);
        if length == 0 || length > MOST_BYTES || u64::from(length) + 12 > left {
            return Err(Fault::Damaged);
        }
        let mut content = vec![0; length as usize];
        self.file.read_exact(&mut content).map_err(Fault::Io)?;
        self.file.read_exact(&mut hash).map_err(Fault::Io)?;
        let hash = u64::from_le_bytes(hash);
        if Fnv::of(&content) != hash {
            return Err(Fault::Damaged);
        }
        self.at += u64::from(length) + 12;
        self.all = (self.all.1, self.all.1.then(&hash.to_le_bytes()));
        Ok(Frame {
            place: begin..self.at,
            hash,
            content,
        })
    }

    /// Reads the next frame of a file that has one.
    pub fn expect(&mut self) -> Result<Frame> {
        let begin = self.at;
        self.next().map_err(|fault| match fault {
            Fault::Ended => Error::file(
                &self.path,
                "ends before its last part: it is of a shard that was not finished; run it again",
            ),
            Fault::Damaged => self.damaged(begin),
            Fault::Io(source) => Error::io("read", &self.path)(source),
        })
    }

    /// Reads the header of a file of this format and version, made by this version of the program.
    pub fn header(&mut self) -> Result<Header> {
        let frame = self.expect()?;
        let foreign = || Error::file(&self.path, "is no partial result of a fit");
        let content = frame.of_kind(Kind::Header).ok_or_else(foreign)?;
        // Magic and version come first, because all that follows may be another in another version.
        let (magic, rest) = postcard::take_from_bytes::<[u8; 8]>(content).map_err(|_| foreign())?;
        let (version, rest) = postcard::take_from_bytes::<u16>(rest).map_err(|_| foreign())?;
        let made_by = postcard::take_from_bytes::<String>(rest);
        if magic != MAGIC {
            return Err(foreign());
        }
        let made_by = made_by.map_or_else(|_| "another version".to_owned(), |(made_by, _)| made_by);
        if version != VERSION || made_by != MADE_BY {
            let problem = format!(
                "was made by stylus {made_by} in format {version}, and this is stylus {MADE_BY} with format {VERSION}: \
                 run all shards with one version"
            );
            return Err(Error::file(&self.path, problem));
        }
        let header: Header = self.decoded(content)?;
        // Its numbers size what is made for all shards.
        if header.shard.is_sound() {
            Ok(header)
        } else {
            Err(foreign())
        }
    }

    /// Decodes the whole of `bytes`.
    pub fn decoded<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T> {
        if let Ok((value, [])) = postcard::take_from_bytes(bytes) {
            return Ok(value);
        }
        let problem = "holds a part that cannot be understood: remove it, and run its shard again";
        Err(Error::file(&self.path, problem))
    }

    /// Returns whether nothing is left to read.
    pub fn is_at_end(&self) -> bool {
        self.at == self.size
    }

    /// Hash of the hashes of all frames before the last one that was read.
    pub fn all_before(&self) -> u64 {
        self.all.0.value()
    }

    fn damaged(&self, at: u64) -> Error {
        let problem = format!("is damaged at byte {at}: remove it, and run its shard again");
        Error::file(&self.path, problem)
    }
}

impl Frame {
    /// The content after the kind, if it is `kind`.
    pub fn of_kind(&self, kind: Kind) -> Option<&[u8]> {
        let (&first, rest) = self.content.split_first()?;
        (first == kind as u8).then_some(rest)
    }

    /// The head of a unit and the bytes after it.
    pub fn unit(&self) -> Option<(UnitHead, &[u8])> {
        postcard::take_from_bytes(self.of_kind(Kind::Unit)?).ok()
    }
}
