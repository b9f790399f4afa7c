//! Evaluations: what the stylus plays against recordings that were not fitted; and the pages that show them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use host_tools::evaluation::evaluate::{self as evaluation, Evaluation};
use host_tools::evaluation::held_out::{Chosen, chosen};
use host_tools::evaluation::listening::{self, Answers, Compared, Design, Pair, plan};
use host_tools::fit::conditioning::Conditioning;
use host_tools::fit::inputs::{Input, files_behind};
use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::report::sound::node_seconds;
use host_tools::report::{evaluation_page, listening_page, rub_page};
use host_tools::support::Result;
use host_tools::support::output::{OutputFolder, check_file, check_folder};
use host_tools::support::temporaries::folder_of;
use host_tools::texture::library::decode_library;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::convert::{Several, choice, made, plain};
use crate::error::{raised, refused, warn};
use crate::library::Library;
use crate::options::of_keywords;
use crate::playing::LibraryLike;
use crate::work::{self, Steps};

/// Recordings, the library that is compared with them, and other takes that judge it.
struct Judged {
    set: RecordingSet,
    takes: Option<RecordingSet>,
    bytes: Arc<[u8]>,
    path: PathBuf,
    record: Option<Arc<FitRecord>>,
    options: evaluation::Options,
}

impl Judged {
    /// The recordings with the speeds and forces that the library's fit took for its own.
    fn new<'py>(
        recordings: &Bound<'py, PyAny>,
        library: &Library,
        takes: Option<&Bound<'py, PyAny>>,
        options: evaluation::Options,
    ) -> PyResult<Self> {
        let record = library.record().cloned();
        let of_fit = |given| {
            let set = crate::recording::recordings(given)?;
            match &record {
                Some(record) => record.as_fitted(set).map_err(raised),
                None => Ok(set),
            }
        };
        Ok(Self {
            set: of_fit(recordings)?,
            takes: takes.map(of_fit).transpose()?,
            bytes: library.bytes().clone(),
            path: library.named(),
            record,
            options,
        })
    }

    /// The files behind it, which no `output` may be.
    fn inputs(&self, output: &Path) -> Vec<PathBuf> {
        let sets = [Some(&self.set), self.takes.as_ref()];
        let files: Vec<PathBuf> = sets
            .into_iter()
            .flatten()
            .flat_map(|set| &set.trials)
            .map(|trial| trial.file.clone())
            .collect();
        let folders: BTreeSet<PathBuf> = files.iter().map(|file| folder_of(file).to_owned()).collect();
        let given = folders.into_iter().chain([self.path.clone()]).map(Input::from);
        let mut all = files_behind(&given.collect::<Vec<_>>(), output);
        // Their folders hold them, and are no inputs themselves.
        all.retain(|input| !input.is_dir());
        all.extend(files);
        all
    }

    /// The judge of each recording, and takes that judge nothing.
    fn chosen(&self) -> Result<Chosen> {
        let (takes, record) = (self.takes.as_ref(), self.record.as_deref());
        chosen(&self.set, takes, record, self.options.conditioning)
    }

    /// The evaluation, and the takes that judge nothing.
    fn evaluated(&self, steps: &Steps) -> Result<(Evaluation, Vec<String>)> {
        // A decoded library borrows its bytes, so the thread of the work decodes them anew.
        let library = decode_library(&self.path, &self.bytes)?;
        let Chosen { judges, unused, .. } = self.chosen()?;
        steps.between();
        let record = self.record.as_deref();
        let done = || steps.done();
        let found = evaluation::evaluate(&self.set, &library, judges, record, &self.options, done)?;
        Ok((found, unused))
    }

    /// Plans a listening test and passes it to `write`. Returns its number of trials, its notes, and the reasons for
    /// takes that judge nothing.
    fn compared(
        &self,
        before: Option<Compared<'_>>,
        options: &listening::Options,
        write: impl FnOnce(&listening::Plan) -> Result<()>,
    ) -> Result<(usize, Vec<String>, Vec<String>)> {
        let library = &decode_library(&self.path, &self.bytes)?;
        let Chosen { judges, unused, .. } = self.chosen()?;
        let record = self.record.as_deref();
        let fitted = Compared { library, record };
        let plan = plan(&self.set, &judges, fitted, before, &self.options, options)?;
        write(&plan)?;
        let notes = plan.notes(options.excerpt_s, self.takes.is_some());
        Ok((plan.task.trials(), notes, unused))
    }
}

/// Warns of takes that judge nothing, for these reasons.
fn warn_of_unused(py: Python<'_>, reasons: &[String]) -> PyResult<()> {
    let mut warnings = (reasons.iter()).map(|reason| format!("a take judges nothing: {reason}"));
    warnings.try_for_each(|warning| warn(py, &warning))
}

