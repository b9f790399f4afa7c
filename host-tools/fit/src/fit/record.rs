//! The record of a fit: the options and the recordings that a library was fitted to, so that a later evaluation can
//! exclude them.
//!
//! Recordings are identified by content: by a hash of the file's bytes, even if the file's name or folder has changed,
//! and by the part of it that was used. The record is a file next to the library. It identifies the library by its
//! content, too, so that a record of another library is ignored.

use std::collections::HashMap;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::ser::{Formatter, Serializer};
use stylus_signals::recording::{RecordingSet, TimeUnit, Trial};
use stylus_support::atomic_file;
use stylus_support::bounded_file::Format;
use stylus_support::fnv::Fnv;
use stylus_support::in_order::in_order;
use stylus_support::names::portable;
use stylus_support::{Error, Result};

use super::excitation::ExcitationReport;
use super::fitted::Fit;
use super::lines::Findings;
use super::options::Options;

/// Ending that is appended to the name of a library's file to name its record.
const ENDING: &str = ".fit.json";

/// The options and the recordings of a fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FitRecord {
    /// Version of the program that made the fit.
    pub version: String,
    /// Hash of the library's bytes, in hexadecimal digits.
    pub library: String,
    /// Options of the fit.
    pub options: Options,
    /// The excitation of each texture, and the reasons for it.
    pub excitations: Vec<ExcitationReport>,
    /// The recordings.
    pub trials: Vec<FittedTrial>,
    /// Lines of each texture, or the reason for finding none.
    pub lines: Vec<FoundLines>,
}

/// Lines of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundLines {
    /// Name of the texture.
    pub texture: String,
    /// Lines of the texture, or the reason for finding none.
    pub findings: Findings,
}

impl FoundLines {
    /// Returns the lines of each texture of `fit`.
    pub fn of(fit: &Fit) -> Vec<Self> {
        fit.textures
            .iter()
            .map(|texture| Self {
                texture: texture.name.clone(),
                findings: texture.lines.clone(),
            })
            .collect()
    }
}

/// A recording that a library was fitted to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedTrial {
    /// The file, as it was named in the fit.
    pub file: String,
    /// Hash of the file's bytes, in hexadecimal digits.
    pub content: String,
    /// Start of the used part, s.
    pub start_s: f64,
    /// Longest duration of the used part, s; `None` if it was not given or the part extends to the end.
    pub duration_s: Option<f64>,
    /// The file's own sample rate, Hz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_rate_hz: Option<f64>,
    /// Acceleration of a sample value of 1 that the user gave, m/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale_m_s2: Option<f64>,
    /// Unit of the file's times that the user gave.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// True if the user asked to treat the samples as evenly spaced.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub even_times: bool,
    /// Changes made when reading, such as of a unit, and findings of triage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

impl FitRecord {
    /// Returns the record of a fit of `set` with `options` that produced the library `bytes`. It does not yet hold the
    /// excitations and lines.
    pub fn of(set: &RecordingSet, options: &Options, bytes: &[u8]) -> Result<Self> {
        let contents = in_order(&set.trials, content_of)?;
        Ok(Self::with_contents(set, options, bytes, &contents))
    }

    /// Returns the record of `fit`, which was made with `options` from the strokes in `files` and produced the library
    /// `bytes`. `scale_m_s2` is the acceleration of a sample value of 1 that the user gave, m/s².
    pub fn of_strokes(
        files: &[PathBuf],
        scale_m_s2: Option<f64>,
        fit: &Fit,
        options: &Options,
        bytes: &[u8],
    ) -> Result<Self> {
        // The trials of the fit are not in files; the strokes are.
        let texture = fit.textures.first().map_or("", |texture| &texture.name);
        let trials = files.iter().map(|path| Trial {
            scale_m_s2,
            ..Trial::of(path, texture, 0.0, 0.0)
        });
        let set = RecordingSet {
            trials: trials.collect(),
            is_listed: true,
        };
        Ok(Self {
            excitations: rounded(&fit.excitations()),
            lines: rounded(&FoundLines::of(fit)),
            ..Self::of(&set, options, bytes)?
        })
    }

