//! Comparison of a report with the host's words and with the budgets.

use std::fmt::Write;

use kernel_vectors::report::ARITHMETICS;
use kernel_vectors::{MEASURED, Measured, PATH_UPDATES, VECTORS, edges, library, run};
use stylus_kernel::arithmetic::Portable;

use crate::error::{Error, Result};
use crate::guest::{self, Processor};
use crate::qemu;
use crate::report::{Cost, EmulatorReport, Played};
use crate::toolchain::Toolchain;

/// The fewest calls that make a count of instructions.
const MIN_CALLS: u32 = 200;

/// Builds the image for `processor`, runs it, and reads its report.
///
/// # Errors
/// The toolchain or QEMU is missing, the build or the image fails, or the image prints something else.
pub fn play(processor: Processor) -> Result<EmulatorReport> {
    let toolchain = Toolchain::find()?;
    let image = guest::build(&toolchain, processor)?;
    EmulatorReport::parse(&qemu::run(processor, &image, None)?)
}

/// The host's own words, in the order of a report.
pub fn on_host() -> Vec<Played> {
    let library = library();
    let mut played = Vec::new();
    // The host has one arithmetic, and the target's instructions must give the same bits.
    for arithmetic in ARITHMETICS {
        for vector in &VECTORS {
            let mut words = Vec::new();
            let sink = |sample: model_format::OutputSample| words.push(sample.0.cast_unsigned());
            let full_scale = run::<Portable>(&library, vector, sink);
            played.push(Played {
                arithmetic: arithmetic.to_owned(),
                texture: Some(vector.texture.to_owned()),
                words,
                full_scale: Some(full_scale.expect("the library holds every vector")),
            });
        }
        let mut words = Vec::new();
        edges::<Portable>(|word| words.push(word));
        played.push(Played {
            arithmetic: arithmetic.to_owned(),
            texture: None,
            words,
            full_scale: None,
        });
    }
    played
}

/// Checks that `processor` played the host's words, bit for bit, and all of them.
///
/// # Errors
/// The first difference.
pub fn same_bits(processor: Processor, played: &[Played], host: &[Played]) -> Result<()> {
    for (index, expected) in host.iter().enumerate() {
        if let Err(problem) = same(played.get(index), expected) {
            let what = expected.texture.as_deref().unwrap_or("edges of arithmetic");
            return Err(Error::Bits {
                processor: processor.name(),
                arithmetic: expected.arithmetic.clone(),
                what: what.to_owned(),
                problem,
            });
        }
    }
    match played.get(host.len()) {
        None => Ok(()),
        Some(more) => Err(Error::Bits {
            processor: processor.name(),
            arithmetic: more.arithmetic.clone(),
            what: more.texture.clone().unwrap_or_default(),
            problem: "played, although the host plays nothing more".to_owned(),
        }),
    }
}

fn same(played: Option<&Played>, host: &Played) -> std::result::Result<(), String> {
    let played = played.ok_or("not played")?;
    if (&played.arithmetic, &played.texture) != (&host.arithmetic, &host.texture) {
        return Err(format!("{played:.0?} was played in its place"));
    }
    let pairs = || played.words.iter().zip(&host.words);
    if let Some(first) = pairs().position(|(played, host)| played != host) {
        let count = pairs().filter(|(played, host)| played != host).count();
        let (there, here) = (played.words[first], host.words[first]);
        return Err(format!(
            "sample {first} is {there:08x}, on the host {here:08x}; {count} of {} differ",
            host.words.len()
        ));
    }
    if played.words.len() != host.words.len() {
        let (there, here) = (played.words.len(), host.words.len());
        return Err(format!("{there} samples, on the host {here}"));
    }
    if played.full_scale != host.full_scale {
        let (there, here) = (played.full_scale, host.full_scale);
        return Err(format!(
            "{there:?} samples at full scale, on the host {here:?}"
        ));
    }
    Ok(())
}

/// Checks that all samples of a measured texture took the same number of instructions.
///
/// # Errors
/// A texture has samples that differ, or was not measured often enough.
pub fn same_cost_always(processor: Processor, samples: &[Cost]) -> Result<()> {
    each_measured(processor, samples, MIN_CALLS, |_, cost| {
        if cost.fewest == cost.most {
            Ok(())
        } else {
            let Cost { fewest, most, .. } = cost;
            Err(format!(
                "a sample takes {fewest} to {most} instructions, depending on the data"
            ))
        }
    })
}

/// Checks that samples of each measured texture stay within their budget.
///
/// # Errors
/// A texture has a dearer sample, or was not measured often enough.
pub fn within_budget(processor: Processor, samples: &[Cost]) -> Result<()> {
    each_measured(processor, samples, MIN_CALLS, |measured, cost| {
        at_most("a sample", cost.most, measured.budget_instructions)
    })
}

/// Checks that no update takes more instructions than its texture's budget.
///
/// # Errors
/// A texture has a dearer update, or was not measured often enough.
pub fn updates_within_budget(processor: Processor, updates: &[Cost]) -> Result<()> {
    each_measured(processor, updates, PATH_UPDATES, |measured, cost| {
        at_most("an update", cost.most, measured.update_budget_instructions)
    })
}

