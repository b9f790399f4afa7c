//! Recordings from arrays and files, and sets of them; simulated ones.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use host_tools::recording::{
    self, Assumed, HeldSamples, NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, RecordingSet, TimeUnit, Trial,
};
use host_tools::rig::{RigFile, simulate_to_folder};
use host_tools::support::bounded_file::Format;
use host_tools::support::number::{force_fault, speed_fault};
use host_tools::support::{Error, Result};
use model_format::{Provenance, SAMPLE_RATE_HZ};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySequence};

use crate::convert::{Several, array, channels, choice, conditioning, not_negative, positive, table};
use crate::error::{raised, refused};

// Literals below, so that `help` shows them.
const _: () = assert!(NOMINAL_SPEED_MM_S == 100.0 && NOMINAL_FORCE_N == 1.0);
const _: () = assert!(SAMPLE_RATE_HZ == 5000);

/// One recording of a texture at one speed and force: samples in memory, or a part of a file.
///
/// `samples` have the shape (N,), or (N, axes) with one to three axes, at `rate_hz`: floats, of which 1.0 is
/// `scale_m_s2` (m/s², default 1), or int16 or int32, of which the full scale is. They are copied once, so that the
/// array may change while they are fitted. A fit treats them as those of a WAV file of the same samples. The columns of
/// a DataFrame of floats count as those of a CSV file: units by their names, times, and what is no axis; so does an
/// index of times. `rate_hz` counts before these times.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Recording(pub Trial);

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (
        samples, rate_hz, *, texture, speed_mm_s = 100.0, force_n = 1.0, scale_m_s2 = None,
        start_s = 0.0, duration_s = None, simulated = false, name = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn new(
        samples: &Bound<'_, PyAny>,
        rate_hz: f64,
        texture: String,
        speed_mm_s: f64,
        force_n: f64,
        scale_m_s2: Option<f64>,
        start_s: f64,
        duration_s: Option<f64>,
        simulated: bool,
        name: Option<String>,
    ) -> PyResult<Self> {
        let held = if let Some(text) = table_of(samples)? {
            recording::held_table(rate_hz, text)
        } else {
            let found = channels(samples)?;
            HeldSamples::new(rate_hz, found.channels, found.are_integers)
        };
        let held = held.map_err(raised)?;
        let name = name.unwrap_or_else(|| format!("{texture}, {speed_mm_s} mm/s, {force_n} N"));
        checked(Trial {
            file: PathBuf::from(name),
            texture,
            speed_mm_s,
            measured_speed_mm_s: None,
            force_n,
            scale_m_s2,
            start_s,
            duration_s,
            sample_rate_hz: None,
            time_unit: None,
            has_even_times: None,
            provenance: provenance(simulated),
            held: Some(Arc::new(held)),
        })
    }

    /// A recording in a WAV or CSV file. `sample_rate_hz` counts before the rate of its header or its times;
    /// `time_unit` is 's', 'ms', 'us' or 'ns', by default as the column's name or its steps say; `even_times` takes
    /// samples as even, whatever their times say.
    #[staticmethod]
    #[pyo3(signature = (
        path, *, texture = None, speed_mm_s = 100.0, force_n = 1.0, scale_m_s2 = None,
        start_s = 0.0, duration_s = None, sample_rate_hz = None, time_unit = None, even_times = false,
        simulated = false
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn from_file(
        path: PathBuf,
        texture: Option<String>,
        speed_mm_s: f64,
        force_n: f64,
        scale_m_s2: Option<f64>,
        start_s: f64,
        duration_s: Option<f64>,
        sample_rate_hz: Option<f64>,
        time_unit: Option<&str>,
        even_times: bool,
        simulated: bool,
    ) -> PyResult<Self> {
        // The file is read only later. A wrong path is told here, where it was given.
        if let Err(source) = std::fs::metadata(&path) {
            return Err(raised(Error::io("open", &path)(source)));
        }
        let stem = || path.file_stem().unwrap_or_default().to_string_lossy();
        checked(Trial {
            texture: texture.unwrap_or_else(|| stem().into_owned()),
            file: path,
            speed_mm_s,
            measured_speed_mm_s: None,
            force_n,
            scale_m_s2,
            start_s,
            duration_s,
            sample_rate_hz,
            time_unit: unit_of(time_unit)?,
            has_even_times: even_times.then_some(true),
            provenance: provenance(simulated),
            held: None,
        })
    }

    /// The file, or the name of samples in memory.
    #[getter]
    fn name(&self) -> String {
        self.0.file.display().to_string()
    }

    /// Name of the texture.
    #[getter]
    fn texture(&self) -> &str {
        &self.0.texture
    }

    /// Tangential speed, mm/s.
    #[getter]
    fn speed_mm_s(&self) -> f64 {
        self.0.speed_mm_s
    }

    /// Normal force, N.
    #[getter]
    fn force_n(&self) -> f64 {
        self.0.force_n
    }

    /// Acceleration of a sample of 1, or of the full scale of integers, m/s²; None if it was not given.
    #[getter]
    fn scale_m_s2(&self) -> Option<f64> {
        self.0.scale_m_s2
    }

    /// Start of the used part, s.
    #[getter]
    fn start_s(&self) -> f64 {
        self.0.start_s
    }

    /// Longest duration of the used part, s; None to the end.
    #[getter]
    fn duration_s(&self) -> Option<f64> {
        self.0.duration_s
    }

    /// True for simulated samples.
    #[getter]
    fn simulated(&self) -> bool {
        self.0.provenance == Provenance::Simulated
    }

    /// The samples of the used part as a fit reads them: an array of the shape (N, axes), float64, m/s², at
    /// `rate_hz`.
    #[pyo3(signature = (rate_hz = 5000))]
    fn samples(&self, py: Python<'_>, rate_hz: u32) -> PyResult<Py<PyArray2<f64>>> {
        let trial = self.0.clone();
        let samples = py.detach(|| recording::read_at(&trial, rate_hz));
        let axes = samples.map_err(raised)?.axes;
        let frames = axes.first().map_or(0, Vec::len);
        // In the order of NumPy, in which the axes of a frame are neighbours.
        let rows = (0..frames).flat_map(|frame| axes.iter().map(move |axis| axis[frame]));
        table(py, rows.collect(), frames)
    }

    /// The signal that a fit takes of it: one axis, float64, m/s², at 5 kHz, with a mean of zero, without what triage
    /// cuts. `reduce` is 'pca', 'dft321', 'x', 'y' or 'z'; `high_pass` 'auto', 'none' or a frequency in Hz as text.
    #[pyo3(signature = (*, reduce = "pca", high_pass = "auto"))]
    fn signal(&self, py: Python<'_>, reduce: &str, high_pass: &str) -> PyResult<Py<PyArray1<f64>>> {
        let conditioning = conditioning(reduce, high_pass)?;
        let trial = self.0.clone();
        let signal = py.detach(|| host_tools::fit::signal(&trial, conditioning));
        Ok(array(py, signal.map_err(raised)?.samples))
    }

    fn __repr__(&self) -> String {
        let trial = &self.0;
        format!(
            "Recording({:?}, texture={:?}, speed_mm_s={}, force_n={})",
            trial.file.display().to_string(),
            trial.texture,
            trial.speed_mm_s,
            trial.force_n
        )
    }
}

