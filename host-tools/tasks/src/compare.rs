//! The report of the image that plays the vectors, and its comparison with the host's words and with the budgets.

use std::fmt::Write;

use anyhow::{Result, anyhow, bail};
use kernel_vectors::report::{self as keyword, ARITHMETICS};
use kernel_vectors::{MEASURED, PATH_UPDATES, VECTORS, edges, library, run};
use stylus_kernel::arithmetic::Portable;

use crate::guest::{self, Processor};
use crate::qemu;
use crate::toolchain::Toolchain;

/// The fewest calls that make a count of instructions.
const MIN_CALLS: u32 = 200;

/// Words and measurements that the image gives on an emulated processor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EmulatorReport {
    /// The played textures and edges, in order.
    pub played: Vec<Played>,
    /// The costs of samples.
    pub samples: Vec<Cost>,
    /// The costs of updates of the coefficients.
    pub follows: Vec<Cost>,
}

/// A played texture, or the edges of arithmetic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Played {
    /// The multiplication of pairs of 16-bit numbers: a keyword.
    pub arithmetic: String,
    /// The texture's name; none for the edges.
    pub texture: Option<String>,
    /// The samples, in two's complement.
    pub words: Vec<u32>,
    /// The number of samples at full scale; none for the edges.
    pub full_scale: Option<u32>,
}

/// The cost of calls, in instructions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cost {
    /// The texture's name.
    pub texture: String,
    /// The cheapest call's instructions.
    pub fewest: u32,
    /// The dearest call's instructions.
    pub most: u32,
    /// The number of counted calls.
    pub calls: u32,
}

impl EmulatorReport {
    /// Reads a whole report.
    ///
    /// # Errors
    /// A line is none of a report's, or the last line is missing.
    pub fn parse(text: &str) -> Result<Self> {
        let mut report = Self::default();
        let mut lines = (1..).zip(text.lines().map(str::trim_end));
        for (number, line) in lines.by_ref() {
            if line == keyword::END {
                match lines.next() {
                    None => return Ok(report),
                    Some((number, _)) => {
                        bail!("line {number} of the image's report is after its end")
                    }
                }
            }
            let taken = report.take(line);
            taken.map_err(|problem| anyhow!("line {number} of the image's report: {problem}"))?;
        }
        bail!("the image's report ends before its last line")
    }

    fn take(&mut self, line: &str) -> std::result::Result<(), String> {
        let (first, rest) = line.split_once(' ').unwrap_or((line, ""));
        match first {
            keyword::VECTOR => {
                let (arithmetic, texture) =
                    rest.split_once(' ').ok_or("a vector without a texture")?;
                self.begin(arithmetic, Some(texture));
            }
            keyword::EDGES => self.begin(rest, None),
            keyword::WORDS => {
                let played = self.played.last_mut().ok_or("words of nothing")?;
                for word in rest.split(' ') {
                    let word = u32::from_str_radix(word, 16)
                        .map_err(|_| format!("'{word}' is no hexadecimal word"))?;
                    played.words.push(word);
                }
            }
            keyword::FULL_SCALE => {
                let played = self.played.last_mut().ok_or("a count of nothing")?;
                played.full_scale = Some(number(rest)?);
            }
            keyword::SAMPLE_COST => self.samples.push(cost(rest)?),
            keyword::FOLLOW_COST => self.follows.push(cost(rest)?),
            _ => return Err(format!("'{line}' is no line of a report")),
        }
        Ok(())
    }

    fn begin(&mut self, arithmetic: &str, texture: Option<&str>) {
        self.played.push(Played {
            arithmetic: arithmetic.to_owned(),
            texture: texture.map(str::to_owned),
            words: Vec::new(),
            full_scale: None,
        });
    }
}

fn number(text: &str) -> std::result::Result<u32, String> {
    text.parse().map_err(|_| format!("'{text}' is no number"))
}

fn cost(text: &str) -> std::result::Result<Cost, String> {
    let mut parts = text.splitn(4, ' ');
    let mut next = || {
        parts
            .next()
            .ok_or("a cost takes three numbers and a texture")
    };
    Ok(Cost {
        fewest: number(next()?)?,
        most: number(next()?)?,
        calls: number(next()?)?,
        texture: next()?.to_owned(),
    })
}

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
            let (processor, arithmetic) = (processor.name(), &expected.arithmetic);
            bail!("{processor}, {arithmetic}, {what}: {problem}");
        }
    }
    if played.len() > host.len() {
        bail!("{} played more than the host", processor.name());
    }
    Ok(())
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

