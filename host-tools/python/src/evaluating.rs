//! Evaluations: what the stylus plays against recordings that were not fitted.

use host_tools::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use host_tools::evaluation::evaluate as evaluation;
use host_tools::evaluation::held_out::chosen;
use host_tools::evaluation::summary as results;
use host_tools::texture::library::decode_library;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::convert::{array, choice, conditioning, not_negative, plain, positive, table};
use crate::error::{raised, warn};
use crate::playing::LibraryLike;
use crate::work;

// A literal below, so that `help` shows it.
const _: () = assert!(DEFAULT_SMOOTHING_WIDTH_HZ == 20.0);

/// The outcome of an evaluation. Arrays have one row per recording, in the order of the set; figures that do not exist
/// are NaN.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Evaluation(evaluation::Evaluation);

impl Evaluation {
    fn of_trials(
        &self,
        py: Python<'_>,
        of: impl Fn(&results::TrialEvaluation) -> Option<f64>,
    ) -> Py<PyArray1<f64>> {
        let values = self
            .0
            .trials
            .iter()
            .map(|trial| of(trial).unwrap_or(f64::NAN));
        array(py, values.collect())
    }
}

#[pymethods]
impl Evaluation {
    /// The data that were held out, in words.
    #[getter]
    fn held_out(&self) -> &str {
        &self.0.held_out
    }

    /// True if any recording behind it is simulated.
    #[getter]
    fn simulated(&self) -> bool {
        self.0.simulated
    }

    /// Cost C of each recording; a share.
    #[getter]
    fn cost(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.of_trials(py, |trial| trial.scores.cost)
    }

    /// Log-spectral distance of each recording, dB.
    #[getter]
    fn log_spectral_distance_db(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        self.of_trials(py, |trial| trial.scores.log_spectral_distance_db)
    }

    /// Level of the synthesis over the recording's in each third octave, dB, of the shape (recordings, bands).
    #[getter]
    fn band_errors_db(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let trials = &self.0.trials;
        let errors = trials.iter().flat_map(|trial| trial.scores.band_errors_db);
        let errors = errors.map(|error| error.unwrap_or(f64::NAN)).collect();
        table(py, errors, trials.len())
    }

    /// Nominal centre frequencies of the third octaves, Hz.
    #[getter]
    fn bands_hz(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        let labels = self.0.bands_hz.iter();
        let numbers = labels.map(|label| label.parse().unwrap_or(f64::NAN));
        array(py, numbers.collect())
    }

    /// All figures as plain objects: those of `stylus evaluate --json`.
    fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.0)
    }

    fn __len__(&self) -> usize {
        self.0.trials.len()
    }

    fn __repr__(&self) -> String {
        let textures = self.0.textures.iter().map(|texture| {
            let cost = texture.mean_cost.unwrap_or(f64::NAN);
            let distance = texture.synthesis.mean_log_spectral_distance_db;
            format!(
                "{}: C {:.1} %, {:.2} dB",
                texture.texture,
                100.0 * cost,
                distance.unwrap_or(f64::NAN)
            )
        });
        let textures: Vec<String> = textures.collect();
        format!("Evaluation({})", textures.join("; "))
    }
}

/// Compares what the stylus plays with recordings that were not fitted, as `stylus evaluate` does.
///
/// `recordings` are as in `fit`, and `library` is a `Library`, a `Fit`, or a path. `takes` are other recordings of the
/// same trials, which judge the library instead. `reduce` and `high_pass` are those of the fit; `smoothing_hz` the full
/// width of the Hann kernel that smooths amplitudes for C; `synthesis_s` the least duration of each synthesis, s;
/// `excitation` 'fitted', 'gaussian' or 'residual', the parts of each texture that are played. `progress(done, total)`
/// counts recordings.
#[pyfunction]
#[pyo3(signature = (
    recordings, library, *, takes = None, reduce = "pca", high_pass = "auto", smoothing_hz = 20.0,
    synthesis_s = 10.0, excitation = "fitted", seed = 1, progress = None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn evaluate<'py>(
    py: Python<'py>,
    recordings: &Bound<'py, PyAny>,
    library: LibraryLike<'py>,
    takes: Option<&Bound<'py, PyAny>>,
    reduce: &str,
    high_pass: &str,
    smoothing_hz: f64,
    synthesis_s: f64,
    excitation: &str,
    seed: u64,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Evaluation> {
    let options = evaluation::Options {
        conditioning: conditioning(reduce, high_pass)?,
        smoothing_hz: not_negative("smoothing_hz", smoothing_hz)?,
        synthesis_s: positive("synthesis_s", synthesis_s)?,
        seed,
        played: choice("excitation", excitation)?,
        ..evaluation::Options::default()
    };
    let library = library.library(py)?;
    let library = library.get();
    let record = library.record().cloned();
    let of_fit = |set| match &record {
        Some(record) => record.as_fitted(set).map_err(raised),
        None => Ok(set),
    };
    let set = of_fit(crate::recording::recordings(recordings)?)?;
    let others = takes.map(crate::recording::recordings).transpose()?;
    let others = others.map(of_fit).transpose()?;
    let total = set.trials.len() as u64;
    let (bytes, path) = (library.bytes().clone(), library.named());
    let (found, unused) = work::run(py, total, progress, move |steps| {
        let record = record.as_deref();
        let decoded = decode_library(&path, &bytes)?;
        let chosen = chosen(&set, others.as_ref(), record, options.conditioning)?;
        steps.between();
        let judges = chosen.judges;
        let found = evaluation::evaluate(&set, &decoded, judges, record, &options, || {
            steps.done();
        })?;
        Ok((found, chosen.unused))
    })?;
    for reason in &unused {
        warn(py, &format!("a take judges nothing: {reason}"))?;
    }
    Ok(Evaluation(found))
}