/// A DataFrame as the text of a table, whose index is a column if it has a name or is one of dates; none for anything
/// else, and for integers, which are of a full scale.
fn table_of(samples: &Bound<'_, PyAny>) -> PyResult<Option<String>> {
    if !samples.hasattr("to_csv")? || !samples.hasattr("columns")? {
        return Ok(None);
    }
    let array = samples.call_method0("to_numpy")?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if kind == "i" || kind == "u" {
        return Ok(None);
    }
    let index = samples.getattr("index")?;
    let name: Option<String> = index.getattr("name")?.extract()?;
    let is_time = index.get_type().name()? == "DatetimeIndex";
    let arguments = PyDict::new(samples.py());
    arguments.set_item("index", is_time || name.is_some())?;
    arguments.set_item("index_label", name.unwrap_or_else(|| "time".to_owned()))?;
    samples.call_method("to_csv", (), Some(&arguments))?.extract().map(Some)
}

fn provenance(simulated: bool) -> Provenance {
    if simulated {
        Provenance::Simulated
    } else {
        Provenance::Recorded
    }
}

/// The recording, if its numbers are those of one.
fn checked(trial: Trial) -> PyResult<Recording> {
    if trial.texture.is_empty() || trial.texture.contains(char::is_control) {
        return Err(refused(format!(
            "texture {:?} has no name, or a control character in it: rename it",
            trial.texture
        )));
    }
    for (name, value, fault) in [
        ("speed_mm_s", trial.speed_mm_s, speed_fault(trial.speed_mm_s)),
        ("force_n", trial.force_n, force_fault(trial.force_n)),
    ] {
        not_negative(name, value)?;
        if let Some(fault) = fault {
            return Err(refused(format!("{name} is {fault}")));
        }
    }
    not_negative("start_s", trial.start_s)?;
    for (name, value) in [
        ("duration_s", trial.duration_s),
        // A scale may be negative, as in a list.
        ("scale_m_s2", trial.scale_m_s2.map(f64::abs)),
        ("sample_rate_hz", trial.sample_rate_hz),
    ] {
        value.map(|value| positive(name, value)).transpose()?;
    }
    Ok(Recording(trial))
}