/// Compares what the stylus plays with recordings that were not fitted, as `stylus evaluate` does.
///
/// `recordings` are as in `fit`, and `library` is a `Library`, a `Fit`, or a path. `takes` are other recordings of the
/// same trials, which judge the library instead. With `report`, a folder, a page on it with pictures and sounds is
/// written there, as with the command's --report; an earlier one is replaced with `overwrite` alone.
/// `progress(done, total)` counts recordings. Options:
#[pyfunction]
#[pyo3(signature = (
    recordings, library, *, takes = None, report = None, overwrite = false, progress = None, **options
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn evaluate<'py>(
    py: Python<'py>,
    recordings: &Bound<'py, PyAny>,
    library: LibraryLike<'py>,
    takes: Option<&Bound<'py, PyAny>>,
    report: Option<PathBuf>,
    overwrite: bool,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = of_keywords(options, &[])?;
    let library = library.library(py)?;
    let mut judged = Judged::new(recordings, library.get(), takes, options)?;
    let total = judged.set.trials.len();
    if let Some(folder) = &report {
        // Before the work, so that no minutes are lost to an output that cannot be written.
        check_folder(folder, overwrite, &judged.inputs(folder)).map_err(raised)?;
        judged.options.excerpt_s = node_seconds(total);
    }
    let (found, unused) = work::run(py, total as u64, progress, move |steps| {
        let (found, unused) = judged.evaluated(steps)?;
        if let Some(folder) = report {
            let inputs = evaluation_page::Inputs {
                set: &judged.set,
                library: &decode_library(&judged.path, &judged.bytes)?,
                evaluation: &found,
                options: &judged.options,
                removed_nodes: None,
                unused_takes: &unused,
            };
            OutputFolder::begin(&folder, overwrite)?
                .fill(|folder| evaluation_page::write(&inputs, folder.path(), || steps.between()))?;
        }
        Ok((found, unused))
    })?;
    warn_of_unused(py, &unused)?;
    made(py, "Evaluation", (plain(py, &found)?,))
}

/// Writes a library as one page to rub, as `stylus page` does, and returns the digest of each texture by its name.
///
/// `library` is a `Library`, a `Fit`, or a path; `out` the HTML file to write, replaced with `overwrite` alone. With
/// `recordings`, as in `fit`, their clips, spectra and C come too; clips are of `clips_s`, 0.1 to 10 s each, or as long
/// as the page's size allows. `seed` is the one that the page begins with. `progress(done, total)` counts recordings.
/// Options:
#[pyfunction]
#[pyo3(signature = (
    library, out, *, recordings = None, clips_s = None, seed = 1, overwrite = false, progress = None, **options
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn page<'py>(
    py: Python<'py>,
    library: LibraryLike<'py>,
    out: PathBuf,
    recordings: Option<&Bound<'py, PyAny>>,
    clips_s: Option<f64>,
    seed: u32,
    overwrite: bool,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let conditioning: Conditioning = of_keywords(options, &[])?;
    let clips = match clips_s {
        None => rub_page::Clips::Budget,
        Some(seconds) if (0.1..=10.0).contains(&seconds) => rub_page::Clips::Seconds(seconds),
        Some(other) => return Err(refused(format!("clips_s is {other}: it must be 0.1 to 10"))),
    };
    let library = library.library(py)?;
    let library = library.get();
    let options = evaluation::Options {
        conditioning,
        seed: seed.into(),
        ..evaluation::Options::default()
    };
    let judged = recordings
        .map(|recordings| Judged::new(recordings, library, None, options))
        .transpose()?;
    let (bytes, path) = (library.bytes().clone(), library.named());
    let inputs = match &judged {
        Some(judged) => judged.inputs(&out),
        None => files_behind(&[Input::from(path.clone())], &out),
    };
    check_file(&out, overwrite, &inputs).map_err(raised)?;
    let total = judged.as_ref().map_or(0, |judged| judged.set.trials.len());
    work::run(py, total as u64, progress, move |steps| {
        let evaluation = match &judged {
            Some(judged) => Some(judged.evaluated(steps)?.0),
            None => None,
        };
        let recordings =
            judged
                .as_ref()
                .zip(evaluation.as_ref())
                .map(|(judged, evaluation)| rub_page::JudgedRecordings {
                    set: &judged.set,
                    evaluation,
                    conditioning,
                    clips,
                });
        let inputs = rub_page::Inputs {
            library: &decode_library(&path, &bytes)?,
            bytes: &bytes,
            recordings,
            seed: seed.into(),
            plant: None,
        };
        rub_page::write(&inputs, &out, || steps.between())
    })?
    .digests
    .into_py_dict(py)
}

