//! A recording set that grows by one trial at a time, in a folder that a fit reads.
//!
//! A trial is a WAV file of three channels of 32-bit floats. A sample of 1 is the largest acceleration that an axis can
//! show, so that one `scale_m_s2` turns all three channels into m/s², and none is beyond 1. The trial's line in
//! `trials.csv` is written after its file, so that an interruption at any time leaves a valid set.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use model_format::Provenance;
use model_format::limits::MAX_NAME_BYTES;
use stylus_signals::recording::{MOST_TRIALS, RecordingSet, TRIALS_FILE, Trial};
use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, is_content, written};
use stylus_support::float_wav::float_wav;
use stylus_support::number::{force_fault, speed_fault};
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, names};

use crate::link::capture::{Calibration, Capture};

/// A trial to be recorded: one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedTrial {
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
}

impl PlannedTrial {
    /// The trials of a grid: every speed with every force.
    pub fn grid(texture: &str, speeds_mm_s: &[f64], forces_n: &[f64]) -> Vec<Self> {
        let at = |speed_mm_s: f64| {
            forces_n.iter().map(move |&force_n| Self {
                texture: texture.to_owned(),
                speed_mm_s,
                force_n,
            })
        };
        speeds_mm_s.iter().flat_map(|&speed| at(speed)).collect()
    }

    /// Reads a CSV list with the columns `speed_mm_s`, in mm/s, and `force_n`, in N. A column `texture` is optional;
    /// the argument `texture` replaces an empty or missing name.
    ///
    /// # Errors
    /// A file that cannot be read, a missing or unknown column, no line or more than [`MOST_TRIALS`], or a line without
    /// a texture or with a speed or force that is not a number of at least zero or that no hand and no drum reaches.
    pub fn from_csv(path: &Path, texture: Option<&str>) -> Result<Vec<Self>> {
        let table = CsvTable::read(path, Format::Plan)?;
        let header = table.header()?;
        let expected = "a list of trials to record has speed_mm_s, force_n, and texture if there are several";
        let speed = header.needed("speed_mm_s", expected)?;
        let force = header.needed("force_n", expected)?;
        let name = header.column("texture")?;
        let mut columns = header.names().enumerate();
        let known = [Some(speed), Some(force), name];
        if let Some((_, other)) = columns.find(|(index, _)| !known.contains(&Some(*index))) {
            return Err(header.error(format!("unknown column '{other}': {expected}")));
        }
        let mut trials = Vec::new();
        let mut rows = table.rows_below_header()?;
        while let Some(row) = rows.next_row()? {
            if trials.len() == MOST_TRIALS {
                let problem = format!("lists more than {MOST_TRIALS} trials: make several lists");
                return Err(row.error(problem));
            }
            let Some(texture) = name
                .map(|index| row.text(index))
                .filter(|name| !name.is_empty())
                .or(texture)
            else {
                return Err(row.error("no texture: add a column 'texture', or give --texture"));
            };
            let sound = |index: usize, name: &str, fault: fn(f64) -> Option<String>| {
                let value = row.finite(index, name)?;
                (value < 0.0)
                    .then(|| "negative: a trial is at 0 or above".to_owned())
                    .or_else(|| fault(value))
                    .map_or(Ok(value), |fault| Err(row.error(format!("{name} is {fault}"))))
            };
            trials.push(Self {
                texture: texture.to_owned(),
                speed_mm_s: sound(speed, "speed_mm_s", speed_fault)?,
                force_n: sound(force, "force_n", force_fault)?,
            });
        }
        if trials.is_empty() {
            return Err(Error::file(path, "lists nothing to record: add at least one line"));
        }
        Ok(trials)
    }

    /// Checks that the texture's name can be a folder's name, too.
    ///
    /// # Errors
    /// A name that is empty, too long, starts with a dot, or cannot name a folder on every system.
    pub fn check(&self) -> Result<()> {
        let name = &self.texture;
        let fault = if name.len() > MAX_NAME_BYTES {
            Some("is longer than a library can hold")
        } else if name.starts_with('.') {
            Some("must not start with a dot")
        } else {
            names::fault(name)
        };
        fault.map_or(Ok(()), |fault| {
            let problem = format!("{name:?} cannot name a texture: it {fault}; use at most {MAX_NAME_BYTES} bytes");
            Err(Error::Request(problem))
        })
    }

