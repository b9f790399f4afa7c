//! `stylus compare`

use std::path::{Path, PathBuf};

use stylus_evaluation::evaluate;
use stylus_evaluation::listening::{
    self, Answers, CONFIDENCE, Compared, Design, Kind, Pair, Part, Plan, Score, once, plan, score,
};
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::fit::record::FitRecord;
use stylus_report::listening_page;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::files::Overwrite;
use super::input::{RecordingArguments, positive};
use super::table::{headed, table};
use crate::cli::evaluate::{as_fitted, choose};
use crate::cli::output::{note, print};
use stylus_fit::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
#[command(
    override_usage = "stylus compare [OPTIONS] --library <LIB> --out <HTML> <INPUTS>...\n       \
                            stylus compare --score <CSV>..."
)]
pub struct Arguments {
    #[command(flatten)]
    recordings: RecordingArguments,
    /// Library to compare with the recordings
    #[arg(long, value_name = "LIB", required = true)]
    library: Option<PathBuf>,
    /// HTML file to write
    #[arg(long, value_name = "HTML", required = true)]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Other takes of the same trials, as a folder or a list, heard in place of the inputs
    #[arg(long, value_name = "DIR")]
    takes: Option<PathBuf>,
    /// Another library, such as one of an earlier version, to compare with too, on other takes
    #[arg(long, value_name = "LIB")]
    before: Option<PathBuf>,
    /// Pairs of kinds; 'fitted' is a texture with all its parts, 'gaussian' its filter with Gaussian noise, 'before'
    /// that of --before. Without it recording-fitted,recording-gaussian,gaussian-fitted, and with --before
    /// recording-fitted,recording-before,before-fitted
    #[arg(long, value_enum, value_delimiter = ',', hide_possible_values = true)]
    pairs: Vec<Pair>,
    /// Question to listeners: of which kind X is (abx); how alike two sounds are, 0 to 100 (similarity); or of which
    /// kind X is, where the difference follows the answers until it can just be told (staircase)
    #[arg(long, value_enum, default_value = "abx")]
    design: Design,
    /// Parts whose strengths the staircases of --design staircase find
    #[arg(long, value_enum, value_delimiter = ',', default_value = "level,codebook,lines")]
    parts: Vec<Part>,
    /// Trials, 1 to 200: abx: per pair [default: 12]; similarity: per pair, and per kind with itself [default: 6];
    /// staircase: at most, per part [default: 80]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=200))]
    trials: Option<u16>,
    /// Duration of a sound, in seconds, at most 10; less where recordings do not hold two of it
    #[arg(long, value_name = "S", value_parser = excerpt, default_value_t = 1.5)]
    segment: f64,
    #[command(flatten)]
    conditioning: Conditioning,
    /// Seed of order, places and X: the same seed gives the same page
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Score saved answers instead, those of all files together
    #[arg(long, value_name = "CSV", num_args = 1.., exclusive = true)]
    score: Vec<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    if !arguments.score.is_empty() {
        return print(&scores(&score(&Answers::read_all(&arguments.score)?)?));
    }
    check(arguments)?;
    let out = arguments.out.as_deref();
    // clap requires both unless --score is given, which was answered above.
    let (Some(path), Some(out)) = (&arguments.library, out) else {
        return Err(Error::Request(
            "a page needs --library and --out, and scores need --score".into(),
        ));
    };
    arguments.overwrite.file(out)?;
    let set = arguments.recordings.open()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let record = FitRecord::beside(path, &bytes)?;
    // Takes and nodes are found by speed and force, so the set first gets those of the fit.
    let set = as_fitted(record.as_ref(), set)?;
    let takes = (arguments.recordings).open_takes(arguments.takes.as_ref())?;
    let chosen = choose(&set, takes, record.as_ref(), arguments.conditioning)?;
    let evaluate = evaluate::Options {
        conditioning: arguments.conditioning,
        seed: arguments.seed,
        ..evaluate::Options::default()
    };
    // The library borrows from its bytes, so these live in a value of their own.
    let before = match &arguments.before {
        Some(path) => Some((path, read_library(path)?)),
        None => None,
    };
    let before = match &before {
        Some((path, bytes)) => Some((decode_library(path, bytes)?, FitRecord::beside(path, bytes)?)),
        None => None,
    };
    let options = listening::Options {
        design: arguments.design,
        pairs: Pair::asked(&arguments.pairs, before.is_some()),
        parts: once(&arguments.parts),
        trials: (arguments.trials).map_or(arguments.design.usual_trials(), usize::from),
        excerpt_s: arguments.segment,
        seed: arguments.seed,
    };
    let of = |library, record| Compared { library, record };
    let before = before.as_ref().map(|(library, record)| of(library, record.as_ref()));
    let fitted = of(&library, record.as_ref());
    let plan = plan(&set, &chosen.judges, fitted, before, &evaluate, &options)?;
    for text in plan.notes(arguments.segment, arguments.takes.is_some()) {
        note(&text);
    }
    let size = listening_page::write(&plan, out)?;
    print(&summary(&plan, arguments.design, out, size))
}