fn at_most(what: &str, most: u32, budget: u32) -> std::result::Result<(), String> {
    if most <= budget {
        Ok(())
    } else {
        Err(format!(
            "{what} takes {most} instructions, and its budget is {budget}"
        ))
    }
}

/// Checks each measured texture's cost, which is of at least `calls` calls.
fn each_measured(
    processor: Processor,
    costs: &[Cost],
    calls: u32,
    check: impl Fn(&Measured, &Cost) -> std::result::Result<(), String>,
) -> Result<()> {
    for measured in &MEASURED {
        let checked = match find(costs, measured.texture) {
            None => Err("its cost was not measured".to_owned()),
            Some(cost) if cost.calls < calls => {
                Err(format!("measured over {} calls only", cost.calls))
            }
            Some(cost) => check(measured, cost),
        };
        checked.map_err(|problem| Error::Cost {
            processor: processor.name(),
            texture: measured.texture.to_owned(),
            problem,
        })?;
    }
    Ok(())
}

fn find<'a>(costs: &'a [Cost], texture: &str) -> Option<&'a Cost> {
    costs.iter().find(|cost| cost.texture == texture)
}

/// The measured costs as a table, in instructions per sample and per update.
pub fn table(processor: Processor, report: &EmulatorReport) -> String {
    let range = |costs: &[Cost], texture| match find(costs, texture) {
        Some(cost) if cost.fewest == cost.most => cost.most.to_string(),
        Some(cost) => format!("{} to {}", cost.fewest, cost.most),
        None => "-".to_owned(),
    };
    let mut text = format!(
        "{:<10} {:<28} {:>10} {:>8} {:>16} {:>8}\n",
        processor.name(),
        "instructions",
        "per sample",
        "budget",
        "per update",
        "budget"
    );
    for measured in &MEASURED {
        let _ = writeln!(
            text,
            "{:<10} {:<28} {:>10} {:>8} {:>16} {:>8}",
            "",
            measured.texture,
            range(&report.samples, measured.texture),
            measured.budget_instructions,
            range(&report.follows, measured.texture),
            measured.update_budget_instructions,
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROCESSOR: Processor = Processor::CortexM4;

    fn costs(fewest: u32, most: u32, calls: u32) -> Vec<Cost> {
        let cost = |measured: &Measured| Cost {
            texture: measured.texture.to_owned(),
            fewest,
            most,
            calls,
        };
        MEASURED.iter().map(cost).collect()
    }

    #[test]
    fn any_single_flipped_bit_is_found_and_named() {
        let host = on_host();
        assert!(same_bits(PROCESSOR, &host, &host).is_ok());
        for index in [0, 5, host.len() - 1] {
            let mut played = host.clone();
            let at = played[index].words.len() / 2;
            played[index].words[at] ^= 1;
            let error = same_bits(PROCESSOR, &played, &host).expect_err("a bit differs");
            assert!(
                error.to_string().contains(&format!("sample {at} ")),
                "{error}"
            );
            assert!(error.to_string().contains("; 1 of "), "{error}");
        }
    }

    #[test]
    fn whatever_is_missing_or_too_much_is_found() {
        let host = on_host();
        let shortened = |shorten: fn(&mut Vec<Played>)| {
            let mut played = host.clone();
            shorten(&mut played);
            same_bits(PROCESSOR, &played, &host)
        };
        assert!(shortened(|played| drop(played.pop())).is_err());
        assert!(shortened(|played| drop(played.remove(0))).is_err());
        assert!(shortened(|played| played[3].words.truncate(7)).is_err());
        assert!(shortened(|played| played[3].full_scale = None).is_err());
        assert!(shortened(|played| played.push(played[0].clone())).is_err());
    }

    #[test]
    fn costs_that_vary_exceed_or_are_missing_are_refused() {
        assert!(same_cost_always(PROCESSOR, &costs(7, 7, MIN_CALLS)).is_ok());
        assert!(same_cost_always(PROCESSOR, &costs(6, 7, MIN_CALLS)).is_err());
        assert!(same_cost_always(PROCESSOR, &costs(7, 7, MIN_CALLS - 1)).is_err());
        assert!(same_cost_always(PROCESSOR, &[]).is_err());
        let lowest = MEASURED
            .iter()
            .map(|measured| measured.budget_instructions)
            .min();
        let lowest = lowest.expect("something is measured");
        assert!(within_budget(PROCESSOR, &costs(0, lowest, MIN_CALLS)).is_ok());
        assert!(within_budget(PROCESSOR, &costs(0, lowest + 1, MIN_CALLS)).is_err());
        assert!(within_budget(PROCESSOR, &[]).is_err());
        let lowest = MEASURED
            .iter()
            .map(|measured| measured.update_budget_instructions)
            .min();
        let lowest = lowest.expect("something is measured");
        assert!(updates_within_budget(PROCESSOR, &costs(0, lowest, MIN_CALLS)).is_ok());
        assert!(updates_within_budget(PROCESSOR, &costs(0, lowest + 1, MIN_CALLS)).is_err());
        assert!(updates_within_budget(PROCESSOR, &[]).is_err());
    }
}
