//! The kernel, built for two processors and run on their emulations, compared with the kernel on the host.
//!
//! If a needed program is missing, these tests fail and name the command that installs it. `cargo tasks setup` names
//! it, too.

use std::sync::LazyLock;

use kernel_vectors::job::Job;
use kernel_vectors::{COST_BUDGETS, DIGESTED, digest_library, report as keyword};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::cost::FEED;
use tasks::compare::{self, EmulatorReport};
use tasks::qemu;
use tasks::qemu::Processor;

use crate::{held, image};

/// The reports of both images, each built and run once for all tests.
static REPORTS: [LazyLock<Result<EmulatorReport, String>>; 2] = [
    LazyLock::new(|| play(Processor::CortexM4)),
    LazyLock::new(|| play(Processor::CortexM7)),
];

fn play(processor: Processor) -> Result<EmulatorReport, String> {
    compare::play(processor).map_err(|error| format!("{error:#}"))
}

fn report(processor: Processor) -> &'static EmulatorReport {
    let index = match processor {
        Processor::CortexM4 => 0,
        Processor::CortexM7 => 1,
    };
    match &*REPORTS[index] {
        Ok(report) => report,
        Err(error) => panic!("{error:#}"),
    }
}

#[test]
fn both_processors_play_the_hosts_bits() {
    let host = compare::on_host();
    for processor in Processor::ALL {
        held(compare::same_bits(processor, &report(processor).played, &host));
    }
}

/// Plays the fixture's digest, which host, board and browser must also play.
#[test]
fn both_processors_play_the_digest_with_every_arithmetic() {
    let library = digest_library();
    let job = Job::Digest { library: &library };
    for processor in Processor::ALL {
        let text = held(qemu::run(processor, &image(processor), Some(&job)));
        for arithmetic in keyword::ARITHMETICS {
            let line = format!("{} {DIGESTED:08x} {arithmetic}", keyword::DIGEST);
            assert!(
                text.lines().any(|found| found == line),
                "{}: {line} is not in\n{text}",
                processor.name()
            );
        }
    }
}

#[test]
fn the_kernel_is_within_its_budget_and_a_sample_takes_the_same_instructions_whatever_the_data() {
    for processor in Processor::ALL {
        held(compare::costs_hold(processor, report(processor)));
    }
}

/// The largest budget of an update, which the test above holds.
#[test]
fn the_page_of_costs_says_what_an_update_takes_at_most() {
    let most = COST_BUDGETS
        .iter()
        .map(|own| own.update_budget_instructions)
        .max()
        .expect("some are measured");
    let words = format!("an update takes up to {} {:03} instructions", most / 1000, most % 1000);
    let page = include_str!("../../../../host-tools/manual/COSTS.md")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    assert!(page.contains(&words), "{words}");
}

/// Compares a lattice with recorded snippets to a plain one, both of order 400 with four nodes.
#[test]
fn the_excitation_of_a_fed_voice_takes_an_update_what_the_model_says_and_a_sample_hardly_more() {
    /// Largest number of instructions by which a fed sample may exceed a plain one.
    const MOST_FED: u32 = 40;
    for processor in Processor::ALL {
        let report = report(processor);
        let most = |costs: &[compare::Cost], texture: &str| {
            costs
                .iter()
                .find(|cost| cost.texture == texture)
                .expect("it is measured")
                .most
        };
        let fed = "lattice, snippets";
        let more = most(&report.follows, fed) - most(&report.follows, "lattice");
        println!("{}: {more} more per update", processor.name());
        assert!(more <= FEED * UPDATE_INTERVAL_SAMPLES, "{more}");
        let plain = most(&report.samples, "lattice");
        assert!(most(&report.samples, fed) <= plain + MOST_FED);
    }
}

/// Two wanders of four lines take 1618 instructions per update on a Cortex-M4, 1544 on a Cortex-M7, and none per
/// sample.
#[test]
fn a_wander_costs_a_sample_nothing_and_an_update_at_most_900_instructions() {
    for processor in Processor::ALL {
        let report = report(processor);
        let more = |costs: &[compare::Cost]| {
            let textures = ["lattice, four lines", "lattice, four lines that wander"];
            let [steady, wandering] = textures.map(|texture| {
                costs
                    .iter()
                    .find(|cost| cost.texture == texture)
                    .expect("it is measured")
                    .most
            });
            wandering.abs_diff(steady)
        };
        println!("{}: {} more per update", processor.name(), more(&report.follows));
        assert!(more(&report.samples) <= 16);
        assert!(more(&report.follows) <= 2 * 900);
    }
}
