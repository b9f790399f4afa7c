//! `stylus evaluate`

use std::path::{Path, PathBuf};

use model_format::{Library, Texture};
use serde::Serialize;
use stylus_evaluation::evaluate::{self, Evaluation};
use stylus_evaluation::held_out::{Chosen, Judge, chosen};
use stylus_evaluation::leave_one_out::{self, LeaveOneOut, Prepared};
use stylus_evaluation::strokes::{Stroke, along_strokes};
use stylus_evaluation::summary::{LIVELINESS_EXPLANATION, explanation};
use stylus_evaluation::verdict;
use stylus_fit::fit::Order;
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::fit::record::FitRecord;
use stylus_report::evaluation_page::{self, Inputs};
use stylus_report::sound::node_seconds;
use stylus_signals::recording::RecordingSet;
use stylus_signals::recording::freehand::{self, Freehand};
use stylus_support::Warning;
use stylus_support::number::counted;
use stylus_support::output::OutputFolder;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, progress};

use super::files::Overwrite;
use super::input::{RecordingArguments, warn_of_unknown_levels};
use super::output::{LINE_CHARS, folded_text, wrapped};
use super::output::{is_full, print, to_json, warn, warn_of};
use super::table::shown;
use stylus_fit::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    recordings: RecordingArguments,
    /// Library to evaluate
    #[arg(
        long,
        value_name = "LIB",
        required_unless_present = "leave_one_out",
        required_if_eq_any([("played", "gaussian"), ("played", "residual")])
    )]
    library: Option<PathBuf>,
    /// Also remove each inner node in turn, predict it from its neighbours, and evaluate the prediction
    #[arg(long)]
    leave_one_out: bool,
    /// Other takes of the same trials, as a folder or a list, to judge the library in place of the inputs
    #[arg(long, value_name = "DIR", requires = "library")]
    takes: Option<PathBuf>,
    /// A free hand's recordings that the library was not fitted to, which judge it in time: CSV as for fit --strokes.
    /// The inputs are then the recordings that it was fitted to, for comparison
    #[arg(
        long,
        value_name = "CSV",
        num_args = 1..,
        requires = "library",
        conflicts_with_all = ["takes", "leave_one_out", "report", "played", "smoothing_hz", "synthesis_s"]
    )]
    strokes: Vec<PathBuf>,
    /// With --strokes: texture of the library that was stroked, if it has several
    #[arg(long, value_name = "NAME", requires = "strokes")]
    texture: Option<String>,
    /// With --leave-one-out: order of the models, 0 to 400, 'auto' or 'bic'
    #[arg(long, conflicts_with = "strokes", default_value = "400")]
    order: Order,
    /// Folder for a report: one page with tables, pictures and sounds, and the pictures as files
    #[arg(long, value_name = "OUT_DIR", requires = "library")]
    report: Option<PathBuf>,
    /// JSON file for the numbers of all trials
    #[arg(long, value_name = "FILE")]
    json_out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    judging: evaluate::Options,
}

/// The numbers of the evaluation and of the removed-node test.
#[derive(Serialize)]
struct Numbers<'a> {
    #[serde(flatten)]
    evaluation: Option<&'a Evaluation>,
    #[serde(skip_serializing_if = "Option::is_none")]
    removed_nodes: Option<&'a LeaveOneOut>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(json) = &arguments.json_out {
        arguments.overwrite.file(json)?;
    }
    if let Some(report) = &arguments.report {
        arguments.overwrite.folder(report)?;
    }
    if let (Some(path), false) = (&arguments.library, arguments.strokes.is_empty()) {
        return evaluate_along_strokes(arguments, path);
    }
    let set = arguments.recordings.open()?;
    if let Some(path) = &arguments.library {
        return evaluate_library(arguments, path, set);
    }
    let test = removed_node_test(&set, &removal_options(arguments))?;
    write_numbers(arguments, None, Some(&test))?;
    print(&removed_nodes(&test))
}

/// Returns the texture called `name`; without a name, the only one.
fn stroked<'a>(library: &Library<'a>, name: Option<&str>) -> Result<Texture<'a>> {
    if let Some(name) = name {
        return evaluate::texture_named(library, name);
    }
    let mut textures = library.textures();
    match (textures.next(), textures.next()) {
        (Some(only), None) => Ok(only),
        _ => Err(Error::Request(
            "the library has several textures: give --texture NAME".into(),
        )),
    }
}