/// Returns an error if options exclude each other: pairs or a library of before with a staircase, `--before` without
/// `--takes`, or pairs that need a library of before that is not given.
fn check(arguments: &Arguments) -> Result<()> {
    if arguments.design == Design::Staircase && (!arguments.pairs.is_empty() || arguments.before.is_some()) {
        return Err(Error::Request(
            "a staircase varies parts of one library: give --parts in place of --pairs and --before".into(),
        ));
    }
    if arguments.before.is_some() && arguments.takes.is_none() {
        return Err(Error::Request(
            "--before needs --takes DIR, other recordings of the same trials: both libraries are judged on what \
             neither was fitted to"
                .into(),
        ));
    }
    let of_before = |pair: &&Pair| pair.kinds().contains(&Kind::Before);
    if let (None, Some(pair)) = (&arguments.before, arguments.pairs.iter().find(of_before)) {
        return Err(Error::Request(format!(
            "--pairs {} needs the library of before: give --before LIB and --takes DIR",
            pair.name()
        )));
    }
    Ok(())
}

/// Describes in one line the page of `plan` at `out`, of `size` bytes.
fn summary(plan: &Plan, design: Design, out: &Path, size: usize) -> String {
    let origin = if plan.simulated {
        ", of SIMULATED recordings"
    } else {
        ""
    };
    format!(
        "{}: {}{}, {}, {:.1} MB{origin}",
        out.display(),
        if design == Design::Staircase { "up to " } else { "" },
        counted(plan.task.trials(), "trial"),
        counted(plan.sounds.len(), "sound"),
        size as f64 / 1e6
    )
}

/// Parses the duration of a sound, s.
fn excerpt(text: &str) -> std::result::Result<f64, String> {
    let least = listening::SHORTEST_EXCERPT_S;
    match positive(text) {
        Ok(seconds) if (least..=10.0).contains(&seconds) => Ok(seconds),
        _ => Err(format!("must be {least} to 10 seconds")),
    }
}

/// Returns a table of scores, and an explanation of its columns.
fn scores(scores: &[Score]) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let row = |score: &Score| {
        let (low, high) = score.interval;
        let told_apart = if score.is_told_apart { "yes" } else { "not shown" };
        [
            ("pair", score.pair.clone()),
            ("files", score.files.to_string()),
            ("trials", score.trials.to_string()),
            ("right", score.correct.to_string()),
            ("share", percent(score.proportion)),
            ("95 % interval", format!("{} to {}", percent(low), percent(high))),
            ("told apart", told_apart.to_owned()),
        ]
    };
    let (header, rows) = headed(scores.iter().map(row));
    let origin = if scores.iter().any(|score| score.simulated) {
        "\nThe recordings are SIMULATED."
    } else {
        ""
    };
    format!(
        "{}\n\nchance: 50 %; interval: exact (Clopper and Pearson), with a confidence of {:.0} %, as if all trials \
         were independent;\ntold apart: the whole interval lies above chance{origin}",
        table(&header, &rows),
        100.0 * CONFIDENCE
    )
}