    /// Path of the trial's file, relative to the set's folder, with `/` as separator.
    fn file(&self) -> String {
        format!("{}/{}mm_s_{}N.wav", self.texture, self.speed_mm_s, self.force_n)
    }

    /// Identifies the trial within a set.
    fn key(&self) -> (String, u64, u64) {
        key(&self.texture, self.speed_mm_s, self.force_n)
    }
}

impl std::fmt::Display for PlannedTrial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {} mm/s, {} N", self.texture, self.speed_mm_s, self.force_n)
    }
}

/// Identifies the trial of a texture at a speed, mm/s, and a force, N. Equal numbers have equal bits, except for 0 and
/// -0.
fn key(texture: &str, speed_mm_s: f64, force_n: f64) -> (String, u64, u64) {
    (texture.to_owned(), speed_mm_s.to_bits(), force_n.to_bits())
}

/// Header of the lists that this module writes.
const HEADER: &str = "file,texture,speed_mm_s,force_n,scale_m_s2,simulated";

/// A folder with a recording set, to which trials are added.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Lines of the list: comments, header, trials.
    lines: Vec<String>,
    done: HashSet<(String, u64, u64)>,
}

impl Folder {
    /// Opens a folder, and creates it if it does not exist.
    pub fn open(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).map_err(Error::io("create", path))?;
        let list = path.join(TRIALS_FILE);
        let mut folder = Self {
            path: path.to_owned(),
            lines: vec![HEADER.to_owned()],
            done: HashSet::new(),
        };
        let text = match Format::Trials.read_text(&list) {
            Ok(text) => text,
            Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
                return Ok(folder);
            }
            Err(failure) => return Err(failure),
        };
        folder.lines = text.lines().map(str::to_owned).collect();
        let mut content = folder.lines.iter().filter(|line| is_content(line));
        if content.next().map(String::as_str) != Some(HEADER) {
            let problem = format!("was not written by `stylus record`, whose columns are {HEADER}: name a new folder");
            return Err(Error::file(&list, problem));
        }
        if content.next().is_some() {
            let set = RecordingSet::from_list(&list)?;
            // A trial whose file is gone is recorded again.
            let there = set.trials.iter().filter(|trial| trial.file.is_file());
            folder.done = there
                .map(|trial| key(&trial.texture, trial.speed_mm_s, trial.force_n))
                .collect();
        }
        Ok(folder)
    }

    /// Checks that no two textures of `planned` and of the folder differ in the case of letters only, because some
    /// systems would give both one folder.
    ///
    /// # Errors
    /// Such names. The error has the first two.
    pub fn check_names(&self, planned: &[PlannedTrial]) -> Result<()> {
        let all = self
            .done
            .iter()
            .map(|(texture, ..)| texture.as_str())
            .chain(planned.iter().map(|trial| trial.texture.as_str()));
        let mut names: HashMap<String, &str> = HashMap::new();
        for name in all {
            let earlier = *names.entry(names::folded(name)).or_insert(name);
            if earlier != name {
                return Err(Error::Request(format!(
                    "textures {earlier:?} and {name:?} differ in the case of letters only: rename one of them"
                )));
            }
        }
        Ok(())
    }

    /// Returns true if the folder has a recording of this trial.
    pub fn has(&self, trial: &PlannedTrial) -> bool {
        self.done.contains(&trial.key())
    }

    /// Writes a trial's file and its line in the list; both replace those of an earlier recording of the same trial.
    pub fn add(
        &mut self,
        planned: &PlannedTrial,
        capture: &Capture,
        calibration: &Calibration,
        provenance: Provenance,
    ) -> Result<Trial> {
        let name = planned.file();
        let file = self.path.join(&name);
        let folder = file.parent().unwrap_or(&self.path);
        fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
        let scale_m_s2 = scale_m_s2(calibration);
        let samples = capture
            .samples
            .iter()
            .flat_map(|sample| calibration.acceleration(sample))
            .map(|acceleration_m_s2| acceleration_m_s2 / scale_m_s2);
        let wav = float_wav(3, capture.rate_hz, samples).map_err(|failure| Error::file(&file, failure.to_string()))?;
        atomic_file::write(&file, &wav)?;
        let line = row([
            &name,
            &planned.texture,
            &planned.speed_mm_s.to_string(),
            &planned.force_n.to_string(),
            &scale_m_s2.to_string(),
            if provenance == Provenance::Simulated {
                "true"
            } else {
                "false"
            },
        ]);
        // A copy, so that this state stays that of the files if the list cannot be written.
        let mut lines = self.lines.clone();
        match lines.iter_mut().find(|line| first_field(line) == name) {
            Some(earlier) => *earlier = line,
            None => lines.push(line),
        }
        let text = lines.join("\n") + "\n";
        atomic_file::write(&self.path.join(TRIALS_FILE), text.as_bytes())?;
        self.lines = lines;
        self.done.insert(planned.key());
        Ok(Trial {
            scale_m_s2: Some(scale_m_s2),
            duration_s: Some(capture.samples.len() as f64 / f64::from(capture.rate_hz)),
            provenance,
            ..Trial::of(file, planned.texture.clone(), planned.speed_mm_s, planned.force_n)
        })
    }
}

