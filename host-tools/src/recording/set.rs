//! Which recordings belong to which texture, speed and force: `trials.csv`, or files given one by one.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use csv::StringRecord;
use model_format::Provenance;

use crate::support::error::{Error, Result};

/// The list of trials in a recording set's folder.
pub const TRIALS_FILE: &str = "trials.csv";

/// Speed that stands for a recording whose speed is not known, mm/s.
pub const NOMINAL_SPEED_MM_S: f64 = 100.0;

/// Force that stands for a recording whose force is not known, N.
pub const NOMINAL_FORCE_N: f64 = 1.0;

/// One recording of one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The WAV or CSV file.
    pub file: PathBuf,
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Acceleration that a sample of 1 stands for (full scale of integer samples), m/s².
    pub scale_m_s2: f64,
    /// Where the used part begins, s.
    pub start_s: f64,
    /// How long the used part is, s; [`super::TRIAL_DURATION_S`] at most if not given.
    pub duration_s: Option<f64>,
    /// Sample rate of a CSV file that has no time column, Hz.
    pub sample_rate_hz: Option<f64>,
    /// Whether it was recorded or simulated.
    pub provenance: Provenance,
}

/// Trials, in the order of their list.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingSet {
    /// The trials, at least one.
    pub trials: Vec<Trial>,
    /// Whether a list told their speeds and forces; else those are nominal.
    pub is_listed: bool,
}

impl RecordingSet {
    /// Opens what a command line names: one folder with a `trials.csv`, one such list, or recordings, each of which is
    /// then a texture of its own (named like the file) at the nominal speed and force.
    ///
    /// # Errors
    /// What is not there, has no trials, or has a line that cannot be used, with its number.
    pub fn open(inputs: &[PathBuf]) -> Result<Self> {
        let set = match inputs {
            [] => return Err(Error::Request("no recordings given".into())),
            [folder] if folder.is_dir() => Self::from_list(&folder.join(TRIALS_FILE))?,
            [list] if list.file_name().is_some_and(|name| name == TRIALS_FILE) => {
                Self::from_list(list)?
            }
            files => Self::from_files(files)?,
        };
        Ok(set)
    }

    fn from_files(files: &[PathBuf]) -> Result<Self> {
        let trials = files.iter().map(|file| {
            if file.is_dir() {
                let problem = "is a folder; give one folder alone, or recordings only";
                return Err(Error::file(file, problem));
            }
            let stem = file.file_stem().unwrap_or_default();
            Ok(Trial {
                file: file.clone(),
                texture: stem.to_string_lossy().into_owned(),
                speed_mm_s: NOMINAL_SPEED_MM_S,
                force_n: NOMINAL_FORCE_N,
                scale_m_s2: 1.0,
                start_s: 0.0,
                duration_s: None,
                sample_rate_hz: None,
                provenance: Provenance::Recorded,
            })
        });
        Ok(Self {
            trials: trials.collect::<Result<Vec<_>>>()?,
            is_listed: false,
        })
    }

    /// Reads a list of trials; its files are relative to its folder.
    ///
    /// # Errors
    /// A list that is missing or empty, or a line that cannot be used, with its number.
    pub fn from_list(list: &Path) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_path(list)
            .map_err(|failure| csv_error(list, failure))?;
        let header = reader
            .headers()
            .map_err(|failure| csv_error(list, failure))?;
        let columns = Columns::of(list, header)?;
        let folder = list.parent().unwrap_or(Path::new("."));
        let mut trials = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|failure| csv_error(list, failure))?;
            trials.push(columns.trial(list, folder, &record)?);
        }
        if trials.is_empty() {
            return Err(Error::file(list, "lists no trials"));
        }
        Ok(Self {
            trials,
            is_listed: true,
        })
    }

    /// The textures' names, each once, in the order of their first trials.
    pub fn textures(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for trial in &self.trials {
            if !names.contains(&trial.texture.as_str()) {
                names.push(&trial.texture);
            }
        }
        names
    }
}

