//! Fits: from recordings to a library.

use std::path::PathBuf;
use std::sync::Arc;

use host_tools::fit as fitted;
use host_tools::fit::conditioning::Conditioning;
use host_tools::fit::record::FitRecord;
use host_tools::fit::{Options, Order};
use host_tools::recording::freehand;
use host_tools::recording::triage::{Kind, SILENCE_FLOOR_M_S2};
use host_tools::recording::{Snap, texture_fault};
use host_tools::support::error::Result;
use host_tools::support::number::tolerance;
use host_tools::support::warning::by_kind;
use model_format::SAMPLE_RATE_HZ;
use pyo3::prelude::*;

use crate::convert::{Several, checked, choice, conditioning, made, not_negative, positive};
use crate::error::{raised, refused, warn};
use crate::hatt::Paths;
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

/// The way in which measured values move: a share, or a word.
#[derive(FromPyObject)]
pub enum SnapLike {
    /// A share.
    Within(f64),
    /// 'clear', 'auto' or 'none'.
    Named(String),
}

fn snap_of(snap: SnapLike) -> PyResult<Snap> {
    match snap {
        SnapLike::Within(share) => checked("snap", share, tolerance).map(Snap::Within),
        SnapLike::Named(word) => (word.parse()).map_err(|fault| refused(format!("snap '{word}' {fault}"))),
    }
}

/// Fits a library to recordings, as `stylus fit` does: the same recordings and options give the same bytes.
///
/// `recordings` are a folder with `trials.csv`, a list, files, `Recording`s, or `Recordings`. `order` is 'auto',
/// 'bic' or 0 to 400; `reduce` 'pca', 'dft321', 'x', 'y' or 'z'; `high_pass` 'auto', 'none' or a
/// frequency in Hz as text; `excitation` 'auto', 'snippets' or 'gaussian';
/// `lines` 'auto' or 'none'. `floor` tells ('note') or takes off ('subtract')
/// the rig's own noise, which trials in motion at 0 N have, or `floor_recording`, a file or list; or 'none'.
/// `silence_floor_m_s2` is the RMS below which a recording is silent; `drop` names verdicts to leave out;
/// `model_rate_hz` is 5000 or 10000; `snap` moves measured speeds and forces to nominal ones: by at most this share, by
/// 'clear' gaps, to the likeliest grid ('auto') or not ('none'); `strict` refuses a set in which triage finds anything.
/// What moves is a warning. `progress(done, total)` counts recordings.
///
/// Raises `StylusError` for the first recording that cannot be used, or a texture that no library holds.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, order = OrderLike::Named("auto".into()), reduce = "pca", high_pass = "auto",
    silence_floor_m_s2 = SILENCE_FLOOR_M_S2, excitation = "auto",
    drop = Several(Vec::new()), lines = "auto", floor = "note", floor_recording = None,
    model_rate_hz = SAMPLE_RATE_HZ, snap = SnapLike::Named("clear".into()), strict = false, progress = None
), text_signature = "(recordings, *, order='auto', reduce='pca', high_pass='auto', \
    silence_floor_m_s2=0.001, excitation='auto', drop=(), lines='auto', floor='note', \
    floor_recording=None, model_rate_hz=5000, snap='clear', strict=False, progress=None)")]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn fit<'py>(
    py: Python<'py>,
    recordings: &Bound<'py, PyAny>,
    order: OrderLike,
    reduce: &str,
    high_pass: &str,
    silence_floor_m_s2: f64,
    excitation: &str,
    drop: Several<String>,
    lines: &str,
    floor: &str,
    floor_recording: Option<PathBuf>,
    model_rate_hz: u32,
    snap: SnapLike,
    strict: bool,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let conditioning = conditioning(reduce, high_pass)?;
    let options = Options {
        drop: verdicts(drop.0)?,
        lines: choice("lines", lines)?,
        floor: choice("floor", floor)?,
        floor_recording,
        strict,
        snap: snap_of(snap)?,
        sample_rate_hz: model_rate_hz,
        ..options_of(order, conditioning, silence_floor_m_s2, excitation)?
    };
    options.check_rate().map_err(raised)?;
    // What was chosen by hand and exists only at 5 kHz was refused above. Automatic choices are left out.
    let options = options.at_their_rate();
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
/// that of the times, and `scale_m_s2`, the acceleration of a sample of 1, that of the header, or 1. The other options
/// are those of `fit`. `progress(done, total)` counts strokes.
///
/// Raises `StylusError` for the first file that cannot be used, or if no node has 0.4 s in motion and contact.
#[pyfunction]
#[pyo3(signature = (
    files, texture, *, order = OrderLike::Named("auto".into()), reduce = "pca", high_pass = "auto",
    silence_floor_m_s2 = SILENCE_FLOOR_M_S2, excitation = "auto", lines = "auto", sample_rate_hz = None,
    scale_m_s2 = None, progress = None
), text_signature = "(files, texture, *, order='auto', reduce='pca', high_pass='auto', silence_floor_m_s2=0.001, \
    excitation='auto', lines='auto', sample_rate_hz=None, scale_m_s2=None, progress=None)")]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn fit_strokes<'py>(
    py: Python<'py>,
    files: Paths,
    texture: &str,
    order: OrderLike,
    reduce: &str,
    high_pass: &str,
    silence_floor_m_s2: f64,
    excitation: &str,
    lines: &str,
    sample_rate_hz: Option<f64>,
    scale_m_s2: Option<f64>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let conditioning = conditioning(reduce, high_pass)?;
    let options = Options {
        lines: choice("lines", lines)?,
        ..options_of(order, conditioning, silence_floor_m_s2, excitation)?
    };
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

/// The options that all fits have.
fn options_of(
    order: OrderLike,
    conditioning: Conditioning,
    silence_floor_m_s2: f64,
    excitation: &str,
) -> PyResult<Options> {
    Ok(Options {
        order: order_of(order)?,
        conditioning,
        silence_floor_m_s2: not_negative("silence_floor_m_s2", silence_floor_m_s2)?,
        excitation: choice("excitation", excitation)?,
        ..Options::default()
    })
}

fn order_of(order: OrderLike) -> PyResult<Order> {
    // The command's own parser, so that both refuse the same orders.
    let text = match order {
        OrderLike::Fixed(order) => order.to_string(),
        OrderLike::Named(text) => text,
    };
    let problem = |problem| refused(format!("order is '{text}': it {problem}"));
    text.parse().map_err(problem)
}

fn verdicts(names: Vec<String>) -> PyResult<Vec<String>> {
    match names.iter().find(|name| !Kind::NAMES.contains(&name.as_str())) {
        None => Ok(names),
        Some(name) => Err(refused(format!(
            "drop names '{name}', which is no verdict: there are {}",
            Kind::NAMES.join(", ")
        ))),
    }
}