fn row<const N: usize>(fields: [&str; N]) -> String {
    written([fields]).trim_end_matches('\n').to_owned()
}

/// First field of a line of the list; empty for a comment.
fn first_field(line: &str) -> String {
    let first = |table: CsvTable| Some(table.rows().ok()?.next_row().ok()??.text(0).to_owned());
    CsvTable::of(Path::new(TRIALS_FILE), line.to_owned())
        .ok()
        .and_then(first)
        .unwrap_or_default()
}

/// Largest acceleration that an axis can show at an end of the converter's range, m/s².
fn scale_m_s2(calibration: &Calibration) -> f64 {
    let largest = calibration
        .acceleration_zero
        .iter()
        .zip(calibration.m_s2_per_code)
        .fold(0.0, |most: f64, (zero, scale)| {
            most.max(zero.max(f64::from(u16::MAX) - zero) * scale.abs())
        });
    // A reader refuses a scale of zero. All samples are zero in that case, so that any other scale serves.
    if largest > 0.0 { largest } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use model_format::AdcCode;
    use model_format::link::{RecordSample, Settings};
    use proptest::prelude::*;

    use super::*;
    use crate::link::capture::Loss;
    use test_helpers::holds;

    pub fn planned(texture: &str, speed_mm_s: f64) -> PlannedTrial {
        PlannedTrial {
            texture: texture.to_owned(),
            speed_mm_s,
            force_n: 0.5,
        }
    }

    #[test]
    fn names_that_lead_out_of_the_folder_are_refused() {
        for name in [
            "",
            "..",
            "a/b",
            "a\\b",
            "C:x",
            "a\nb",
            "NUL",
            "x.",
            "e\u{301}",
            &"x".repeat(49),
        ] {
            assert!(planned(name, 1.0).check().is_err(), "{name}");
        }
        assert!(planned("denim (worn)", 1.0).check().is_ok());
    }

    #[test]
    fn a_list_of_points_may_name_their_textures() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str, texture| {
            std::fs::write(file.path(), text).unwrap();
            PlannedTrial::from_csv(file.path(), texture)
        };
        let named = read("texture,speed_mm_s,force_n\nsilk,50,0.5\n", None).unwrap();
        assert_eq!(named, [planned("silk", 50.0)]);
        let given = read("# mine\nspeed_mm_s, force_n\n50, 0.5\n", Some("silk")).unwrap();
        assert_eq!(given, named);
        for (text, word) in [
            ("speed_mm_s,force_n\n50,0.5\n", "no texture"),
            ("texture,speed_mm_s,force_n\nsilk,-1,0.5\n", "line 2"),
            ("texture,speed_mm_s,force_n\nsilk,fast,0.5\n", "line 2"),
            ("texture,speed_mm_s\nsilk,1\n", "force_n"),
            ("texture,speed_mm_s,force_n\n", "nothing to record"),
        ] {
            holds(&read(text, None).unwrap_err(), &[word]);
        }
    }

    #[test]
    fn a_folder_is_taken_up_where_it_was_left() {
        let folder = tempfile::tempdir().unwrap();
        let one = capture(&[[1, 2, 3]]);
        let mut set = Folder::open(folder.path()).unwrap();
        let (silk, felt) = (planned("silk, \"raw\"", 50.0), planned("felt", 50.0));
        for trial in [&silk, &felt] {
            set.add(trial, &one, &calibration(), Provenance::Recorded).unwrap();
        }
        let mut again = Folder::open(folder.path()).unwrap();
        assert!(again.has(&silk) && again.has(&felt) && !again.has(&planned("felt", 51.0)));
        // Recording it again replaces the trial.
        again.add(&silk, &one, &calibration(), Provenance::Simulated).unwrap();
        let listed = RecordingSet::open(&[folder.path().to_owned()]).unwrap();
        assert_eq!(listed.trials.len(), 2);
        assert_eq!(listed.trials[0].provenance, Provenance::Simulated);
        // A trial whose file is gone counts as not recorded.
        std::fs::remove_file(&listed.trials[1].file).unwrap();
        assert!(!Folder::open(folder.path()).unwrap().has(&felt));
    }

    #[test]
    fn textures_that_differ_in_case_only_do_not_share_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let mut set = Folder::open(folder.path()).unwrap();
        assert!(
            set.check_names(&[planned("silk", 1.0), planned("silk", 2.0), planned("felt", 1.0)])
                .is_ok()
        );
        let both = set.check_names(&[planned("silk", 1.0), planned("Silk", 2.0)]);
        assert!(both.unwrap_err().to_string().contains("case of letters"));
        let one = capture(&[[1, 2, 3]]);
        set.add(&planned("silk", 1.0), &one, &calibration(), Provenance::Recorded)
            .unwrap();
        assert!(set.check_names(&[planned("SILK", 5.0)]).is_err());
    }

    #[test]
    fn a_list_of_something_else_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join(TRIALS_FILE);
        let text = "file,texture,speed_mm_s,force_n\na.wav,silk,1,1\n";
        std::fs::write(&list, text).unwrap();
        holds(&Folder::open(folder.path()).unwrap_err(), &["name a new folder"]);
        assert_eq!(std::fs::read_to_string(&list).unwrap(), text);
    }

    pub fn capture(codes: &[[u16; 3]]) -> Capture {
        let samples = codes.iter().map(|&[x, y, z]| RecordSample {
            acceleration: [AdcCode(x), AdcCode(y), AdcCode(z)],
            force: AdcCode(0),
            encoder_delta: 0,
        });
        Capture {
            interpolated: 0,
            samples: samples.collect(),
            rate_hz: 5000,
            first_tick: 0,
            loss: Loss::default(),
            holes: 0,
        }
    }

    pub fn calibration() -> Calibration {
        Calibration::new(&Settings::default(), Some([30.0, -60.0, 15.0]))
    }

    proptest! {
        #[test]
        fn no_sample_of_a_recording_is_beyond_full_scale(
            scales in prop::array::uniform3(-5000.0..5000.0f64),
            zeros in prop::array::uniform3(any::<u16>()),
            codes in prop::array::uniform3(any::<u16>()),
        ) {
            let calibration = Calibration {
                acceleration_zero: zeros.map(f64::from),
                ..Calibration::new(&Settings::default(), Some(scales))
            };
            let scale = scale_m_s2(&calibration);
            for acceleration in calibration.acceleration(&capture(&[codes]).samples[0]) {
                prop_assert!((acceleration / scale).abs() <= 1.0 + 1e-12);
            }
        }
    }
}