    /// Like [`FitRecord::of`], but takes the hashes of the recordings' bytes, in the order of the set.
    pub fn with_contents(set: &RecordingSet, options: &Options, bytes: &[u8], contents: &[u64]) -> Self {
        let trials = set.trials.iter().zip(contents);
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            library: content_hash(bytes),
            options: options.clone(),
            excitations: Vec::new(),
            trials: trials
                .map(|(trial, &content)| FittedTrial::with_content(trial, content))
                .collect(),
            lines: Vec::new(),
        }
    }

    /// Adds the results of `fit`, a fit of the same set: excitations, lines, and each trial's sample rate, remarks and
    /// verdicts.
    #[must_use]
    pub fn with_account_of(mut self, fit: &Fit) -> Self {
        for (trial, report) in self.trials.iter_mut().zip(&fit.trials) {
            trial.source_rate_hz = Some(report.source_rate_hz);
            let verdicts = report.verdicts.iter().map(ToString::to_string);
            trial.remarks = report.remarks.iter().cloned().chain(verdicts).collect();
        }
        Self {
            excitations: rounded(&fit.excitations()),
            lines: rounded(&FoundLines::of(fit)),
            ..self
        }
    }

    /// Returns the first acceleration of a sample value of 1 that the user gave for the fit, m/s².
    pub fn given_scale_m_s2(&self) -> Option<f64> {
        self.trials.iter().find_map(|trial| trial.scale_m_s2)
    }

    /// Returns the path of the record of the library at `library`.
    pub fn path_for(library: &Path) -> PathBuf {
        let mut name = library.as_os_str().to_owned();
        name.push(ENDING);
        PathBuf::from(name)
    }

    /// Reads the record next to the library at `path`, whose content is `bytes`. `None` if there is no record, or it is
    /// of another library.
    pub fn beside(path: &Path, bytes: &[u8]) -> Result<Option<Self>> {
        let path = Self::path_for(path);
        let text = match Format::Record.read(&path) {
            Ok(text) => text,
            Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
                return Ok(None);
            }
            Err(failure) => return Err(failure),
        };
        let record = Self::from_text(&path, &text)?;
        Ok(Some(record).filter(|record| record.is_of(bytes)))
    }

    /// Returns true if this is the record of the library with these `bytes`.
    pub fn is_of(&self, bytes: &[u8]) -> bool {
        self.library == content_hash(bytes)
    }

    /// Reads a record from `text`; `path` is only named in errors.
    pub fn from_text(path: &Path, text: &[u8]) -> Result<Self> {
        serde_json::from_slice(text).map_err(|failure| {
            let problem = format!("is no record of a fit ({failure}): remove it, or fit again");
            Error::file(path, problem)
        })
    }

    /// Returns `set` as the fit read it: with the speeds and forces that the fit used. A recording without a scale, a
    /// unit of times or a statement on even times gets those that the user gave for the fit.
    pub fn as_fitted(&self, mut set: RecordingSet) -> Result<RecordingSet> {
        let told: HashMap<&str, &FittedTrial> = self
            .trials
            .iter()
            .filter(|own| own.was_told())
            .map(|own| (own.content.as_str(), own))
            .collect();
        if !told.is_empty() {
            // Hashing reads all files, so it is only done if the fit was told something.
            let contents = in_order(&set.trials, content_of)?;
            for (trial, content) in set.trials.iter_mut().zip(contents) {
                if let Some(fitted) = told.get(digits(content).as_str()) {
                    fitted.tell(trial);
                }
            }
        }
        Ok(set.snapped(self.options.snap)?.0)
    }

    /// Returns the record as text.
    ///
    /// # Errors
    /// None for records that [`Self::of`] returns.
    pub fn to_text(&self) -> Result<String> {
        serde_json::to_string_pretty(self).map_err(|failure| Error::Request(failure.to_string()))
    }

    /// Writes the library `bytes` to `library` and this record next to it. Neither gets its name before both are on the
    /// disk.
    ///
    /// The library gets its final name first, because a record that is missing, or is of an earlier library, is
    /// ignored.
    ///
    /// # Errors
    /// A file that cannot be written. If the record cannot get its name, the new library stays.
    pub fn write_with(&self, library: &Path, bytes: &[u8]) -> Result<()> {
        let text = self.to_text()?;
        let record = Self::path_for(library);
        atomic_file::write_together(&[(library, bytes), (&record, text.as_bytes())])
    }

    /// Returns whether the fit used a part of `trial`, even if its file had another name.
    pub fn used(&self, trial: &Trial) -> Result<bool> {
        let asked = FittedTrial::of(trial)?;
        Ok(self
            .trials
            .iter()
            .any(|used| used.content == asked.content && used.overlaps(&asked)))
    }
}