/// Checks that all samples of each measured texture took the same number of instructions, and that samples and updates
/// stay within their budgets.
///
/// # Errors
/// The first texture that does not, or that was not measured often enough.
pub fn costs_hold(processor: Processor, report: &EmulatorReport) -> Result<()> {
    for measured in &MEASURED {
        let texture = measured.texture;
        for (what, costs, calls, budget) in [
            (
                "sample",
                &report.samples,
                MIN_CALLS,
                measured.budget_instructions,
            ),
            (
                "update",
                &report.follows,
                PATH_UPDATES,
                measured.update_budget_instructions,
            ),
        ] {
            let name = processor.name();
            let Some(cost) = find(costs, texture).filter(|cost| cost.calls >= calls) else {
                bail!("{name}, {texture}: the cost of a {what} was not measured often enough");
            };
            let Cost { fewest, most, .. } = cost;
            if what == "sample" && fewest != most {
                bail!(
                    "{name}, {texture}: a sample takes {fewest} to {most} instructions, by the data"
                );
            }
            if *most > budget {
                bail!(
                    "{name}, {texture}: a {what} takes {most} instructions, and its budget is {budget}"
                );
            }
        }
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
        let cost = |measured: &kernel_vectors::Measured| Cost {
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

    fn report(samples: Vec<Cost>, follows: Vec<Cost>) -> EmulatorReport {
        EmulatorReport {
            samples,
            follows,
            ..EmulatorReport::default()
        }
    }

    #[test]
    fn costs_that_vary_exceed_or_are_missing_are_refused() {
        let calls = MIN_CALLS.max(PATH_UPDATES);
        let holds = |samples: Vec<Cost>, follows: Vec<Cost>| {
            costs_hold(PROCESSOR, &report(samples, follows)).is_ok()
        };
        assert!(holds(costs(7, 7, calls), costs(6, 7, calls)));
        assert!(!holds(costs(6, 7, calls), costs(7, 7, calls)));
        assert!(!holds(costs(7, 7, MIN_CALLS - 1), costs(7, 7, calls)));
        assert!(!holds(costs(7, 7, calls), costs(7, 7, PATH_UPDATES - 1)));
        assert!(!holds(Vec::new(), costs(7, 7, calls)));
        assert!(!holds(costs(7, 7, calls), Vec::new()));
        let samples = MEASURED.iter().map(|measured| measured.budget_instructions);
        let updates = MEASURED
            .iter()
            .map(|measured| measured.update_budget_instructions);
        let [sample, update] = [samples.min(), updates.min()].map(|lowest| lowest.unwrap());
        assert!(holds(costs(sample, sample, calls), costs(0, update, calls)));
        assert!(!holds(
            costs(sample + 1, sample + 1, calls),
            costs(0, update, calls)
        ));
        assert!(!holds(
            costs(sample, sample, calls),
            costs(0, update + 1, calls)
        ));
    }

    const TEXT: &str = "vector cortex-m direct 16, one node\n\
                        words 0000002a ffffffff\n\
                        words 80000000\n\
                        full-scale 3\n\
                        edges portable\n\
                        words 00000001\n\
                        sample-cost 10 11 12 direct 16, one node\n\
                        follow-cost 20 30 40 direct 16, one node\n\
                        end\n";

    #[test]
    fn a_report_is_read_as_it_was_printed() {
        let report = EmulatorReport::parse(TEXT).expect("the text is a report");
        let [vector, edges] = &report.played[..] else {
            panic!("two were played: {report:?}");
        };
        assert_eq!(vector.arithmetic, "cortex-m");
        assert_eq!(vector.texture.as_deref(), Some("direct 16, one node"));
        assert_eq!(vector.words, [0x2a, u32::MAX, 1 << 31]);
        assert_eq!(vector.full_scale, Some(3));
        assert_eq!((edges.texture.as_ref(), &edges.words[..]), (None, &[1][..]));
        let cost = |fewest, most, calls| Cost {
            texture: "direct 16, one node".to_owned(),
            fewest,
            most,
            calls,
        };
        assert_eq!(report.samples, [cost(10, 11, 12)]);
        assert_eq!(report.follows, [cost(20, 30, 40)]);
    }

    #[test]
    fn a_report_cut_off_anywhere_is_refused() {
        let whole = TEXT.trim_end();
        for (end, _) in whole.char_indices() {
            assert!(
                EmulatorReport::parse(&whole[..end]).is_err(),
                "cut at {end}"
            );
        }
    }

    #[test]
    fn a_line_of_something_else_is_refused_with_its_number() {
        for wrong in [
            "panicked at main.rs",
            "words 00xx",
            "sample-cost 1 2 texture",
            "vector x",
            "end",
        ] {
            let text = TEXT.replacen("full-scale 3", wrong, 1);
            let error = EmulatorReport::parse(&text).expect_err(wrong).to_string();
            let line = if wrong == "end" { 5 } else { 4 };
            assert!(
                error.starts_with(&format!("line {line} ")),
                "{wrong}: {error}"
            );
        }
    }
}