/// A set of recordings: a folder with `trials.csv`, a list of any name, WAV or CSV files, or `Recording`s.
///
/// The keywords say what files do not: `duration_s` and `scale_m_s2` where a list gives none, `sample_rate_hz` (Hz)
/// before that of headers and times, `time_unit` ('s', 'ms', 'us' or 'ns') and `even_times` of CSV files with
/// times, `speed_mm_s` and `force_n` of files without a list.
#[pyclass(frozen, sequence, module = "stylus_haptics")]
pub struct Recordings(pub RecordingSet);

#[pymethods]
impl Recordings {
    #[new]
    #[pyo3(signature = (
        source, *, duration_s = None, sample_rate_hz = None, time_unit = None, even_times = false,
        scale_m_s2 = None, speed_mm_s = 100.0, force_n = 1.0
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn new(
        source: &Bound<'_, PyAny>,
        duration_s: Option<f64>,
        sample_rate_hz: Option<f64>,
        time_unit: Option<&str>,
        even_times: bool,
        scale_m_s2: Option<f64>,
        speed_mm_s: f64,
        force_n: f64,
    ) -> PyResult<Self> {
        for (name, value) in [
            ("duration_s", duration_s),
            ("sample_rate_hz", sample_rate_hz),
            ("scale_m_s2", scale_m_s2),
            ("speed_mm_s", Some(speed_mm_s)),
            ("force_n", Some(force_n)),
        ] {
            value.map(|value| positive(name, value)).transpose()?;
        }
        let assumed = Assumed {
            duration_s,
            sample_rate_hz,
            time_unit: unit_of(time_unit)?,
            even_times,
            scale_m_s2,
            speed_mm_s: Some(speed_mm_s),
            force_n: Some(force_n),
            ..Assumed::default()
        };
        set_of(source, &assumed).map(Self)
    }

    fn __len__(&self) -> usize {
        self.0.trials.len()
    }

    fn __getitem__(&self, index: isize) -> PyResult<Recording> {
        let count = self.0.trials.len() as isize;
        let at = if index < 0 { index + count } else { index };
        let trial = usize::try_from(at).ok().and_then(|at| self.0.trials.get(at));
        let absent = || pyo3::exceptions::PyIndexError::new_err("no such recording");
        trial.cloned().map(Recording).ok_or_else(absent)
    }

    /// Names of the textures, in the order of their first recordings.
    #[getter]
    fn textures(&self) -> Vec<String> {
        self.0.textures().into_iter().map(str::to_owned).collect()
    }

