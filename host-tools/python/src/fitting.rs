//! Fits: from recordings to a library.

use std::path::PathBuf;
use std::sync::Arc;

use host_tools::fit as fitted;
use host_tools::fit::record::FitRecord;
use host_tools::fit::{Options, Order};
use host_tools::recording::Snap;
use host_tools::recording::triage::{Kind, SILENCE_FLOOR_M_S2};
use host_tools::support::number::tolerance;
use model_format::SAMPLE_RATE_HZ;
use pyo3::prelude::*;

use crate::convert::{checked, choice, conditioning, not_negative, plain};
use crate::error::{raised, refused, warn};
use crate::library::Library;
use crate::work;

// A literal below, so that `help` shows it.
const _: () = assert!(SILENCE_FLOOR_M_S2 == 0.001);

/// Order of a fit: a number, or a criterion.
#[derive(FromPyObject)]
pub enum OrderLike {
    /// A number.
    Fixed(usize),
    /// The name of a criterion.
    Named(String),
}

/// The way in which measured values move: a share, or 'auto'.
#[derive(FromPyObject)]
pub enum SnapLike {
    /// A share.
    Within(f64),
    /// The word 'auto'.
    Named(String),
}

fn snap_of(snap: SnapLike) -> PyResult<Snap> {
    match snap {
        SnapLike::Within(share) => checked("snap", share, tolerance).map(Snap::Within),
        SnapLike::Named(word) => {
            (word.parse()).map_err(|fault| refused(format!("snap '{word}' {fault}")))
        }
    }
}

/// The account of one recording that a fit gives.
#[pyclass(frozen, get_all, module = "stylus_haptics")]
#[derive(Clone)]
pub struct TrialReport {
    /// The file, or the name of samples in memory.
    name: String,
    /// Name of the texture.
    texture: String,
    /// Tangential speed, mm/s.
    speed_mm_s: f64,
    /// Normal force, N.
    force_n: f64,
    /// RMS of the signal of one axis, m/s².
    rms_m_s2: f64,
    /// Largest magnitude of an axis's mean, which was removed, m/s².
    mean_m_s2: f64,
    /// Share of the axes' energy that one axis keeps.
    energy_share: f64,
    /// Duration that triage cut out, s.
    cut_s: f64,
    /// Findings of triage in words; empty for a sound recording.
    verdicts: Vec<String>,
    /// True if the fit used it.
    used: bool,
}

#[pymethods]
impl TrialReport {
    fn __repr__(&self) -> String {
        format!(
            "TrialReport({:?}, rms_m_s2={:.4}, verdicts={:?}, used={})",
            self.name, self.rms_m_s2, self.verdicts, self.used
        )
    }
}

/// The outcome of a fit.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Fit {
    library: Py<Library>,
    record: Arc<FitRecord>,
    trials: Vec<TrialReport>,
    warnings: Vec<String>,
}

#[pymethods]
impl Fit {
    /// The library, with the record of the fit.
    #[getter]
    pub fn library(&self, py: Python<'_>) -> Py<Library> {
        self.library.clone_ref(py)
    }

    /// The account of every recording, in the order of the set.
    #[getter]
    fn trials(&self) -> Vec<TrialReport> {
        self.trials.clone()
    }

    /// Notes on what is doubtful, one line each; each was warned of, too.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The record of the fit as plain objects, as in LIB.fit.json: options, excitations, lines, θ and recordings.
    fn record<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, self.record.as_ref())
    }

    /// Writes the library to `path`, and beside it the record, PATH.fit.json. See `Library.save`.
    #[pyo3(signature = (path, *, overwrite = false))]
    fn save(&self, path: PathBuf, overwrite: bool) -> PyResult<()> {
        self.library.get().write(&path, overwrite)
    }

    fn __repr__(&self) -> String {
        format!(
            "Fit(library={}, {} recordings, {} warnings)",
            self.library.get().text(),
            self.trials.len(),
            self.warnings.len()
        )
    }
}