impl FittedTrial {
    fn of(trial: &Trial) -> Result<Self> {
        Ok(Self::with_content(trial, content_of(trial)?))
    }

    /// Returns the entry of a trial whose recording's bytes have the hash `content`.
    fn with_content(trial: &Trial, content: u64) -> Self {
        Self {
            file: portable(&trial.file),
            content: digits(content),
            start_s: trial.start_s,
            duration_s: trial.duration_s,
            source_rate_hz: None,
            scale_m_s2: trial.scale_m_s2,
            time_unit: trial.time_unit,
            even_times: trial.has_even_times.unwrap_or(false),
            remarks: Vec::new(),
        }
    }

    /// Returns true if the user said how to read the recording.
    fn was_told(&self) -> bool {
        self.scale_m_s2.is_some() || self.time_unit.is_some() || self.even_times
    }

    /// Adds what the user said on how to read the recording to `trial`, of the same recording, unless the trial says it
    /// itself.
    fn tell(&self, trial: &mut Trial) {
        trial.scale_m_s2 = trial.scale_m_s2.or(self.scale_m_s2);
        trial.time_unit = trial.time_unit.or(self.time_unit);
        let even_times = self.even_times.then_some(true);
        trial.has_even_times = trial.has_even_times.or(even_times);
    }

    /// Returns whether two parts of one file overlap.
    fn overlaps(&self, other: &Self) -> bool {
        // A part without a duration extends to the end of the file.
        let end_s = |part: &Self| part.start_s + part.duration_s.unwrap_or(f64::INFINITY);
        self.start_s < end_s(other) && other.start_s < end_s(self)
    }
}

/// Number of significant digits of a record's figures. Further ones depend on the sine and logarithm of the system.
const DIGITS: usize = 6;

/// Returns `figures` with [`DIGITS`] significant digits, so that every system writes the same record.
fn rounded<T: Clone + Serialize + DeserializeOwned>(figures: &T) -> T {
    let mut text = Vec::new();
    let written = figures.serialize(&mut Serializer::with_formatter(&mut text, Rounded));
    // Figures that JSON cannot hold stay as they are.
    written
        .and_then(|()| serde_json::from_slice(&text))
        .unwrap_or_else(|_| figures.clone())
}

/// Writes JSON with rounded figures.
struct Rounded;

impl Formatter for Rounded {
    fn write_f64<W: ?Sized + Write>(&mut self, writer: &mut W, figure: f64) -> io::Result<()> {
        write!(writer, "{figure:.*e}", DIGITS - 1)
    }

    fn write_f32<W: ?Sized + Write>(&mut self, writer: &mut W, figure: f32) -> io::Result<()> {
        self.write_f64(writer, figure.into())
    }
}

/// Returns the hash of `bytes` in hexadecimal digits.
fn content_hash(bytes: &[u8]) -> String {
    digits(Fnv::default().then_words(bytes).value())
}

fn digits(hash: u64) -> String {
    format!("{hash:016x}")
}

/// Hash of the bytes of a trial's recording, or of its samples in memory.
pub(super) fn content_of(trial: &Trial) -> Result<u64> {
    if let Some(held) = &trial.held {
        return Ok(held.content());
    }
    let mut file = Format::Wave.open(&trial.file)?;
    // Read in whole pieces, because a recording may have gigabytes, and a hash of words depends on where pieces end.
    let (mut buffer, mut hash) = (Vec::with_capacity(PIECE), Fnv::default());
    loop {
        let piece = file.by_ref().take(PIECE as u64).read_to_end(&mut buffer);
        if piece.map_err(Error::io("read", &trial.file))? == 0 {
            return Ok(hash.value());
        }
        hash = hash.then_words(&buffer);
        buffer.clear();
    }
}

