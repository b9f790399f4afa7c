//! `stylus stress`

use stylus_evaluation::stress::{self, Outcome, Rest, cases};
use stylus_support::number::counted;
use stylus_support::progress;
use stylus_support::{Error, Result};

use super::output::folded_text;
use super::table::{headed, table};
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
    let bar = progress::bar(cases.len() as u64, "stressing");
    let outcomes = stress::run(&cases, || bar.inc(1))?;
    bar.finish_and_clear();
    if arguments.json {
        print_json(&outcomes)?;
    } else {
        print(&summary(&outcomes))?;
    }
    let broken = outcomes.iter().filter(|outcome| !outcome.broken().is_empty()).count();
    if broken > 0 {
        return Err(Error::Request(format!(
            "the lattice does not hold all of its guarantees in {}: see what it breaks below the table",
            counted(broken, "case")
        )));
    }
    Ok(())
}

fn summary(outcomes: &[Outcome]) -> String {
    let (header, rows) = headed(outcomes.iter().map(row));
    let held = outcomes.iter().filter(|outcome| outcome.broken().is_empty());
    let outside = outcomes.iter().filter(|outcome| !outcome.is_within_common_limits());
    let broken: Vec<String> = outcomes.iter().filter_map(broken).collect();
    let text = format!(
        "Spectrum and growth are in dB; stopped, FS/3 and glitch: samples until silence after a stop, an overdrive and \
         full scale in the whole state; breaks: the number of broken promises, which follow the \
         table.\nThe lattice holds its guarantees in {} of {} cases. In {} of them, all marked *, the SNR is below {} \
         dB or the spectrum deviates by more than {} dB: lines this narrow, of pole radius above 0.998, have limits of \
         their own, set by the radius. SNR counts the damping of such a line as noise.",
        held.count(),
        outcomes.len(),
        outside.count(),
        stress::SNR_DB,
        stress::SPECTRUM_DB,
    );
    format!(
        "{}\n\n{}{}",
        table(&header, &rows),
        broken.join("\n"),
        folded_text(&format!("\n\n{text}"))
    )
}

/// Returns the case's name, with a star if its lines are narrow.
fn name(outcome: &Outcome) -> String {
    let narrow = if outcome.is_narrow() { " *" } else { "" };
    format!("{}{narrow}", outcome.case)
}

/// Lists everything that a case breaks, in one wrapped paragraph; `None` if it breaks nothing.
fn broken(outcome: &Outcome) -> Option<String> {
    let broken = outcome.broken();
    let head = format!("{}:", name(outcome));
    (!broken.is_empty()).then(|| folded_text(&format!("{head} {}", broken.join("; "))))
}

fn row(outcome: &Outcome) -> [(&'static str, String); 11] {
    let optional =
        |value: Option<f64>, decimals: usize| value.map_or("-".to_owned(), |value| format!("{value:.decimals$}"));
    let rests = [outcome.stopped, outcome.overdriven, outcome.glitched];
    let growth = rests.iter().map(|rest| rest.growth_db).fold(0.0, f64::max);
    let breaks = match outcome.broken().len() {
        0 => "-".to_owned(),
        broken => broken.to_string(),
    };
    let [stopped, overdriven, glitched] = rests.map(rest);
    [
        ("case", name(outcome)),
        ("breaks", breaks),
        ("SNR dB", optional(outcome.snr_db, 1)),
        ("spectrum", format!("{:.3}", outcome.spectrum_db)),
        ("grows", format!("{growth:.1}")),
        ("stopped", stopped),
        ("FS/3", overdriven),
        ("glitch", glitched),
        ("level dB", optional(outcome.level_db, 4)),
        ("mean SE", format!("{:.1}", outcome.mean_standard_errors)),
        ("saturated", outcome.saturated.to_string()),
    ]
}

fn rest(rest: Rest) -> String {
    match rest.silent_after {
        Some(samples) => samples.to_string(),
        None if rest.left > 0.01 => "latched".to_owned(),
        None => "never".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::output::LINE_CHARS;

    #[test]
    fn every_line_fits_a_terminal_and_nothing_that_is_broken_is_missing() {
        let mut outcomes = Vec::new();
        for case in cases::suite(cases::Length::Long) {
            let latched = Rest {
                left: 1.0,
                growing: 9,
                growth_db: 60.0,
                ..Rest::default()
            };
            outcomes.push(Outcome {
                case: case.name.clone(),
                pole_radius: 0.99999,
                saturated: 100_000_000,
                level_db: Some(-10.1234),
                snr_db: Some(-110.1),
                mean_standard_errors: 100.1,
                spectrum_db: 10.123,
                stopped: latched,
                overdriven: latched,
                glitched: latched,
                ..Outcome::default()
            });
        }
        let said = summary(&outcomes);
        for line in said.lines() {
            assert!(line.chars().count() <= LINE_CHARS, "{line}");
        }
        // There is one table, with a line per outcome, and a paragraph per outcome.
        let in_words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let lines: Vec<String> = said.lines().map(in_words).collect();
        assert_eq!(lines.iter().filter(|line| line.starts_with("---")).count(), 1);
        for outcome in &outcomes {
            let row = format!("{} ", name(outcome));
            assert!(lines.iter().filter(|line| line.starts_with(&row)).count() >= 1, "{row}");
            let broken = outcome.broken().join("; ");
            let paragraph = format!("{}: {broken}", name(outcome));
            assert!(in_words(&said).contains(&paragraph), "{paragraph}");
        }
    }
}
