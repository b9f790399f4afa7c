//! `host-tools/costs/costs.json` against new counts.

use std::sync::LazyLock;

use host_tools::evaluation::frontier::FilterStructure;
use host_tools::evaluation::frontier::costs::Costs as LookUps;
use qemu_tests::costs::parse;
use stylus_costs::{Core, Costs, Peer, Structure};
use tasks::costs::{self, Guest};
use tasks::guest::Processor;
use tasks::toolchain::Toolchain;

/// The orders that are counted again. One is enough, because the code takes the same path for every order.
const ORDERS: [usize; 1] = [50];

/// Orders between those of the table, with stages beyond whole turns of a lattice's loop.
const ORDERS_BETWEEN: [usize; 4] = [21, 23, 41, 121];

/// The most cycles by which a sample may exceed the look-up of `fit --budget-cycles`: those of three stages that a
/// lattice does not process four at a time.
const BETWEEN_CYCLES: f64 = 30.0;

/// The allowed difference of a figure, as a share of itself.
const TOLERANCE: f64 = 0.01;

static COSTS: LazyLock<Costs> = LazyLock::new(|| {
    let text = std::fs::read_to_string(costs::path()).unwrap();
    parse(&text).unwrap_or_else(|error| panic!("{error}"))
});

#[test]
fn every_structure_has_its_costs_on_every_core_and_they_rise_with_the_order() {
    let orders = kernel_vectors::COUNTED_ORDERS.map(|order| order as u32);
    for structure in Structure::ALL {
        for (nodes, core) in [(1, Core::M4), (4, Core::M4), (1, Core::M7), (4, Core::M7)] {
            let entries = orders.map(|order| {
                let entry = COSTS.entry(structure, nodes, core, order);
                entry.unwrap_or_else(|| panic!("{structure:?}, {nodes}, {core:?}, {order}"))
            });
            for pair in entries.windows(2) {
                let (low, high) = (pair[0].sample, pair[1].sample);
                assert!(low.instructions <= high.instructions, "{pair:?}");
                assert!(low.worst_cycles <= high.worst_cycles, "{pair:?}");
            }
            for entry in entries {
                // Only IT takes less than a cycle, and there are few of them.
                assert!(
                    entry.sample.best_cycles >= entry.sample.instructions,
                    "{entry:?}"
                );
                assert!(
                    entry.sample.worst_cycles > entry.sample.best_cycles,
                    "{entry:?}"
                );
                assert!(entry.update.instructions_most >= entry.update.instructions_least);
            }
        }
    }
}

#[test]
fn what_is_counted_now_is_what_the_table_says() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error}"));
    let compiler = costs::compiler(&toolchain).unwrap();
    let is_same = compiler == COSTS.rustc;
    if !is_same {
        println!(
            "this is rustc {compiler}, and the table was counted with {}: no comparison",
            COSTS.rustc
        );
    }
    for processor in Processor::ALL {
        let guest = Guest::build(&toolchain, processor).unwrap_or_else(|error| panic!("{error}"));
        for structure in Structure::ALL {
            let counted = guest
                .count(structure, &ORDERS)
                .unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(counted.len(), 2);
            for now in counted {
                let entry = COSTS.entry(structure, now.nodes, now.core, now.order);
                let entry = entry.expect("the table has all orders that are counted");
                let difference = entry.difference(&now);
                assert!(
                    !is_same || difference <= TOLERANCE,
                    "{:.1} % off: the table has\n{entry:?}, and now it is\n{now:?}; write it again with \
                     `cargo tasks costs`",
                    100.0 * difference
                );
            }
        }
    }
}

/// The filter of this name among those that are counted alone, of all `peers`.
fn alone<'a>(peers: &'a [Peer], name: &str) -> &'a Peer {
    let found = peers.iter().find(|peer| peer.name == name);
    found.unwrap_or_else(|| panic!("{name}"))
}

#[test]
fn the_filters_alone_take_what_was_promised_of_a_cortex_m4() {
    /// Of the 13 cycles that the products, sums, loaded words and the stored one of a stage take at least, and of a
    /// share of loops and calls.
    const STAGE_CYCLES: u32 = 14;
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error}"));
    let guest = Guest::build(&toolchain, Processor::CortexM4);
    let guest = guest.unwrap_or_else(|error| panic!("{error}"));
    let peers = guest
        .count_peers()
        .unwrap_or_else(|error| panic!("{error}"));
    let lattice = alone(&peers, "stylus: normalised lattice, 32 bits");
    assert!(
        lattice.best_cycles <= STAGE_CYCLES * lattice.order,
        "{lattice:?}"
    );
}

/// The model is llvm-mca's, which only the command that writes the table needs.
#[test]
fn the_table_has_a_lattices_stage_within_nine_and_a_half_modelled_cycles_of_a_cortex_m7() {
    let cycles = |order| {
        let entry = COSTS.entry(Structure::NormalisedLattice32, 4, Core::M7, order);
        let modelled = entry.and_then(|entry| entry.modelled_cycles);
        f64::from(modelled.expect("the command writes it"))
    };
    let per_stage = (cycles(400) - cycles(200)) / 200.0;
    assert!((4.0..=9.5).contains(&per_stage), "{per_stage} per stage");
}

#[test]
fn a_budget_looks_up_no_less_than_what_is_counted_but_for_a_few_cycles() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error}"));
    let compiler = costs::compiler(&toolchain).unwrap();
    if compiler != COSTS.rustc {
        println!(
            "this is rustc {compiler}, and the table was counted with {}: no comparison",
            COSTS.rustc
        );
        return;
    }
    let table = LookUps::measured();
    let processor = Processor::CortexM4;
    let guest = Guest::build(&toolchain, processor).unwrap_or_else(|error| panic!("{error}"));
    for looked_for in FilterStructure::ALL {
        let counted = guest.count(looked_for.into(), &ORDERS_BETWEEN);
        for now in counted.unwrap_or_else(|error| panic!("{error}")) {
            let (nodes, order) = (now.nodes as usize, now.order as usize);
            let cost = table.at(looked_for, nodes, Core::M4, order);
            let looked_up = cost
                .expect("the table has orders around it")
                .sample
                .worst_cycles;
            let worst = f64::from(now.sample.worst_cycles);
            assert!(
                worst <= looked_up + BETWEEN_CYCLES,
                "the look-up gives {looked_up:.0} cycles, and a sample takes {now:?}"
            );
        }
    }
}
