//! The kernel, built for two processors and run on their emulations, against the kernel on the host.
//!
//! Whatever these tests need and do not find, they fail and tell how to install it; `cargo tasks setup` tells it too.

use std::sync::LazyLock;

use tasks::compare;
use tasks::guest::Processor;
use tasks::report::{Played, Report};

static HOST: LazyLock<Vec<Played>> = LazyLock::new(compare::on_host);

/// Each image is built and run once for all tests.
static REPORTS: [LazyLock<Result<Report, String>>; 2] = [
    LazyLock::new(|| play(Processor::CortexM4)),
    LazyLock::new(|| play(Processor::CortexM7)),
];

fn play(processor: Processor) -> Result<Report, String> {
    let report = compare::play(processor).map_err(|error| error.to_string())?;
    print!("{}", compare::table(processor, &report));
    Ok(report)
}

fn report(processor: Processor) -> &'static Report {
    let index = match processor {
        Processor::CortexM4 => 0,
        Processor::CortexM7 => 1,
    };
    match &*REPORTS[index] {
        Ok(report) => report,
        Err(error) => panic!("{error}"),
    }
}

/// Panics with the message of a check that failed.
#[track_caller]
fn holds(checked: tasks::error::Result<()>) {
    if let Err(error) = checked {
        panic!("{error}");
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

#[test]
fn a_sample_takes_the_same_instructions_whatever_the_data() {
    for processor in Processor::ALL {
        holds(compare::same_cost_always(
            processor,
            &report(processor).samples,
        ));
    }
}

#[test]
fn the_kernel_is_within_its_budget() {
    for processor in Processor::ALL {
        holds(compare::within_budget(
            processor,
            &report(processor).samples,
        ));
    }
}