fn evaluate_along_strokes(arguments: &Arguments, path: &Path) -> Result<()> {
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let texture = stroked(&library, arguments.texture.as_deref())?;
    warn_of_unknown_levels([texture]);
    let assumed = arguments.recordings.assumed();
    let record = FitRecord::beside(path, &bytes)?;
    let given = record.and_then(|record| record.given_scale_m_s2());
    // Judges in other units than the library's would be off by that factor in every level.
    if let (None, Some(scale)) = (assumed.scale_m_s2, given) {
        return Err(Error::file(
            path,
            format!("was fitted with --scale {scale}: give it here, too"),
        ));
    }
    let read = |paths: &[PathBuf]| {
        let read = |path: &PathBuf| freehand::read(path, assumed.sample_rate_hz, assumed.scale_m_s2);
        paths.iter().map(read).collect::<Result<Vec<_>>>()
    };
    let (fitted, judges) = (arguments.recordings.inputs(), &arguments.strokes);
    // Other commands take folders here. Reading one as a file would fail without a remedy.
    if let Some(folder) = fitted.iter().find(|path| path.is_dir()) {
        let problem = "is a folder: with --strokes give the CSVs of strokes that were fitted, such as stroke-1.csv";
        return Err(Error::file(folder, problem));
    }
    let (of_fit, of_judges) = (read(fitted)?, read(judges)?);
    for (path, judge) in judges.iter().zip(&of_judges) {
        // Compared by content, because a copy under another name would judge in sample, too.
        if of_fit.contains(judge) {
            let problem = "is among the recordings of the fit, by content: it cannot judge";
            return Err(Error::file(path, problem));
        }
    }
    let strokes = |paths: &[PathBuf], recordings: Vec<Freehand>| {
        paths
            .iter()
            .zip(recordings)
            .map(|(path, own)| Stroke::of(path, own, arguments.judging.conditioning))
            .collect::<Result<Vec<_>>>()
    };
    let found = along_strokes(
        texture,
        &strokes(fitted, of_fit)?,
        &strokes(judges, of_judges)?,
        arguments.judging.seed,
    )?;
    if let Some(json) = &arguments.json_out {
        atomic_file::write(json, to_json(&found).as_bytes())?;
    }
    let verdict = folded_text(&format!("{}: {}", found.texture, found.verdict));
    print(&format!("{verdict}\n\n{}\n", shown(&found.table())))?;
    print(&folded_text(&format!(
        "Held out: the library as it is, along {} that its fit did not use; {} of its fit \
         beside. Levels are of 100 ms in motion and contact, {} of them, whose own spread is {:.2} dB. Bias: mean of \
         the levels over those recorded. |band|: mean error of third octaves.{}",
        counted(found.strokes, "stroke"),
        found.fitted,
        found.windows,
        found.recorded_spread_db,
        origin(found.simulated)
    )))
}

fn removal_options(arguments: &Arguments) -> leave_one_out::Options {
    leave_one_out::Options {
        judging: arguments.judging,
        order: arguments.order,
    }
}

fn evaluate_library(arguments: &Arguments, path: &Path, set: RecordingSet) -> Result<()> {
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    warn_of_unknown_levels(library.textures());
    let options = evaluate::Options {
        // Only a report plays excerpts; otherwise they would take memory for nothing.
        excerpt_s: (arguments.report.as_ref()).and_then(|_| node_seconds(set.trials.len())),
        ..arguments.judging
    };
    let record = FitRecord::beside(path, &bytes)?;
    let set = as_fitted(record.as_ref(), set)?;
    let takes = (arguments.recordings).open_takes(arguments.takes.as_ref())?;
    let chosen = choose(&set, takes, record.as_ref(), arguments.judging.conditioning)?;
    let evaluation = evaluate_set(&set, &library, chosen.judges, record.as_ref(), &options)?;
    let removed = || removed_node_test(&set, &removal_options(arguments));
    let test = arguments.leave_one_out.then(removed).transpose()?;
    // Written before anything is printed, so that a reader that closes the output early does not cost the numbers.
    write_numbers(arguments, Some(&evaluation), test.as_ref())?;
    print(&summary(&evaluation))?;
    if let Some(test) = &test {
        print(&format!("\n{}", removed_nodes(test)))?;
    }
    if let Some(report) = &arguments.report {
        let inputs = Inputs {
            set: &set,
            library: &library,
            evaluation: &evaluation,
            options: &options,
            removed_nodes: test.as_ref(),
            unused_takes: &chosen.unused,
        };
        let folder = OutputFolder::begin(report, arguments.overwrite.is_asked())?;
        let page = folder.fill(|folder| {
            let page = write_report(&inputs, folder.path())?;
            Ok(folder.named(&page))
        })?;
        print(&format!("\nreport: {}", page.display()))?;
    }
    Ok(())
}