/// Where the columns of a list are.
struct Columns(HashMap<&'static str, usize>);

const REQUIRED: [&str; 4] = ["file", "texture", "speed_mm_s", "force_n"];
const OPTIONAL: [&str; 5] = [
    "scale_m_s2",
    "start_s",
    "duration_s",
    "sample_rate_hz",
    "simulated",
];

impl Columns {
    fn of(list: &Path, header: &StringRecord) -> Result<Self> {
        let line = header.position().map_or(1, csv::Position::line);
        let mut columns = HashMap::new();
        for (index, name) in header.iter().enumerate() {
            let known = REQUIRED.iter().chain(&OPTIONAL).find(|&&k| k == name);
            let Some(&known) = known else {
                let problem = format!(
                    "unknown column '{name}'; there may be {}, {}",
                    REQUIRED.join(", "),
                    OPTIONAL.join(", ")
                );
                return Err(Error::line(list, line, problem));
            };
            if columns.insert(known, index).is_some() {
                return Err(Error::line(
                    list,
                    line,
                    format!("column '{name}' is there twice"),
                ));
            }
        }
        if let Some(missing) = REQUIRED.iter().find(|name| !columns.contains_key(*name)) {
            let problem = format!("no column '{missing}'; the header names the columns");
            return Err(Error::line(list, line, problem));
        }
        Ok(Self(columns))
    }

    fn trial(&self, list: &Path, folder: &Path, record: &StringRecord) -> Result<Trial> {
        let line = record.position().map_or(0, csv::Position::line);
        let bad = |problem: String| Error::line(list, line, problem);
        let field = |name: &str| {
            let index = *self.0.get(name)?;
            record.get(index).filter(|text| !text.is_empty())
        };
        let text = |name: &str| field(name).ok_or_else(|| bad(format!("no {name}")));
        let number = |name: &str| match field(name) {
            None => Ok(None),
            Some(text) => match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(Some(value)),
                _ => Err(bad(format!("{name} '{text}' is not a finite number"))),
            },
        };
        let at_least_zero = |name: &str| match number(name)? {
            Some(value) if value < 0.0 => Err(bad(format!("{name} {value} is negative"))),
            value => Ok(value),
        };
        let above_zero = |name: &str| match number(name)? {
            Some(value) if value <= 0.0 => Err(bad(format!("{name} {value} is not above zero"))),
            value => Ok(value),
        };
        let required = |name: &str| at_least_zero(name)?.ok_or_else(|| bad(format!("no {name}")));
        let provenance = match field("simulated") {
            None | Some("false") => Provenance::Recorded,
            Some("true") => Provenance::Simulated,
            Some(other) => return Err(bad(format!("simulated '{other}' is not true or false"))),
        };
        let scale_m_s2 = number("scale_m_s2")?.unwrap_or(1.0);
        if scale_m_s2.abs() <= 0.0 {
            return Err(bad("scale_m_s2 is zero".into()));
        }
        Ok(Trial {
            file: folder.join(text("file")?),
            texture: text("texture")?.to_owned(),
            speed_mm_s: required("speed_mm_s")?,
            force_n: required("force_n")?,
            scale_m_s2,
            start_s: at_least_zero("start_s")?.unwrap_or(0.0),
            duration_s: above_zero("duration_s")?,
            sample_rate_hz: above_zero("sample_rate_hz")?,
            provenance,
        })
    }
}

/// A failure of the CSV reader as one of ours, with its line.
pub(crate) fn csv_error(path: &Path, failure: csv::Error) -> Error {
    let line = failure.position().map_or(0, csv::Position::line);
    match failure.into_kind() {
        csv::ErrorKind::Io(source) => Error::io("read", path)(source),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => Error::line(
            path,
            line,
            format!("{len} fields where the first line has {expected_len}"),
        ),
        csv::ErrorKind::Utf8 { .. } => Error::line(path, line, "is not text in UTF-8"),
        other => Error::line(path, line, format!("{other:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<RecordingSet> {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join(TRIALS_FILE);
        std::fs::write(&list, text).unwrap();
        RecordingSet::from_list(&list)
    }

    const HEADER: &str = "file,texture,speed_mm_s,force_n,scale_m_s2,start_s\n";

    #[test]
    fn columns_may_come_in_any_order_and_comments_are_skipped() {
        let set =
            parse("# by hand\nforce_n,texture,file,speed_mm_s\n0.5,denim,a.wav,120\n").unwrap();
        let trial = &set.trials[0];
        assert_eq!((trial.speed_mm_s, trial.force_n), (120.0, 0.5));
        assert_eq!(trial.provenance, Provenance::Recorded);
        assert!(trial.file.ends_with("a.wav"));
    }

    #[test]
    fn a_bad_line_is_named_by_its_number() {
        for (line, word) in [
            ("a.wav,denim,fast,1,,", "speed_mm_s"),
            ("a.wav,denim,100,-1,,", "negative"),
            ("a.wav,denim,100,NaN,,", "force_n"),
            ("a.wav,,100,1,,", "texture"),
            (",denim,100,1,,", "file"),
            ("a.wav,denim,100,1,0,", "scale_m_s2"),
            ("a.wav,denim,100,1,,-1", "start_s"),
            ("a.wav,denim,100", "fields"),
        ] {
            let text = format!("{HEADER}a.wav,denim,100,1,,\n{line}\n");
            let message = parse(&text).unwrap_err().to_string();
            assert!(
                message.contains("line 3") && message.contains(word),
                "{message}"
            );
        }
    }

    #[test]
    fn headers_without_their_columns_and_lists_without_trials_are_refused() {
        for (text, word) in [
            ("file,texture,speed_mm_s\n", "force_n"),
            ("file,texture,speed_mm_s,force_n,colour\n", "colour"),
            (HEADER, "no trials"),
            ("", "no column"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }
}
