//! `stylus fit`

mod parts;
mod report;
mod strokes;

use clap::ArgGroup;
use std::path::{Path, PathBuf};
use stylus_fit::fit::record::{FitRecord, FoundLines};
use stylus_fit::fit::{self, Fit};
use stylus_fit::texture::summary::TextureSummary;
use stylus_signals::recording::{RecordingSet, Snap};
use stylus_support::number::counted;
use stylus_support::progress;
use stylus_support::{Error, Result};

use model_format::limits::MAX_TEXTURES;
use parts::LargeSet;
pub use report::show_verdicts;
use report::{FitReport, energy_kept, excitations, lines_found, low_rates, rigs_share, trials_used};
pub use strokes::Strokes;

use crate::cli::files::Overwrite;
use crate::cli::input::{RecordingArguments, tell_nominal_motion};
use crate::cli::inspect::texture_table;
use crate::cli::output::{note, print, print_json};
use stylus_fit::texture::library::decode_library;

#[derive(clap::Args)]
#[command(group = ArgGroup::new("of trials").args(["snap"]).conflicts_with("strokes"))]
pub struct Arguments {
    #[command(flatten)]
    recordings: RecordingArguments,
    /// Library file to write; with --each the folder of the libraries
    #[arg(long, value_name = "LIB", required_unless_present = "shard")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    options: fit::Options,
    #[command(flatten)]
    large: LargeSet,
    #[command(flatten)]
    strokes: Strokes,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// Fits `set` with a progress bar, and encodes the library.
pub fn fit_library(set: &RecordingSet, options: &fit::Options) -> Result<(Fit, Vec<u8>)> {
    let bar = progress::bar(set.trials.len() as u64, "fitting");
    let fit = fit::fit(set, options, |trials| bar.inc(trials as u64))?;
    bar.finish_and_clear();
    let bytes = fit.library()?;
    Ok((fit, bytes))
}

/// A fit of one library.
struct Fitted {
    fit: Fit,
    bytes: Vec<u8>,
    /// Hashes of the recordings' bytes, if they were computed already.
    contents: Option<Vec<u64>>,
}

/// Fits `set` at once, or from its partial results.
fn fitted(set: &RecordingSet, options: &fit::Options, large: &LargeSet) -> Result<Fitted> {
    if large.shard.is_some() {
        let problem = "--shard with --merge is for --each alone: one library is merged by one process";
        return Err(Error::Request(problem.into()));
    }
    // Counted before the fit, because encoding would refuse the library only after the whole fit.
    let textures = set.by_texture().len();
    if textures > MAX_TEXTURES {
        return Err(Error::Request(format!(
            "the set has {textures} textures, and a library holds {MAX_TEXTURES}: give --each for a library of each"
        )));
    }
    if large.parts.is_none() {
        let (fit, bytes) = fit_library(set, options)?;
        return Ok(Fitted {
            fit,
            bytes,
            contents: None,
        });
    }
    let merged = parts::merged(set, options, None, large)?;
    let (fit, bytes) = parts::fit_merged(&merged, set.trials.len())?;
    Ok(Fitted {
        fit,
        bytes,
        // The record needs these hashes, and computing them again would read every recording again.
        contents: Some(merged.contents().to_vec()),
    })
}

/// Returns the set with its speeds and forces moved to nominal ones, and prints the moves.
fn snapped(set: RecordingSet, snap: Snap) -> Result<RecordingSet> {
    let (set, moves) = set.snapped(snap)?;
    // Only who asked for moves is told that there are none.
    if moves.is_empty() && ![Snap::default(), Snap::NONE].contains(&snap) {
        note(&format!("no speed or force is moved by --snap {snap}"));
    }
    moves.iter().for_each(|moved| note(moved));
    Ok(set)
}

/// Checks the files to write: the library and its record. With --each there is nothing to check, because their folder
/// grows.
fn check_outputs(arguments: &Arguments) -> Result<()> {
    let Some(out) = arguments.out.as_ref().filter(|_| !arguments.large.each) else {
        return Ok(());
    };
    arguments.overwrite.file(out)?;
    arguments.overwrite.file(&FitRecord::path_for(out))
}

pub fn run(arguments: &Arguments) -> Result<()> {
    check_outputs(arguments)?;
    // Strokes are no set of trials: nothing is snapped, and neither parts nor shards exist.
    if let (true, Some(out)) = (arguments.strokes.strokes, &arguments.out) {
        let (files, assumed) = (arguments.recordings.inputs(), arguments.recordings.assumed());
        let (fit, bytes, record) = (arguments.strokes).fitted(files, assumed, &arguments.options)?;
        record.write_with(out, &bytes)?;
        return tell(&fit, &bytes, out, arguments.json);
    }
    let set = snapped(arguments.recordings.open()?, arguments.options.snap)?;
    let options = arguments.options.at_their_rate()?;
    if let Some(shard) = arguments.large.shard_to_map() {
        return parts::map_shard(&set, &options, shard, &arguments.large, arguments.json);
    }
    // In every other case clap requires this option.
    let Some(out) = arguments.out.as_deref() else {
        return Err(Error::Request("give --out, the library to write".into()));
    };
    if arguments.large.each {
        return parts::write_each(&set, &options, out, &arguments.large, arguments.json);
    }
    let Fitted { fit, bytes, contents } = fitted(&set, &options, &arguments.large)?;
    let record = match contents {
        Some(contents) => FitRecord::with_contents(&set, &options, &bytes, &contents),
        None => FitRecord::of(&set, &options, &bytes)?,
    };
    record.with_account_of(&fit).write_with(out, &bytes)?;
    tell_nominal_motion(&set, arguments.recordings.assumed());
    tell(&fit, &bytes, out, arguments.json)
}

/// Reports on `fit`, whose library of these `bytes` was written to `out`.
fn tell(fit: &Fit, bytes: &[u8], out: &Path, is_json: bool) -> Result<()> {
    let library = decode_library(out, bytes)?;
    let textures: Vec<TextureSummary> = library.textures().map(|t| TextureSummary::of(&t, is_json)).collect();
    if is_json {
        return print_json(&FitReport {
            library: out.display().to_string(),
            bytes: bytes.len(),
            warnings: fit.warnings(),
            textures,
            trials: &fit.trials,
            excitations: fit.excitations(),
            lines: FoundLines::of(fit),
        });
    }
    show(fit, &textures)?;
    print(&format!(
        "\n{} -> {} ({}); the axes' energy kept: {}",
        trials_used(&fit.trials),
        out.display(),
        counted(bytes.len(), "byte"),
        energy_kept(&fit.trials)
    ))
}

/// Prints `fit`: its trials, its textures, and the parts that were found.
fn show(fit: &Fit, textures: &[TextureSummary]) -> Result<()> {
    show_verdicts(fit);
    low_rates(&fit.trials).iter().for_each(|text| note(text));
    print(&texture_table(textures))?;
    print(&format!("\n{}", lines_found(fit)))?;
    if let Some(shares) = rigs_share(fit) {
        print(&format!("\n{shares}"))?;
    }
    let reports = fit.excitations();
    if !reports.is_empty() {
        print(&format!("\n{}", excitations(&reports)))?;
    }
    Ok(())
}