/// Number of bytes of a recording that are read at a time.
const PIECE: usize = 1 << 16;

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_signals::recording::HeldSamples;

    #[test]
    fn figures_that_differ_by_the_systems_sine_are_recorded_alike() {
        let figures = |value: f64| (value, [Some(-value)], 7_u64, "words".to_owned());
        let one = rounded(&figures(2.903_872_438_705_361));
        assert_eq!(one, rounded(&figures(2.903_872_438_705_264_3)));
        assert_eq!(one, figures(2.903_87));
    }

    fn trial(file: PathBuf, start_s: f64, duration_s: Option<f64>) -> Trial {
        Trial {
            start_s,
            duration_s,
            ..Trial::of(file, "felt", 100.0, 1.0)
        }
    }

    #[test]
    fn a_recording_is_known_by_its_content_and_its_part_under_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, content: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            path
        };
        let fitted = put("a.wav", "one");
        let (copy, other) = (put("b.wav", "one"), put("c.wav", "two"));
        let set = RecordingSet {
            trials: vec![trial(fitted.clone(), 1.0, Some(2.0))],
            is_listed: true,
        };
        let record = FitRecord::of(&set, &Options::default(), b"library").unwrap();
        for (file, start_s, duration_s, used) in [
            (&fitted, 1.0, Some(2.0), true),
            (&copy, 0.0, None, true),
            (&copy, 2.5, Some(2.0), true),
            (&copy, 3.0, Some(2.0), false),
            (&copy, 0.0, Some(1.0), false),
            (&other, 1.0, Some(2.0), false),
        ] {
            let asked = trial(file.clone(), start_s, duration_s);
            assert_eq!(record.used(&asked).unwrap(), used, "{asked:?}");
        }
    }

    #[test]
    fn a_recording_is_read_as_the_fit_was_told_unless_it_says_otherwise_itself() {
        let folder = tempfile::tempdir().unwrap();
        let of = |name: &str, scale_m_s2| {
            let file = folder.path().join(name);
            std::fs::write(&file, name).unwrap();
            Trial {
                scale_m_s2,
                ..trial(file, 0.0, None)
            }
        };
        let set = |trials: Vec<Trial>| RecordingSet {
            trials,
            is_listed: true,
        };
        let told = Trial {
            time_unit: Some(TimeUnit::Ms),
            has_even_times: Some(true),
            ..of("a", Some(9.8))
        };
        let record = FitRecord::of(&set(vec![told.clone()]), &Options::default(), b"").unwrap();
        let own = Trial {
            time_unit: Some(TimeUnit::Ms),
            has_even_times: Some(true),
            ..of("a", Some(2.0))
        };
        for (asked, read) in [
            (of("a", None), told),
            (own.clone(), own),
            (of("b", None), of("b", None)),
        ] {
            assert_eq!(record.as_fitted(set(vec![asked])).unwrap().trials, [read]);
        }
    }

    #[test]
    fn samples_in_memory_are_known_by_content_and_part_too() {
        let held = |samples: Vec<f64>, start_s| Trial {
            held: Some(HeldSamples::new(5000.0, vec![samples], false).unwrap().into()),
            ..trial("in memory".into(), start_s, Some(0.5))
        };
        let samples: Vec<f64> = (0..5000).map(f64::from).collect();
        let set = RecordingSet {
            trials: vec![held(samples.clone(), 0.0)],
            is_listed: true,
        };
        let record = FitRecord::of(&set, &Options::default(), b"library").unwrap();
        assert!(record.used(&held(samples.clone(), 0.25)).unwrap());
        assert!(!record.used(&held(samples.clone(), 0.5)).unwrap());
        let mut others = samples;
        others[4999] += 1.0;
        assert!(!record.used(&held(others, 0.0)).unwrap());
    }

    #[test]
    fn a_record_of_another_library_is_not_believed() {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("a.lib");
        assert!(FitRecord::beside(&library, b"one").unwrap().is_none());
        let set = RecordingSet {
            trials: Vec::new(),
            is_listed: true,
        };
        let record = FitRecord::of(&set, &Options::default(), b"one").unwrap();
        std::fs::write(FitRecord::path_for(&library), record.to_text().unwrap()).unwrap();
        assert!(FitRecord::beside(&library, b"one").unwrap().is_some());
        assert!(FitRecord::beside(&library, b"two").unwrap().is_none());
        std::fs::write(FitRecord::path_for(&library), "{").unwrap();
        assert!(FitRecord::beside(&library, b"one").is_err());
    }
}
