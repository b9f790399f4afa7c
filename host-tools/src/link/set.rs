//! A folder of recordings as a fit reads it, which grows by one trial at a time.
//!
//! A trial is a WAV file of three channels, 32-bit float: share of half the converter's range, the axes' different scales
//! evened out, so that one `scale_m_s2` makes all of them m/s². Its line in `trials.csv` is written when the file is
//! there, so that whatever breaks off leaves a set that holds.

use std::collections::HashSet;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use hound::{SampleFormat, WavSpec, WavWriter};
use model_format::Provenance;
use model_format::limits::MAX_NAME_BYTES;

use super::capture::{Calibration, Capture};
use crate::recording::{RecordingSet, TRIALS_FILE, Trial};
use crate::support::atomic_file;
use crate::support::error::{Error, Result};

/// Header of the lists that are written here.
const HEADER: &str = "file,texture,speed_mm_s,force_n,scale_m_s2,simulated";

/// Codes from the middle of the converter's range to its end.
const HALF_RANGE: f64 = 32_768.0;

/// What is to be recorded: one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
}

impl Point {
    /// Every speed with every force.
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

    /// Reads a list with the columns `speed_mm_s` and `force_n`, and `texture` if there are several.
    ///
    /// # Errors
    /// A file that cannot be read, a column that is missing or unknown, a line that is not a speed and a force at least
    /// zero, or has no texture where `texture` gives none.
    pub fn from_csv(path: &Path, texture: Option<&str>) -> Result<Vec<Self>> {
        #[derive(serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Row {
            texture: Option<String>,
            speed_mm_s: f64,
            force_n: f64,
        }
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_path(path)
            .map_err(|failure| Error::file(path, failure.to_string()))?;
        let mut points = Vec::new();
        for row in reader.deserialize() {
            let row: Row = row.map_err(|failure| {
                let line = failure.position().map_or(0, csv::Position::line);
                Error::line(path, line, failure.to_string())
            })?;
            let line = points.len() as u64 + 2;
            let name = row.texture.filter(|name| !name.is_empty());
            let Some(name) = name.or_else(|| texture.map(str::to_owned)) else {
                return Err(Error::line(
                    path,
                    line,
                    "no texture; give --texture or a column",
                ));
            };
            let is_sound = |value: f64| value.is_finite() && value >= 0.0;
            if !is_sound(row.speed_mm_s) || !is_sound(row.force_n) {
                return Err(Error::line(
                    path,
                    line,
                    "a speed and a force must be at least 0",
                ));
            }
            points.push(Self {
                texture: name,
                speed_mm_s: row.speed_mm_s,
                force_n: row.force_n,
            });
        }
        if points.is_empty() {
            return Err(Error::file(path, "lists nothing to record"));
        }
        Ok(points)
    }

    /// Refuses what cannot be a texture's name, or a folder's.
    ///
    /// # Errors
    /// An empty or long name, or one with a path's separators or what is not printed.
    pub fn check(&self) -> Result<()> {
        let name = &self.texture;
        let is_odd = |c: char| c.is_control() || "/\\:".contains(c);
        if name.is_empty()
            || name.len() > MAX_NAME_BYTES
            || name.starts_with('.')
            || name.contains(is_odd)
        {
            return Err(Error::Request(format!(
                "'{name}' cannot name a texture: take 1 to {MAX_NAME_BYTES} bytes, no dot at the front, no / \\ : in it"
            )));
        }
        Ok(())
    }

    /// Its file in the folder, with `/` between the parts.
    fn file(&self) -> String {
        format!(
            "{}/{}mm_s_{}N.wav",
            self.texture, self.speed_mm_s, self.force_n
        )
    }

    fn key(&self) -> (String, u64, u64) {
        key(&self.texture, self.speed_mm_s, self.force_n)
    }
}

impl std::fmt::Display for Point {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {} mm/s, {} N",
            self.texture, self.speed_mm_s, self.force_n
        )
    }
}

fn key(texture: &str, speed_mm_s: f64, force_n: f64) -> (String, u64, u64) {
    (texture.to_owned(), speed_mm_s.to_bits(), force_n.to_bits())
}

/// The folder.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// The list's lines: comments, header, trials.
    lines: Vec<String>,
    done: HashSet<(String, u64, u64)>,
}