    fn __repr__(&self) -> String {
        format!(
            "Recordings({} of {})",
            self.0.trials.len(),
            self.0.textures().join(", ")
        )
    }
}

/// The unit of times by its name.
fn unit_of(name: Option<&str>) -> PyResult<Option<TimeUnit>> {
    name.map(|name| choice("time_unit", name)).transpose()
}

/// The set that an argument stands for.
pub fn recordings(source: &Bound<'_, PyAny>) -> PyResult<RecordingSet> {
    set_of(source, &Assumed::default())
}

fn set_of(source: &Bound<'_, PyAny>, assumed: &Assumed) -> PyResult<RecordingSet> {
    if let Ok(set) = source.cast::<Recordings>() {
        return Ok(set.get().0.clone());
    }
    if let Ok(only) = source.cast::<Recording>() {
        return Ok(held(vec![only.get().0.clone()]));
    }
    if let Ok(path) = source.extract::<PathBuf>() {
        return RecordingSet::open_with(&[path], assumed).map_err(raised);
    }
    let problem = "recordings are a folder, a list or files by their paths, or Recording objects";
    let Ok(items) = source.cast::<PySequence>() else {
        return Err(refused(format!(
            "{} is no set of recordings: {problem}",
            source.get_type().name()?
        )));
    };
    let items: Several<Bound<'_, PyAny>> = items.extract()?;
    let (mut trials, mut paths) = (Vec::new(), Vec::new());
    for item in items.0 {
        if let Ok(recording) = item.cast::<Recording>() {
            trials.push(recording.get().0.clone());
        } else if let Ok(path) = item.extract::<PathBuf>() {
            paths.push(path);
        } else {
            return Err(refused(format!(
                "{} is no recording: {problem}",
                item.get_type().name()?
            )));
        }
    }
    match (trials.is_empty(), paths.is_empty()) {
        (false, true) => Ok(held(trials)),
        (true, _) => RecordingSet::open_with(&paths, assumed).map_err(raised),
        (false, false) => Err(refused(
            "paths and Recording objects together: make the paths Recordings by Recording.from_file",
        )),
    }
}

/// A set of recordings whose speeds and forces a program gives.
fn held(trials: Vec<Trial>) -> RecordingSet {
    RecordingSet {
        trials,
        is_listed: true,
    }
}

/// Returns the description of the paper's rig, as `stylus simulate-rig --print-rig` prints it: a start for one's own.
#[pyfunction]
pub fn paper_rig() -> String {
    RigFile::paper().text().to_owned()
}

/// Simulates the recordings of a drum rig into the folder `out`, as `stylus simulate-rig` does, and returns the set.
///
/// `rig` is the path or the text of a rig's description; None is the paper's protocol: 4 textures at 15 speeds and 8
/// forces. The folder is new or empty; an earlier simulated set is replaced with `overwrite` alone. The same
/// seed gives the same recordings.
#[pyfunction]
#[pyo3(signature = (out, *, rig = None, seed = 1, overwrite = false))]
pub fn simulate_rig(
    py: Python<'_>,
    out: PathBuf,
    rig: Option<&Bound<'_, PyAny>>,
    seed: u64,
    overwrite: bool,
) -> PyResult<Recordings> {
    let rig = match rig {
        None => Ok(RigFile::paper()),
        // A text has line breaks, and a path has none.
        Some(rig) => match rig.extract::<String>().ok().filter(|text| text.contains('\n')) {
            Some(text) => RigFile::from_toml(&PathBuf::from("rig.toml"), &text),
            None => rig_file(&rig.extract::<PathBuf>()?),
        },
    };
    let rig = rig.map_err(raised)?;
    py.detach(|| {
        simulate_to_folder(&rig, seed, &out, overwrite)?;
        RecordingSet::open(&[out])
    })
    .map(Recordings)
    .map_err(raised)
}

fn rig_file(path: &Path) -> Result<RigFile> {
    RigFile::from_toml(path, &Format::Rig.read_text(path)?)
}
