//! `stylus evaluate`

pub mod removed_nodes;
mod summary;
pub mod takes;

use std::path::PathBuf;

use host_tools::dsp::reduction::Reduction;
use host_tools::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use host_tools::evaluation::evaluate;
use host_tools::evaluation::evaluate::Evaluation;
use host_tools::evaluation::held_out::Judge;
use host_tools::evaluation::leave_one_out;
use host_tools::evaluation::leave_one_out::Around;
use host_tools::evaluation::played::Played;
use host_tools::fit::Order;
use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::report::evaluation_folder as report;
use host_tools::report::sound::node_seconds;
use host_tools::support::error::Result;
use host_tools::support::output::OutputFolder;
use host_tools::support::{atomic_file, progress};
use model_format::Library;

pub use summary::summary;

use crate::cli::input::{Recordings, not_negative, positive};
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::{print, to_json};
use crate::cli::overwrite::Overwrite;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    recordings: Recordings,
    /// Library to evaluate
    #[arg(long, value_name = "LIB", required_unless_present = "leave_one_out")]
    library: Option<PathBuf>,
    /// Remove each inner node instead, predict it from its neighbours in every domain, and evaluate the prediction
    #[arg(long, conflicts_with_all = ["library", "report"])]
    leave_one_out: bool,
    /// Other takes of the same trials, as a folder or a list, which judge the library instead
    #[arg(long, value_name = "DIR", conflicts_with = "leave_one_out")]
    takes: Option<PathBuf>,
    /// With --takes: a line per trial, with its file, instead of one per texture
    #[arg(long, requires = "takes")]
    each: bool,
    /// With --leave-one-out: order of the models, 0 to 400, or 'auto'
    #[arg(long, requires = "leave_one_out", default_value = "400")]
    order: Order,
    /// With --leave-one-out: neighbours to predict from
    #[arg(long, value_enum, requires = "leave_one_out", default_value = "both")]
    neighbours: Around,
    /// Folder for a report with figures
    #[arg(long, value_name = "OUT_DIR")]
    report: Option<PathBuf>,
    /// JSON file for the numbers of all trials
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Reduction from three axes to one; the same as for the fit
    #[arg(long, value_enum, default_value = "pca")]
    reduce: Reduction,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, in hertz
    #[arg(long, value_name = "HZ", value_parser = not_negative, default_value_t = DEFAULT_SMOOTHING_WIDTH_HZ)]
    smoothing: f64,
    /// Least duration of each synthesis, in seconds [default: 10; 5 with --leave-one-out]
    #[arg(long, value_name = "S", value_parser = positive)]
    synthesis: Option<f64>,
    /// Parts of each texture that are played: all as fitted, none (Gaussian noise), or the residual and its level
    /// without lines that are locked to place
    #[arg(
        long,
        value_enum,
        default_value = "fitted",
        conflicts_with = "leave_one_out"
    )]
    excitation: Played,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let inputs = (arguments.recordings.inputs().iter()).chain(&arguments.library);
    let inputs: Vec<PathBuf> = inputs.chain(&arguments.takes).cloned().collect();
    if let Some(json) = &arguments.json {
        arguments.overwrite.file(json, &inputs)?;
    }
    if let Some(report) = &arguments.report {
        arguments.overwrite.folder(report, &inputs)?;
    }
    let set = arguments.recordings.open()?;
    let Some(path) = &arguments.library else {
        let default = leave_one_out::Options::default();
        let options = leave_one_out::Options {
            reduction: arguments.reduce,
            order: arguments.order,
            around: arguments.neighbours,
            smoothing_hz: arguments.smoothing,
            synthesis_s: arguments.synthesis.unwrap_or(default.synthesis_s),
            seed: arguments.seed,
        };
        let json = arguments.json.as_deref();
        return removed_nodes::run(&set, &options, json);
    };
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let default = evaluate::Options::default();
    let options = evaluate::Options {
        reduction: arguments.reduce,
        smoothing_hz: arguments.smoothing,
        synthesis_s: arguments.synthesis.unwrap_or(default.synthesis_s),
        seed: arguments.seed,
        in_sample: true,
        played: arguments.excitation,
        excerpt_s: (arguments.report.as_ref()).and_then(|_| node_seconds(set.trials.len())),
    };
    let record = FitRecord::beside(path, &bytes)?;
    let set = takes::as_fitted(record.as_ref(), set)?;
    let takes = arguments.takes.as_deref();
    let chosen = takes::choose(&set, takes, record.as_ref(), arguments.reduce)?;
    let evaluation = evaluate_set(&set, &library, chosen.judges, record.as_ref(), &options)?;
    if let Some(json) = &arguments.json {
        atomic_file::write(json, to_json(&evaluation).as_bytes())?;
    }
    print(&summary(&evaluation))?;
    if let Some(table) = summary::takes(&evaluation, arguments.each) {
        print(&format!("\n{table}"))?;
    }
    if let Some(report) = &arguments.report {
        let page = OutputFolder::begin(report, arguments.overwrite.is_asked())?.fill(|folder| {
            let page = report::write(&set, &library, &evaluation, &options, folder.path())?;
            Ok(folder.named(&page))
        })?;
        print(&format!("\nreport: {}", page.display()))?;
    }
    Ok(())
}

/// Evaluates `library` by `judges` with a progress bar.
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
