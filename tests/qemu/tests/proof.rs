//! Instructions of the proof of direct forms on an emulated Cortex-M7, and the modelled time of a full slot.
//!
//! The time is modelled: one instruction per cycle at 400 MHz, without the wait states of flash and without the time
//! that tick and update take.

use std::path::Path;

use host_tools::texture::certificate::{certify, prove_as_device};
use kernel_vectors::job::Job;
use kernel_vectors::report;
use model_format::limits::{MAX_LIBRARY_BYTES, MAX_ORDER};
use model_format::{
    CodeSpec, Laws, Library, NodeFlags, NodeSpec, PartsSpec, Provenance, SAMPLE_RATE_HZ, Structure,
    TextureSpec, encode, encode_uncertified,
};
use stylus_kernel::proof::{
    EXPANSION_INSTRUCTIONS, PART_INSTRUCTIONS, SPARE_CHECKS, checks_per_cell,
};
use tasks::guest::{self, Processor};
use tasks::qemu;
use tasks::toolchain::Toolchain;

/// Clock of the device, Hz.
const CLOCK_HZ: f64 = 400e6;

/// Costs of a proof in instructions.
#[derive(Clone, Copy, Debug)]
struct Cost {
    steps: u64,
    longest: u64,
    all: u64,
}

/// A library of one direct form of order 400, at 2 by `forces` nodes. Its certificate is that of the host.
fn library(forces: usize) -> Vec<u8> {
    let node = |number: usize| NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.5,
        flags: NodeFlags::NONE,
        codes: CodeSpec::Direct16 {
            exponent: 1,
            codes: (0..MAX_ORDER)
                .map(|tap| match tap {
                    0 => 29_000 - 300 * number as i16,
                    1 => -14_000,
                    // A comb of 400 lines, shallow enough to leave the first two taps' resonance alone.
                    399 => -600,
                    _ => ((tap * 37 + number) % 7) as i16 - 3,
                })
                .collect(),
        },
    };
    let mut spec = TextureSpec {
        name: "direct".to_owned(),
        sample_rate_hz: SAMPLE_RATE_HZ,
        structure: Structure::DirectForm16,
        provenance: Provenance::Simulated,
        laws: Laws::default(),
        parts: PartsSpec::default(),
        speed_axis_mm_s: vec![50.0, 100.0],
        force_axis_n: (1..=forces).map(|force| force as f32).collect(),
        nodes: (0..2 * forces).map(node).collect(),
        cell_margins: Vec::new(),
    };
    let bytes = encode_uncertified(std::slice::from_ref(&spec)).expect("it is a library");
    let library = Library::decode_uncertified(&bytes).expect("it was just encoded");
    let report = certify(&library.textures().next().expect("there is one"));
    assert!(report.holds);
    spec.cell_margins = report.cell_margins();
    let bytes = encode(&[spec]).expect("it is certified");
    prove_as_device(&Library::decode(&bytes).expect("it was just encoded")).expect("as a device");
    bytes
}

fn measured(image: &Path, library: &[u8]) -> Cost {
    let text = qemu::run(Processor::CortexM7, image, Some(&Job::Proof { library }));
    let text = text.unwrap_or_else(|error| panic!("{error:#}"));
    let mut lines = text.lines();
    let cost = lines.find_map(|line| line.strip_prefix(report::PROOF_COST));
    let cost = cost.unwrap_or_else(|| panic!("{text}"));
    let numbers: Vec<u64> = cost
        .split_whitespace()
        .map(|n| n.parse().unwrap())
        .collect();
    let [steps, longest, all] = numbers[..] else {
        panic!("{cost}");
    };
    Cost {
        steps,
        longest,
        all,
    }
}

#[test]
fn a_step_of_the_proof_stays_within_its_bound_and_a_full_slot_takes_the_time_that_the_page_says() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error:#}"));
    let image = guest::build(&toolchain, Processor::CortexM7);
    let image = image.unwrap_or_else(|error| panic!("{error:#}"));
    let [one, three] = [2, 4].map(|forces| measured(&image, &library(forces)));
    println!(
        "one cell: {} steps, longest {}, {} instructions",
        one.steps, one.longest, one.all
    );
    for cost in [one, three] {
        assert!(cost.longest <= EXPANSION_INSTRUCTIONS.max(PART_INSTRUCTIONS));
    }
    // Further cells of a row share two nodes with the one before.
    let cell = (three.all - one.all) / 2;
    let node_bytes = 2 * MAX_ORDER + 16;
    let nodes = MAX_LIBRARY_BYTES / node_bytes;
    let seconds = |instructions: u64| nodes as f64 * instructions as f64 / CLOCK_HZ;
    let worst_cell = u64::from(checks_per_cell(MAX_ORDER)) * PART_INSTRUCTIONS
        + 4 * 256 * EXPANSION_INSTRUCTIONS;
    let spare = u64::from(SPARE_CHECKS) * PART_INSTRUCTIONS;
    let worst = seconds(worst_cell) + spare as f64 / CLOCK_HZ;
    println!(
        "a full slot of {nodes} nodes of order {MAX_ORDER} and as many cells, modelled: {:.0} s; {:.0} s where rows \
         are of one cell; at most {:.0} s",
        seconds(cell),
        seconds(one.all),
        worst,
    );
    assert!(seconds(cell) < 100.0, "{:.0} s", seconds(cell));
    assert!(seconds(one.all) < 200.0, "{:.0} s", seconds(one.all));
    assert!(worst < 420.0, "{worst:.0} s");
}
