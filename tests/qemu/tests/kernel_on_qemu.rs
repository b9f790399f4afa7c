//! The kernel, built for two processors and run on their emulations, against the kernel on the host.
//!
//! If a needed program is missing, these tests fail and name the command that installs it. `cargo tasks setup` does
//! too.

use std::sync::LazyLock;

use model_format::limits::MAX_ORDER;
use stylus_costs::Structure;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::cost::FEED;
use tasks::compare::{self, EmulatorReport, Played};
use tasks::costs::{self, Guest};
use tasks::guest::Processor;
use tasks::tables;
use tasks::toolchain::Toolchain;

static HOST: LazyLock<Vec<Played>> = LazyLock::new(compare::on_host);

/// The reports of both images, each built and run once for all tests.
static REPORTS: [LazyLock<Result<EmulatorReport, String>>; 2] = [
    LazyLock::new(|| play(Processor::CortexM4)),
    LazyLock::new(|| play(Processor::CortexM7)),
];

fn play(processor: Processor) -> Result<EmulatorReport, String> {
    let report = compare::play(processor).map_err(|error| format!("{error:#}"))?;
    print!("{}", compare::table(processor, &report));
    Ok(report)
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

/// Panics with the message of a check that failed.
#[track_caller]
fn holds(checked: anyhow::Result<()>) {
    if let Err(error) = checked {
        panic!("{error:#}");
    }
}

fn plays_the_hosts_bits(processor: Processor) {
    holds(compare::same_bits(
        processor,
        &report(processor).played,
        &HOST,
    ));
}

#[test]
fn m4_plays_the_hosts_bits() {
    plays_the_hosts_bits(Processor::CortexM4);
}

#[test]
fn m7_plays_the_hosts_bits() {
    plays_the_hosts_bits(Processor::CortexM7);
}

/// The figures are those of the compiler that the page names; another one's are not compared.
#[test]
fn the_page_has_the_figures_of_this_run() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error:#}"));
    let compiler = costs::compiler(&toolchain).unwrap_or_else(|error| panic!("{error:#}"));
    let [m4, m7] = [Processor::CortexM4, Processor::CortexM7].map(report);
    let made = tables::emulated(m4, m7, &compiler);
    match tables::check_made(tables::EMULATED, &made, &compiler) {
        Ok(true) => (),
        Ok(false) => println!("rustc {compiler} is not the page's: no comparison"),
        Err(error) => panic!("{error:#}"),
    }
}

#[test]
fn the_kernel_is_within_its_budget_and_a_sample_takes_the_same_instructions_whatever_the_data() {
    for processor in Processor::ALL {
        holds(compare::costs_hold(processor, report(processor)));
    }
}

/// A lattice's update with codebooks and a level track, beside one without, both of order 400 at four nodes.
#[test]
fn the_excitation_of_a_fed_voice_takes_an_update_what_the_model_says_and_a_sample_hardly_more() {
    /// Most instructions by which a fed sample may exceed a plain one.
    const MOST_FED: u32 = 40;
    for processor in Processor::ALL {
        let report = report(processor);
        let most = |costs: &[compare::Cost], texture: &str| {
            let found = costs.iter().find(|cost| cost.texture == texture);
            found.expect("it is measured").most
        };
        for fed in ["lattice, track", "lattice, codebooks and track"] {
            let more = most(&report.follows, fed) - most(&report.follows, "lattice");
            println!("{}, {fed}: {more} more per update", processor.name());
            assert!(more <= FEED * UPDATE_INTERVAL_SAMPLES, "{fed}: {more}");
            let plain = most(&report.samples, "lattice");
            assert!(most(&report.samples, fed) <= plain + MOST_FED, "{fed}");
        }
    }
}

/// Four lines that are locked to place, on a lattice of the same order: 208 on a Cortex-M4, 187 on a Cortex-M7.
#[test]
fn four_lines_take_at_most_210_instructions_more_than_none() {
    for processor in Processor::ALL {
        let samples = &report(processor).samples;
        let [none, four] = ["lattice", "lattice, four lines"].map(|texture| {
            let cost = samples.iter().find(|cost| cost.texture == texture);
            cost.expect("it is measured").most
        });
        assert!((none + 1..=none + 210).contains(&four), "{none}, {four}");
    }
}

/// Two counts agree: the image's by its timer, in virtual time, and the trace's, by instruction. They differ by the
/// call and return of the traced function.
#[test]
fn the_timer_and_the_trace_count_the_same_but_for_a_call() {
    /// Instructions of a call, a return, and saving and restoring registers around another.
    const CALL: u32 = 16;
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error:#}"));
    for processor in Processor::ALL {
        let guest = Guest::build(&toolchain, processor).unwrap_or_else(|error| panic!("{error:#}"));
        let traced = guest.count(Structure::NormalisedLattice32, &[MAX_ORDER]);
        let traced = traced.unwrap_or_else(|error| panic!("{error:#}"));
        for traced in traced {
            let samples = &report(processor).samples;
            let timed = samples.iter().find(|cost| cost.texture == "lattice");
            let timed = timed.expect("it is measured").most;
            let traced = traced.entry.sample.instructions;
            assert!(
                traced.abs_diff(timed) <= CALL,
                "{traced}, and by the timer {timed}"
            );
        }
    }
}