impl Folder {
    /// Opens a folder, which is made if it is not there.
    ///
    /// # Errors
    /// A folder that cannot be made, or whose list was written by something else or does not hold.
    pub fn open(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).map_err(Error::io("create", path))?;
        let list = path.join(TRIALS_FILE);
        let mut folder = Self {
            path: path.to_owned(),
            lines: vec![HEADER.to_owned()],
            done: HashSet::new(),
        };
        let text = match fs::read_to_string(&list) {
            Ok(text) => text,
            Err(failure) if failure.kind() == std::io::ErrorKind::NotFound => return Ok(folder),
            Err(failure) => return Err(Error::io("read", &list)(failure)),
        };
        folder.lines = text.lines().map(str::to_owned).collect();
        let is_content = |line: &&String| !line.starts_with('#') && !line.trim().is_empty();
        let mut content = folder.lines.iter().filter(is_content);
        if content.next().map(String::as_str) != Some(HEADER) {
            let problem = format!(
                "was not written by `stylus record` (whose columns are {HEADER}): name a new folder"
            );
            return Err(Error::file(&list, problem));
        }
        if content.next().is_some() {
            let set = RecordingSet::from_list(&list)?;
            let there = set.trials.iter().filter(|trial| trial.file.is_file());
            folder.done = there
                .map(|trial| key(&trial.texture, trial.speed_mm_s, trial.force_n))
                .collect();
        }
        Ok(folder)
    }

    /// Whether the folder has a recording of this point.
    pub fn has(&self, point: &Point) -> bool {
        self.done.contains(&point.key())
    }

    /// How many trials there are.
    pub fn trials(&self) -> usize {
        self.done.len()
    }

    /// Writes a trial, in place of an earlier one of the same point, and lists it.
    ///
    /// # Errors
    /// A file or the list that cannot be written.
    pub fn add(
        &mut self,
        point: &Point,
        capture: &Capture,
        calibration: &Calibration,
        provenance: Provenance,
    ) -> Result<Trial> {
        let name = point.file();
        let file = self.path.join(&name);
        let folder = file.parent().unwrap_or(&self.path);
        fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
        let scale_m_s2 = scale_m_s2(calibration);
        let wav = wav(capture, calibration, scale_m_s2)
            .map_err(|failure| Error::file(&file, failure.to_string()))?;
        atomic_file::write(&file, &wav)?;
        let line = row(&[
            &name,
            &point.texture,
            &point.speed_mm_s.to_string(),
            &point.force_n.to_string(),
            &scale_m_s2.to_string(),
            if provenance == Provenance::Simulated {
                "true"
            } else {
                "false"
            },
        ])
        .map_err(|failure| Error::file(&file, failure.to_string()))?;
        let mut lines = self.lines.clone();
        match lines.iter_mut().find(|line| first_field(line) == name) {
            Some(earlier) => *earlier = line,
            None => lines.push(line),
        }
        let text = lines.join("\n") + "\n";
        atomic_file::write(&self.path.join(TRIALS_FILE), text.as_bytes())?;
        self.lines = lines;
        self.done.insert(point.key());
        Ok(Trial {
            file,
            texture: point.texture.clone(),
            speed_mm_s: point.speed_mm_s,
            force_n: point.force_n,
            scale_m_s2,
            start_s: 0.0,
            duration_s: Some(capture.samples.len() as f64 / f64::from(capture.rate_hz)),
            sample_rate_hz: None,
            provenance,
        })
    }
}

/// Acceleration that half the range stands for on the most sensitive axis' opposite: the one with the largest scale, so that
/// no sample is beyond 1.
fn scale_m_s2(calibration: &Calibration) -> f64 {
    let largest = calibration
        .m_s2_per_code
        .iter()
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    // A scale of zero would be refused; then every sample is zero anyway.
    if largest > 0.0 {
        largest * HALF_RANGE
    } else {
        1.0
    }
}

fn wav(capture: &Capture, calibration: &Calibration, scale_m_s2: f64) -> hound::Result<Vec<u8>> {
    let spec = WavSpec {
        channels: 3,
        sample_rate: capture.rate_hz,
        bits_per_sample: 32,
        sample_format: SampleFormat::Float,
    };
    let mut file = Cursor::new(Vec::with_capacity(12 * capture.samples.len() + 128));
    let mut writer = WavWriter::new(&mut file, spec)?;
    for sample in &capture.samples {
        for acceleration_m_s2 in calibration.acceleration(sample) {
            writer.write_sample((acceleration_m_s2 / scale_m_s2) as f32)?;
        }
    }
    writer.finalize()?;
    Ok(file.into_inner())
}

fn row(fields: &[&str]) -> csv::Result<String> {
    let mut writer = csv::WriterBuilder::new()
        .terminator(csv::Terminator::Any(b'\n'))
        .from_writer(Vec::new());
    writer.write_record(fields)?;
    let bytes = writer
        .into_inner()
        .map_err(csv::IntoInnerError::into_error)?;
    let text = String::from_utf8(bytes).expect("the fields are text");
    Ok(text.trim_end_matches('\n').to_owned())
}

