//! The report of the image that plays the vectors, and its comparison with the host's words and with the budgets of
//! instructions.

use anyhow::{Context, Result, bail, ensure};
use kernel_vectors::report::{self as keyword, ARITHMETICS};
use kernel_vectors::{COST_BUDGETS, PATH_UPDATES, VECTORS, edges, library, run};
use stylus_kernel::arithmetic::Portable;

use crate::qemu::{self, Processor};
use crate::toolchain::Toolchain;

/// Smallest number of a texture's samples for a valid count of their instructions.
const MIN_CALLS: u32 = 200;

/// Words and measurements that the image prints on an emulated processor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EmulatorReport {
    /// The lines on played words, in order.
    pub played: Vec<String>,
    /// The costs of samples.
    pub samples: Vec<Cost>,
    /// The costs of updates of the coefficients.
    pub follows: Vec<Cost>,
}

/// The cost of calls, in instructions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cost {
    /// The texture's name.
    pub texture: String,
    /// Instructions of the cheapest call.
    pub fewest: u32,
    /// Instructions of the most expensive call.
    pub most: u32,
    /// The number of counted calls.
    pub calls: u32,
}

impl EmulatorReport {
    /// Reads a whole report. Lines that are not costs belong to the played words.
    pub fn parse(text: &str) -> Result<Self> {
        let mut report = Self::default();
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        let end = lines
            .iter()
            .position(|line| *line == keyword::END)
            .context("the image's report ends before its last line")?;
        ensure!(end + 1 == lines.len(), "the image's report goes on after its end");
        for line in &lines[..end] {
            let costs = match line.split(' ').next() {
                Some(keyword::SAMPLE_COST) => &mut report.samples,
                Some(keyword::FOLLOW_COST) => &mut report.follows,
                _ => {
                    report.played.push((*line).to_owned());
                    continue;
                }
            };
            costs.push(cost(line).with_context(|| format!("'{line}' is no cost"))?);
        }
        Ok(report)
    }
}

fn cost(line: &str) -> Option<Cost> {
    // The name of a texture has spaces, so it is the whole rest of the line.
    let mut parts = line.splitn(5, ' ').skip(1);
    let mut number = || parts.next()?.parse().ok();
    Some(Cost {
        fewest: number()?,
        most: number()?,
        calls: number()?,
        texture: parts.next()?.to_owned(),
    })
}

/// Builds the image for `processor`, runs it, and reads its report.
///
/// # Errors
/// The toolchain or QEMU is missing, the build or the image fails, or the image's output is not a report.
pub fn play(processor: Processor) -> Result<EmulatorReport> {
    let toolchain = Toolchain::find()?;
    let image = qemu::build_guest(&toolchain, processor)?;
    EmulatorReport::parse(&qemu::run(processor, &image, None)?)
}

/// Returns `words` as lines, in the form that the image prints.
pub fn lines(words: &[u32]) -> impl Iterator<Item = String> {
    words.chunks(keyword::WORDS_PER_LINE).map(|words| {
        let words: Vec<String> = words.iter().map(|word| format!("{word:08x}")).collect();
        format!("{} {}", keyword::WORDS, words.join(" "))
    })
}

/// Returns the lines on played words that the image must print, computed with the host's own kernel.
pub fn on_host() -> Vec<String> {
    let library = library();
    let mut played = Vec::new();
    // The host has only the portable arithmetic. The target's instructions must compute the same bits.
    for arithmetic in ARITHMETICS {
        for vector in &VECTORS {
            let mut words = Vec::new();
            let sink = |sample: model_format::OutputSample| words.push(sample.0.cast_unsigned());
            let full_scale = run::<Portable>(&library, vector, sink).expect("the library holds every vector");
            played.push(format!("{} {arithmetic} {}", keyword::VECTOR, vector.texture));
            played.extend(lines(&words));
            played.push(format!("{} {full_scale}", keyword::FULL_SCALE));
        }
        let mut words = Vec::new();
        edges::<Portable>(|word| words.push(word));
        played.push(format!("{} {arithmetic}", keyword::EDGES));
        played.extend(lines(&words));
    }
    played
}

/// Checks that `processor` played all of the host's words, bit for bit.
///
/// # Errors
/// The first difference, with the texture in which it occurs.
pub fn same_bits(processor: Processor, played: &[String], host: &[String]) -> Result<()> {
    let longest = played.len().max(host.len());
    let Some(first) = (0..longest).find(|&at| played.get(at) != host.get(at)) else {
        return Ok(());
    };
    let is_title = |line: &&String| !line.starts_with(keyword::WORDS);
    let title = host.iter().take(first + 1).rev().find(is_title);
    let [there, here] = [played, host].map(|lines| lines.get(first).map_or("nothing", |line| line));
    bail!(
        "{}, {}, line {}: '{there}', on the host '{here}'",
        processor.name(),
        title.map_or("", |title| title),
        first + 1
    )
}