/// Writes the report on an evaluation with a progress bar. Returns its page's path.
pub fn write_report(inputs: &Inputs<'_>, folder: &Path) -> Result<PathBuf> {
    let bar = progress::bar(inputs.evaluation.textures.len() as u64, "reporting");
    let page = evaluation_page::write(inputs, folder, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(page)
}

fn write_numbers(
    arguments: &Arguments,
    evaluation: Option<&Evaluation>,
    removed_nodes: Option<&LeaveOneOut>,
) -> Result<()> {
    let Some(json) = &arguments.json_out else {
        return Ok(());
    };
    let numbers = Numbers {
        evaluation,
        removed_nodes,
    };
    atomic_file::write(json, to_json(&numbers).as_bytes())
}

/// Evaluates `library` against `judges`, with a progress bar.
pub fn evaluate_set(
    set: &RecordingSet,
    library: &Library<'_>,
    judges: Vec<Judge>,
    record: Option<&FitRecord>,
    options: &evaluate::Options,
) -> Result<Evaluation> {
    let bar = progress::bar(set.trials.len() as u64, "evaluating");
    let evaluation = evaluate::evaluate(set, library, judges, record, options, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(evaluation)
}

/// Runs the removed-node test with a progress bar.
fn removed_node_test(set: &RecordingSet, options: &leave_one_out::Options) -> Result<LeaveOneOut> {
    let prepared = Prepared::new(set, options)?;
    let bar = progress::bar(prepared.count() as u64, "removing nodes");
    let test = prepared.run(options, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(test)
}

/// Returns `set` as the fit of `record` read it: with the speeds and forces to which the fit assigned its trials, and
/// with the scales and units of times that the user gave for the fit. Without a record, `set` stays as it is.
///
/// # Errors
/// A recording cannot be read, or values are so close that the record's tolerance cannot distinguish them.
pub fn as_fitted(record: Option<&FitRecord>, set: RecordingSet) -> Result<RecordingSet> {
    match record {
        Some(record) => record.as_fitted(set),
        None => Ok(set),
    }
}

/// Chooses the judges of `set` among the takes `others`, if given. Warns of takes that judge nothing, and of trials
/// that are judged without another take.
pub fn choose(
    set: &RecordingSet,
    others: Option<RecordingSet>,
    record: Option<&FitRecord>,
    conditioning: Conditioning,
) -> Result<Chosen> {
    let others = others.map(|others| as_fitted(record, others)).transpose()?;
    let chosen = chosen(set, others.as_ref(), record, conditioning)?;
    let unused = chosen.unused.iter().map(|reason| {
        // A reason has the form `take: why`. The take becomes the warning's subject, so that many are told in one line.
        let (take, why) = reason.rsplit_once(": ").unwrap_or(("", reason));
        Warning::of("take", ("take", take), 0.0, format!("judges nothing: {why}"))
    });
    warn_of(&unused.collect::<Vec<_>>());
    if let Some(first) = chosen.without.first() {
        let (count, all) = (chosen.without.len(), set.trials.len());
        warn(&format!(
            "{count} of {all} trials are judged without --takes; the first: {first}"
        ));
    }
    Ok(chosen)
}

/// Returns a verdict per texture, and one table with an explanation of its columns.
pub fn answer(evaluation: &Evaluation) -> String {
    let verdicts: Vec<String> = evaluation.verdicts().map(|v| wrapped(&v, LINE_CHARS, "  ")).collect();
    format!(
        "{}\n\n{}\n{}",
        verdicts.join("\n"),
        shown(&evaluation.table()),
        folded_text(&explanation())
    )
}

/// Returns the answer and the method of judging; with `--full` also all tables.
fn summary(evaluation: &Evaluation) -> String {
    let how = folded_text(&format!(
        "Held out: {}\n{}{}",
        evaluation.held_out,
        evaluation.judged_hz(),
        origin(evaluation.simulated)
    ));
    let brief = format!("{}\n\n{how}", answer(evaluation));
    if !is_full() {
        return brief;
    }
    let tables = evaluation.tables().map(|table| shown(&table));
    let notes = folded_text(&format!(
        "{}\nAmplitudes of C are smoothed by a {}. |band|: mean error of third octaves. Balance: power below 100 Hz \
         over that above. {LIVELINESS_EXPLANATION}",
        verdict::explanation(),
        evaluation.smoothing
    ));
    format!("{brief}\n\n{}\n\n{notes}", tables.join("\n\n"))
}

fn origin(simulated: bool) -> &'static str {
    if simulated {
        "\nThe recordings are SIMULATED."
    } else {
        ""
    }
}

/// Returns the table of the removed-node test, and an explanation of its columns.
fn removed_nodes(test: &LeaveOneOut) -> String {
    let test_of = folded_text(&format!(
        "{} removed, each predicted from its neighbours; models of order {}; C with amplitudes smoothed by a {}",
        counted(test.removed.len(), "node"),
        test.order,
        test.smoothing
    ));
    let columns = folded_text(&format!(
        "C: equation (6), mean ± standard deviation; not playable: means that are unstable or too loud, which count as \
         C = 100 %; in-sample: fitted to what it is compared with, not a measure of fidelity\n\
         σ² error: mean magnitude, (m/s²)² (the paper names no unit); |band|: mean error of third-octave \
         bands, 20 to 1000 Hz; LSD: 30 to 1000 Hz{}",
        origin(test.simulated)
    ));
    format!("{test_of}\n\n{}\n\n{columns}", shown(&test.table()))
}
