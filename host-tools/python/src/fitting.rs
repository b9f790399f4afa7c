//! Fits: from recordings to a library, and from HaTT's model files.

use std::path::PathBuf;
use std::sync::Arc;

use host_tools::fit as fitted;
use host_tools::fit::Options;
use host_tools::fit::hatt::convert::far_nodes;
use host_tools::fit::hatt::import::{self as hatt, ImportReport, files, import, plan, read_all};
use host_tools::fit::record::FitRecord;
use host_tools::recording::{freehand, texture_fault};
use host_tools::support::Result;
use host_tools::support::by_kind;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{Several, made, plain, positive};
use crate::error::{raised, refused, warn};
use crate::library::Library;
use crate::options::of_keywords;
use crate::work;

/// Options of a fit of trials that strokes do not have.
pub const OF_TRIALS: [&str; 6] = ["drop", "floor", "floor_recording", "strict", "snap", "model_rate_hz"];

/// Fits a library to recordings, as `stylus fit` does: the same recordings and options give the same bytes.
///
/// `recordings` are a folder with `trials.csv`, a list, files, `Recording`s, or `Recordings`. What `snap` moves is a
/// warning. `progress(done, total)` counts recordings. Raises `StylusError` for the first recording that cannot be
/// used, or a texture that no library holds. Options:
#[pyfunction]
#[pyo3(signature = (recordings, *, progress = None, **options))]
pub fn fit<'py>(
    recordings: &Bound<'py, PyAny>,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = recordings.py();
    let options: Options = of_keywords(options, &[])?;
    let options = options.at_their_rate().map_err(raised)?;
    let set = crate::recording::recordings(recordings)?;
    let (set, warnings) = set.snapped(options.snap).map_err(raised)?;
    // The library would refuse them only after the fit, which may take minutes.
    let textures = set.by_texture().len();
    if textures > model_format::limits::MAX_TEXTURES {
        return Err(refused(format!(
            "the set has {textures} textures, and a library holds {}: fit them one by one",
            model_format::limits::MAX_TEXTURES
        )));
    }
    let total = set.trials.len() as u64;
    let fitted = work::run(py, total, progress, move |steps| {
        let found = fitted::fit(&set, &options, |trials| steps.add(trials as u64))?;
        let bytes = found.library()?;
        let record = FitRecord::of(&set, &options, &bytes)?.with_account_of(&found);
        Ok((found, bytes, record))
    })?;
    fit_of(py, fitted, warnings)
}

/// Fits one texture to all of a free hand's strokes, as `stylus fit --strokes` does: the same files and options give
/// the same bytes.
///
/// `files` are CSV with speed_mm_s, force_n, one to three accelerations, and time_s. `sample_rate_hz` is by default
/// that of the times, and `scale_m_s2`, the acceleration of a sample of 1, that of the header, or 1.
/// `progress(done, total)` counts strokes. Raises `StylusError` for the first file that cannot be used, or if no node
/// has 0.4 s in motion and contact. Options:
#[pyfunction]
#[pyo3(signature = (files, texture, *, sample_rate_hz = None, scale_m_s2 = None, progress = None, **options))]
pub fn fit_strokes<'py>(
    py: Python<'py>,
    files: Paths,
    texture: &str,
    sample_rate_hz: Option<f64>,
    scale_m_s2: Option<f64>,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options: Options = of_keywords(options, &OF_TRIALS)?;
    for (name, value) in [("sample_rate_hz", sample_rate_hz), ("scale_m_s2", scale_m_s2)] {
        value.map(|value| positive(name, value)).transpose()?;
    }
    if let Some(fault) = texture_fault(texture) {
        return Err(refused(format!("texture is {texture:?}: it {fault}")));
    }
    let (files, name) = (files.all(), texture.to_owned());
    let total = files.len() as u64;
    let (fitted, warnings) = work::run(py, total, progress, move |steps| {
        let read = |path: &PathBuf| {
            let stroke = freehand::read(path, sample_rate_hz, scale_m_s2)?;
            Ok((path.clone(), stroke))
        };
        let strokes = files.iter().map(read).collect::<Result<Vec<_>>>()?;
        let notes = strokes
            .iter()
            .flat_map(|(path, stroke)| stroke.notes(path))
            .collect::<Vec<_>>();
        let found = fitted::fit_strokes(&name, &strokes, &options, |done| steps.add(done as u64))?;
        let bytes = found.library()?;
        let record = FitRecord::of_strokes(&files, scale_m_s2, &found, &options, &bytes)?;
        Ok(((found, bytes, record), notes))
    })?;
    fit_of(py, fitted, warnings)
}