/// Checks that all samples of each measured texture took the same number of instructions, and that samples and updates
/// stay within their budgets.
///
/// # Errors
/// The first texture that violates one of these conditions, or that was not measured often enough.
pub fn costs_hold(processor: Processor, report: &EmulatorReport) -> Result<()> {
    for measured in &COST_BUDGETS {
        let texture = measured.texture;
        for (what, costs, calls, budget) in [
            ("sample", &report.samples, MIN_CALLS, measured.budget_instructions),
            (
                "update",
                &report.follows,
                PATH_UPDATES,
                measured.update_budget_instructions,
            ),
        ] {
            let name = processor.name();
            let found = costs.iter().find(|cost| cost.texture == texture);
            let Some(cost) = found.filter(|cost| cost.calls >= calls) else {
                bail!("{name}, {texture}: the cost of a {what} was not measured often enough");
            };
            let Cost { fewest, most, .. } = cost;
            println!("{name}, {texture}: a {what} takes {fewest} to {most} instructions of {budget}");
            // The length of a tick must not depend on the data; an update may vary within its budget.
            if what == "sample" && fewest != most {
                bail!("{name}, {texture}: a sample takes {fewest} to {most} instructions, by the data");
            }
            if *most > budget {
                bail!("{name}, {texture}: a {what} takes {most} instructions, and its budget is {budget}");
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use kernel_vectors::CostBudget;

    use super::*;

    const PROCESSOR: Processor = Processor::CortexM4;

    #[test]
    fn any_flipped_bit_and_whatever_is_missing_or_too_much_is_found_and_named() {
        let host = on_host();
        assert!(same_bits(PROCESSOR, &host, &host).is_ok());
        let changed = |change: fn(&mut Vec<String>)| {
            let mut played = host.clone();
            change(&mut played);
            same_bits(PROCESSOR, &played, &host)
                .expect_err("it differs")
                .to_string()
        };
        let flipped = changed(|played| {
            let other = if played[5].ends_with('0') { "1" } else { "0" };
            let last = played[5].len() - 1;
            played[5].replace_range(last.., other);
        });
        assert!(flipped.contains("line 6"), "{flipped}");
        assert!(flipped.contains(VECTORS[0].texture), "{flipped}");
        assert!(changed(|played| drop(played.pop())).contains("'nothing'"));
        assert!(changed(|played| drop(played.remove(0))).contains("line 1"));
        assert!(changed(|played| played.push("words".to_owned())).contains("on the host 'nothing'"));
    }

    #[test]
    fn costs_that_vary_exceed_or_are_missing_are_refused() {
        let cost = |measured: &CostBudget, fewest, most| Cost {
            texture: measured.texture.to_owned(),
            fewest,
            most,
            calls: MIN_CALLS.max(PATH_UPDATES),
        };
        let sample = |own: &CostBudget| cost(own, own.budget_instructions, own.budget_instructions);
        let good = EmulatorReport {
            samples: COST_BUDGETS.iter().map(sample).collect(),
            follows: (COST_BUDGETS
                .iter()
                .map(|own| cost(own, 0, own.update_budget_instructions)))
            .collect(),
            ..EmulatorReport::default()
        };
        assert!(costs_hold(PROCESSOR, &good).is_ok());
        let faults: [fn(&mut EmulatorReport); 7] = [
            |bad| bad.samples[0].fewest -= 1,
            |bad| bad.samples[0].calls = MIN_CALLS - 1,
            |bad| bad.follows[0].calls = PATH_UPDATES - 1,
            |bad| drop(bad.samples.pop()),
            |bad| drop(bad.follows.pop()),
            |bad| bad.follows[0].most += 1,
            |bad| {
                let Cost { fewest, most, .. } = &mut bad.samples[0];
                (*fewest, *most) = (*fewest + 1, *most + 1);
            },
        ];
        for fault in faults {
            let mut bad = good.clone();
            fault(&mut bad);
            assert!(costs_hold(PROCESSOR, &bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_report_is_read_whole_or_refused() {
        const TEXT: &str = "vector cortex-m a, one node\nwords 0000002a ffffffff\n\
                            sample-cost 10 11 12 a, one node\nfollow-cost 20 30 40 a, one node\nend\n";
        let report = EmulatorReport::parse(TEXT).expect("the text is a report");
        assert_eq!(
            report.played,
            ["vector cortex-m a, one node", "words 0000002a ffffffff"]
        );
        let cost = |fewest, most, calls| Cost {
            texture: "a, one node".to_owned(),
            fewest,
            most,
            calls,
        };
        assert_eq!(report.samples, [cost(10, 11, 12)]);
        assert_eq!(report.follows, [cost(20, 30, 40)]);
        for (from, to) in [
            ("end\n", ""),
            ("end\n", "end\nwords"),
            ("10 11 12 a, one node", "10 11 a"),
        ] {
            let wrong = TEXT.replace(from, to);
            assert!(EmulatorReport::parse(&wrong).is_err(), "{wrong}");
        }
    }
}