/// Fits a library to recordings, as `stylus fit` does: the same recordings and options give the same bytes.
///
/// `recordings` are a folder with `trials.csv`, a list, files, `Recording`s, or `Recordings`. `order` is 'auto' (AIC),
/// 'bic' or 0 to 400; `reduce` 'pca', 'dft321', 'x', 'y' or 'z'; `high_pass` 'auto', 'none' or a
/// frequency in Hz as text; `excitation` 'auto', 'residual' or 'gaussian';
/// `modulation` 'auto', 'track' or 'none'; `lines` 'auto' or 'none'. `silence_floor_m_s2` is
/// the RMS below which a recording is silent; `drop` names verdicts to leave out; `model_rate_hz` is 5000 or 10000;
/// `snap` moves measured speeds and forces to nominal ones: by at most this share, or 'auto'; `strict` refuses a set in
/// which triage finds anything. `progress(done, total)` counts recordings.
///
/// Raises `StylusError` for the first recording that cannot be used, or a texture that no library holds.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, order = OrderLike::Named("auto".into()), reduce = "pca", high_pass = "auto",
    silence_floor_m_s2 = SILENCE_FLOOR_M_S2, excitation = "auto", modulation = "auto",
    drop = Vec::new(), lines = "auto", model_rate_hz = SAMPLE_RATE_HZ, snap = None, strict = false,
    progress = None
), text_signature = "(recordings, *, order='auto', reduce='pca', high_pass='auto', \
    silence_floor_m_s2=0.001, excitation='auto', modulation='auto', drop=(), lines='auto', model_rate_hz=5000, \
    snap=None, strict=False, progress=None)")]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn fit(
    py: Python<'_>,
    recordings: &Bound<'_, PyAny>,
    order: OrderLike,
    reduce: &str,
    high_pass: &str,
    silence_floor_m_s2: f64,
    excitation: &str,
    modulation: &str,
    drop: Vec<String>,
    lines: &str,
    model_rate_hz: u32,
    snap: Option<SnapLike>,
    strict: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Fit> {
    let options = Options {
        order: order_of(order)?,
        conditioning: conditioning(reduce, high_pass)?,
        silence_floor_m_s2: not_negative("silence_floor_m_s2", silence_floor_m_s2)?,
        excitation: choice("excitation", excitation)?,
        modulation: choice("modulation", modulation)?,
        drop: verdicts(drop)?,
        lines: choice("lines", lines)?,
        strict,
        snap: snap.map(snap_of).transpose()?,
        sample_rate_hz: model_rate_hz,
    };
    options.check_rate().map_err(raised)?;
    let options = options.at_their_rate();
    let mut set = crate::recording::recordings(recordings)?;
    if let Some(snap) = options.snap {
        set = set.snapped(snap).map_err(raised)?.0;
    }
    let textures = set.by_texture().len();
    if textures > model_format::limits::MAX_TEXTURES {
        return Err(refused(format!(
            "the set has {textures} textures, and a library holds {}: fit them one by one",
            model_format::limits::MAX_TEXTURES
        )));
    }
    let total = set.trials.len() as u64;
    let (made, bytes, record) = work::run(py, total, progress, move |steps| {
        let made = fitted::fit_between(&set, &options, || steps.done(), || steps.between())?;
        let bytes = made.library()?;
        let record = FitRecord::of(&set, &options, &bytes)?.with_account_of(&made);
        Ok((made, bytes, record))
    })?;
    let warnings: Vec<String> = made.warnings.iter().map(ToString::to_string).collect();
    for warning in &warnings {
        warn(py, warning)?;
    }
    let record = Arc::new(record);
    Ok(Fit {
        library: Py::new(py, Library::of(bytes.into(), None, Some(record.clone())))?,
        record,
        trials: made.trials.into_iter().map(TrialReport::from).collect(),
        warnings,
    })
}

impl From<fitted::TrialReport> for TrialReport {
    fn from(report: fitted::TrialReport) -> Self {
        Self {
            name: report.file,
            texture: report.texture,
            speed_mm_s: report.speed_mm_s,
            force_n: report.force_n,
            rms_m_s2: report.rms_m_s2,
            mean_m_s2: report.mean_m_s2,
            energy_share: report.energy_share,
            cut_s: report.cut_s,
            verdicts: report.verdicts.iter().map(ToString::to_string).collect(),
            used: report.used,
        }
    }
}

fn order_of(order: OrderLike) -> PyResult<Order> {
    let text = match order {
        OrderLike::Fixed(order) => order.to_string(),
        OrderLike::Named(text) => text,
    };
    let problem = |problem| refused(format!("order is '{text}': it {problem}"));
    text.parse().map_err(problem)
}

fn verdicts(names: Vec<String>) -> PyResult<Vec<String>> {
    match names
        .iter()
        .find(|name| !Kind::NAMES.contains(&name.as_str()))
    {
        None => Ok(names),
        Some(name) => Err(refused(format!(
            "drop names '{name}', which is no verdict: there are {}",
            Kind::NAMES.join(", ")
        ))),
    }
}