/// A fit with its library and record as Python has it, once its warnings were given.
fn fit_of(
    py: Python<'_>,
    (found, bytes, record): (fitted::Fit, Vec<u8>, FitRecord),
    mut warnings: Vec<String>,
) -> PyResult<Bound<'_, PyAny>> {
    warnings.extend(found.warnings().iter().map(ToString::to_string));
    for warning in by_kind(&found.verdicts()).iter().chain(&warnings) {
        warn(py, warning)?;
    }
    let library = Library::of(bytes.into(), None, Some(Arc::new(record)));
    let trials = found
        .trials
        .into_iter()
        .map(|trial| account(py, trial))
        .collect::<PyResult<Vec<_>>>()?;
    made(py, "Fit", (library, trials, warnings))
}

/// The account of one recording, as Python has it.
fn account(py: Python<'_>, report: fitted::TrialReport) -> PyResult<Bound<'_, PyAny>> {
    let verdicts = report.verdicts.iter().map(ToString::to_string);
    let arguments = (
        report.file,
        report.texture,
        report.speed_mm_s,
        report.force_n,
        report.rms_m_s2,
        report.mean_m_s2,
        report.energy_share,
        report.cut_s,
        report.seconds,
        report.floor_shares.map(|shares| shares.to_vec()),
        verdicts.collect::<Vec<String>>(),
        report.used,
    );
    made(py, "TrialReport", arguments)
}

/// One path, or several.
#[derive(FromPyObject)]
pub enum Paths {
    /// One.
    One(PathBuf),
    /// Several.
    Several(Several<PathBuf>),
}

impl Paths {
    /// All of them.
    pub fn all(self) -> Vec<PathBuf> {
        match self {
            Self::One(path) => vec![path],
            Self::Several(paths) => paths.0,
        }
    }
}

/// Converts HaTT's model files, or folders of them, as `stylus import-hatt` does.
///
/// `progress(done, total)` counts files. Options:
#[pyfunction]
#[pyo3(signature = (paths, *, progress = None, **options))]
pub fn import_hatt<'py>(
    py: Python<'py>,
    paths: Paths,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options: hatt::Options = of_keywords(options, &[])?;
    let files = files(&paths.all()).map_err(raised)?;
    let total = files.len() as u64;
    let (bytes, warnings, reports) = work::run(py, total, progress, move |steps| {
        let sources = read_all(&files, &options)?;
        let plan = plan(&sources, &options)?;
        let mut warnings: Vec<String> = Vec::new();
        for source in &sources {
            let own = source.toolkit.warnings.iter();
            warnings.extend(own.map(|warning| format!("{}: {warning}", source.path.display())));
        }
        let (converted, bytes) = import(&sources, &plan, &|| steps.done())?;
        for (source, converted) in sources.iter().zip(&converted) {
            let far = far_nodes(&converted.nodes);
            warnings.extend(far.map(|far| format!("{}: {far}", source.path.display())));
        }
        let reports = sources.into_iter().zip(converted).map(ImportReport::of);
        Ok((bytes, warnings, reports.collect::<Vec<_>>()))
    })?;
    for warning in &warnings {
        warn(py, warning)?;
    }
    let library = Library::of(bytes.into(), None, None);
    made(py, "HattImport", (library, warnings, plain(py, &reports)?))
}
