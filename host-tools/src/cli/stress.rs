//! `stylus stress`

use host_tools::evaluation::stress;
use host_tools::evaluation::stress::{Outcome, Rest, cases};
use host_tools::support::error::{Error, Result};
use host_tools::support::progress;

use super::table::table;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Run for minutes instead of seconds, with 10⁸ samples of random motion
    #[arg(long)]
    long: bool,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let cases = cases::suite(if arguments.long {
        cases::Length::Long
    } else {
        cases::Length::Full
    });
    // Three structures per case, except where only the lattice runs.
    let runs = cases
        .iter()
        .map(|case| if case.lattice_only { 1 } else { 3 });
    let bar = progress::bar(runs.sum(), "stressing");
    let outcomes = stress::run(&cases, || bar.inc(1))?;
    bar.finish_and_clear();
    if arguments.json {
        print_json(&outcomes)?;
    } else {
        print(&summary(&outcomes))?;
    }
    let broken = outcomes
        .iter()
        .filter(|outcome| outcome.is_lattice() && !outcome.broken().is_empty())
        .count();
    if broken > 0 {
        return Err(Error::Request(format!(
            "the lattice does not hold all of its guarantees in {broken} case(s): see the last column"
        )));
    }
    Ok(())
}

fn summary(outcomes: &[Outcome]) -> String {
    let header = [
        "case",
        "structure",
        "saturated",
        "level dB",
        "SNR dB",
        "off line dBc",
        "mean SE",
        "spectrum dB",
        "grows dB",
        "silent after stop",
        "FS/3",
        "glitch",
        "broken",
    ];
    let rows: Vec<Vec<String>> = outcomes.iter().map(row).collect();
    let lattices = || outcomes.iter().filter(|outcome| outcome.is_lattice());
    let held = lattices().filter(|outcome| outcome.broken().is_empty());
    let outside = lattices().filter(|outcome| !outcome.is_within_common_limits());
    format!(
        "{}\n\nThe lattice holds its guarantees in {} of {} cases. In {} of them, all marked *, the SNR is below {} dB \
         or the spectrum deviates by more than {} dB: lines this narrow, of pole radius above 0.998, have limits of \
         their own, set by the radius. SNR counts the damping of such a line as noise; what is noise stands in the \
         column off line, and what is damping in the level.\nThe direct forms guarantee none of this; they are shown \
         for comparison.",
        table(&header, &rows),
        held.count(),
        lattices().count(),
        outside.count(),
        stress::SNR_DB,
        stress::SPECTRUM_DB,
    )
}

fn row(outcome: &Outcome) -> Vec<String> {
    let optional = |value: Option<f64>, decimals: usize| {
        value.map_or("-".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let narrow = if outcome.is_narrow() { " *" } else { "" };
    let name = format!("{}{narrow}", outcome.case);
    let mut row = vec![name, outcome.structure.clone()];
    if outcome.refused.is_some() {
        row.extend(std::iter::repeat_n("-".to_owned(), 10));
        row.push("fit refuses it".to_owned());
        return row;
    }
    let growth = [outcome.stopped, outcome.overdriven, outcome.glitched]
        .iter()
        .map(|rest| rest.growth_db)
        .fold(0.0, f64::max);
    row.extend([
        outcome.saturated.to_string(),
        optional(outcome.level_db, 4),
        optional(outcome.snr_db, 1),
        optional(outcome.off_line_dbc, 0),
        format!("{:.1}", outcome.mean_standard_errors),
        format!("{:.3}", outcome.spectrum_db),
        format!("{growth:.1}"),
        rest(outcome.stopped),
        rest(outcome.overdriven),
        rest(outcome.glitched),
        outcome.broken().join("; "),
    ]);
    row
}

fn rest(rest: Rest) -> String {
    match rest.silent_after {
        Some(samples) => samples.to_string(),
        None if rest.left > 0.01 => "latched".to_owned(),
        None => "never".to_owned(),
    }
}