/// Writes a page for a blind listening test of recordings and what the stylus plays, as `stylus compare` does, and
/// returns the number of its trials, of staircases at most. `design` is 'abx', 'similarity' or 'staircase'.
///
/// `recordings`, `library` and `takes` are as in `evaluate`; `out` is the HTML file to write, replaced with `overwrite`
/// alone. `before` is another library to compare with, on `takes`. `pairs` are of 'recording-fitted',
/// 'recording-gaussian', 'gaussian-fitted', 'recording-before' and 'before-fitted'; `trials` is their number per pair
/// or staircase, 1 to 200, by default 12, 6 and 80 by design; `segment_s` the duration of a sound, s, at most 10;
/// `seed` that of order and noise. Warns of pairs that are left out. See `score`. Options:
#[pyfunction]
#[pyo3(signature = (
    recordings, library, out, *, takes = None, before = None, design = "abx", pairs = Several(Vec::new()),
    trials = None, segment_s = 1.5, seed = 1, overwrite = false, **options
), text_signature = "(recordings, library, out, *, takes=None, before=None, design='abx', pairs=(), trials=None, \
    segment_s=1.5, seed=1, overwrite=False, **options)")]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn compare<'py>(
    py: Python<'py>,
    recordings: &Bound<'py, PyAny>,
    library: LibraryLike<'py>,
    out: PathBuf,
    takes: Option<&Bound<'py, PyAny>>,
    before: Option<LibraryLike<'py>>,
    design: &str,
    pairs: Several<String>,
    trials: Option<usize>,
    segment_s: f64,
    seed: u64,
    overwrite: bool,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<usize> {
    let conditioning = of_keywords(options, &[])?;
    let (design, pairs) = asked(design, &pairs.0, before.is_some())?;
    let options = listening::Options {
        design,
        pairs,
        seed,
        ..trials_of(trials.unwrap_or(design.usual_trials()), segment_s)?
    };
    let evaluate = evaluation::Options {
        conditioning,
        seed,
        ..evaluation::Options::default()
    };
    let judged = Judged::new(recordings, library.library(py)?.get(), takes, evaluate)?;
    let before = before.map(|before| before.library(py)).transpose()?;
    let mut inputs = judged.inputs(&out);
    if let Some(before) = &before {
        inputs.extend(files_behind(&[Input::from(before.get().named())], &out));
    }
    check_file(&out, overwrite, &inputs).map_err(raised)?;
    if before.is_some() && judged.takes.is_none() {
        return Err(refused("before is compared on other takes: give takes"));
    }
    let before = before.map(|before| {
        let before = before.get();
        let (bytes, record) = (before.bytes().clone(), before.record().cloned());
        (bytes, before.named(), record)
    });
    // It tells no progress, but runs in a thread of its own, so that Ctrl-C ends it.
    let (trials, notes, unused) = work::run(py, 0, None, move |steps| {
        let decoded = (before.as_ref())
            .map(|(bytes, path, _)| decode_library(path, bytes))
            .transpose()?;
        let before = decoded
            .as_ref()
            .zip(before.as_ref())
            .map(|(library, (.., record))| Compared {
                library,
                record: record.as_deref(),
            });
        judged.compared(before, &options, |plan| {
            steps.between();
            listening_page::write(plan, &out).map(drop)
        })
    })?;
    warn_of_unused(py, &unused)?;
    notes.iter().try_for_each(|note| warn(py, note))?;
    Ok(trials)
}

/// The design of this name, with the pairs of these names, or its usual ones.
fn asked(design: &str, pairs: &[String], has_before: bool) -> PyResult<(Design, Vec<Pair>)> {
    let pairs = pairs
        .iter()
        .map(|pair| choice::<Pair>("pairs", pair))
        .collect::<PyResult<Vec<_>>>()?;
    let design = choice::<Design>("design", design)?;
    if design == Design::Staircase && (has_before || !pairs.is_empty()) {
        return Err(refused(
            "a staircase varies parts of one library: leave pairs and before out",
        ));
    }
    Ok((design, Pair::asked(&pairs, has_before)))
}

/// Options with this number of trials, and excerpts of this duration, s.
fn trials_of(trials: usize, excerpt_s: f64) -> PyResult<listening::Options> {
    let least = listening::SHORTEST_EXCERPT_S;
    if !(1..=200).contains(&trials) || !(least..=10.0).contains(&excerpt_s) {
        return Err(refused(format!(
            "trials is {trials} and segment_s {excerpt_s}: give 1 to 200 trials of {least} to 10 s"
        )));
    }
    Ok(listening::Options {
        trials,
        excerpt_s,
        ..listening::Options::default()
    })
}

/// The rows of saved answers, all files after each other, each as pairs of a column's name and a value.
#[pyfunction]
#[pyo3(name = "_read_answers")]
pub fn read_answers(py: Python<'_>, paths: Several<PathBuf>) -> PyResult<Bound<'_, PyAny>> {
    let files = Answers::read_all(&paths.0).map_err(raised)?;
    plain(py, &files.iter().flat_map(Answers::rows).collect::<Vec<_>>())
}

/// Scores saved answers of listening tests, those of all files together, as `stylus compare --score` does.
///
/// Returns a dictionary per pair, and one for all: `pair`, `files`, `trials`, `correct`, `proportion`, `interval`
/// (exact, 95 %), `chance`, `is_told_apart`, `simulated`.
#[pyfunction]
pub fn score(py: Python<'_>, answers: Several<PathBuf>) -> PyResult<Bound<'_, PyAny>> {
    let scores = Answers::read_all(&answers.0).and_then(|answers| listening::score(&answers));
    plain(py, &scores.map_err(raised)?)
}