fn first_field(line: &str) -> String {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .comment(Some(b'#'))
        .from_reader(line.as_bytes());
    let first = reader.records().next().and_then(std::result::Result::ok);
    first.map_or(String::new(), |record| {
        record.get(0).unwrap_or("").to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::AdcCode;
    use model_format::link::{RecordSample, Settings};
    use proptest::prelude::*;

    use crate::link::capture::Loss;

    fn point(texture: &str, speed_mm_s: f64) -> Point {
        Point {
            texture: texture.to_owned(),
            speed_mm_s,
            force_n: 0.5,
        }
    }

    fn capture(codes: &[[u16; 3]]) -> Capture {
        let samples = codes.iter().map(|&[x, y, z]| RecordSample {
            acceleration: [AdcCode(x), AdcCode(y), AdcCode(z)],
            force: AdcCode(0),
            encoder_delta: 0,
        });
        Capture {
            samples: samples.collect(),
            rate_hz: 5000,
            first_tick: 0,
            loss: Loss::default(),
            holes: 0,
        }
    }

    fn calibration() -> Calibration {
        Calibration::new(&Settings::default(), Some([30.0, -60.0, 15.0]))
    }

    #[test]
    fn what_is_read_back_is_the_acceleration_that_the_codes_stand_for() {
        let folder = tempfile::tempdir().unwrap();
        let codes = [[0, 65_535, 40_000], [32_768, 32_768, 32_768], [1, 2, 3]];
        let mut set = Folder::open(folder.path()).unwrap();
        let (calibration, capture) = (calibration(), capture(&codes));
        set.add(
            &point("silk", 120.0),
            &capture,
            &calibration,
            Provenance::Recorded,
        )
        .unwrap();
        let listed = RecordingSet::open(&[folder.path().to_owned()]).unwrap();
        let samples = crate::recording::read(&listed.trials[0]).unwrap();
        for (index, sample) in capture.samples.iter().enumerate() {
            for (axis, expected) in calibration.acceleration(sample).into_iter().enumerate() {
                let found = samples.axes[axis][index];
                assert!((found - expected).abs() < 1e-5 * 99.0, "{found} {expected}");
            }
        }
    }

    #[test]
    fn a_folder_is_taken_up_where_it_was_left() {
        let folder = tempfile::tempdir().unwrap();
        let one = capture(&[[1, 2, 3]]);
        let mut set = Folder::open(folder.path()).unwrap();
        let (silk, felt) = (point("silk, \"raw\"", 50.0), point("felt", 50.0));
        for point in [&silk, &felt] {
            set.add(point, &one, &calibration(), Provenance::Recorded)
                .unwrap();
        }
        let mut again = Folder::open(folder.path()).unwrap();
        assert!(again.has(&silk) && again.has(&felt) && !again.has(&point("felt", 51.0)));
        // Recording it again replaces the trial.
        again
            .add(&silk, &one, &calibration(), Provenance::Simulated)
            .unwrap();
        let listed = RecordingSet::open(&[folder.path().to_owned()]).unwrap();
        assert_eq!(listed.trials.len(), 2);
        assert_eq!(listed.trials[0].provenance, Provenance::Simulated);
        // A list whose file is gone is not done.
        std::fs::remove_file(&listed.trials[1].file).unwrap();
        assert!(!Folder::open(folder.path()).unwrap().has(&felt));
    }

    #[test]
    fn a_list_of_something_else_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join(TRIALS_FILE);
        let text = "file,texture,speed_mm_s,force_n\na.wav,silk,1,1\n";
        std::fs::write(&list, text).unwrap();
        let message = Folder::open(folder.path()).unwrap_err().to_string();
        assert!(message.contains("name a new folder"), "{message}");
        assert_eq!(std::fs::read_to_string(&list).unwrap(), text);
    }

    #[test]
    fn names_that_lead_out_of_the_folder_are_refused() {
        for name in ["", "..", "a/b", "a\\b", "C:x", "a\nb", &"x".repeat(49)] {
            assert!(point(name, 1.0).check().is_err(), "{name}");
        }
        assert!(point("denim (worn)", 1.0).check().is_ok());
    }

    #[test]
    fn a_list_of_points_may_name_their_textures() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str, texture| {
            std::fs::write(file.path(), text).unwrap();
            Point::from_csv(file.path(), texture)
        };
        let named = read("texture,speed_mm_s,force_n\nsilk,50,0.5\n", None).unwrap();
        assert_eq!(named, [point("silk", 50.0)]);
        let given = read("# mine\nspeed_mm_s, force_n\n50, 0.5\n", Some("silk")).unwrap();
        assert_eq!(given, named);
        for (text, word) in [
            ("speed_mm_s,force_n\n50,0.5\n", "no texture"),
            ("texture,speed_mm_s,force_n\nsilk,-1,0.5\n", "line 2"),
            ("texture,speed_mm_s,force_n\nsilk,fast,0.5\n", "line 2"),
            ("texture,speed_mm_s\nsilk,1\n", "force_n"),
            ("texture,speed_mm_s,force_n\n", "nothing to record"),
        ] {
            let message = read(text, None).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }

    proptest! {
        #[test]
        fn no_sample_of_a_recording_is_beyond_full_scale(
            scales in prop::array::uniform3(-5000.0..5000.0f64),
            codes in prop::array::uniform3(any::<u16>()),
        ) {
            let calibration = Calibration::new(&Settings::default(), Some(scales));
            let scale = scale_m_s2(&calibration);
            for acceleration in calibration.acceleration(&capture(&[codes]).samples[0]) {
                prop_assert!((acceleration / scale).abs() <= 1.0 + 1e-12);
            }
        }
    }
}
