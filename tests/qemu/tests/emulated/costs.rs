//! `host-tools/costs/costs.json` against new counts.

use std::sync::LazyLock;

use host_tools::evaluation::frontier::costs::Costs as LookUps;
use model_format::limits::MAX_ORDER;
use stylus_costs::{Core, Costs, Structure};
use tasks::costs::{self, Guest};
use tasks::guest::Processor;
use tasks::toolchain::Toolchain;

use crate::held;

/// The orders that are counted again. One is enough, because the code takes the same path for every order.
const ORDERS: [usize; 1] = [50];

/// Orders between those of the table, with stages beyond whole turns of a lattice's loop.
const ORDERS_BETWEEN: [usize; 4] = [21, 23, 41, 121];

/// The most instructions by which a sample may exceed the look-up between two orders: those of three stages that a
/// lattice does not process four at a time.
const BETWEEN_INSTRUCTIONS: f64 = 40.0;

/// The allowed difference of a figure, as a share of itself.
const TOLERANCE: f64 = 0.01;

static COSTS: LazyLock<Costs> = LazyLock::new(|| held(costs::read()));

fn guest(toolchain: &Toolchain, processor: Processor) -> Guest {
    held(Guest::build(toolchain, processor))
}

/// The toolchain, and whether it is the one that the table was counted with.
fn toolchain() -> (Toolchain, bool) {
    let toolchain = held(Toolchain::find());
    let compiler = costs::compiler(&toolchain).unwrap();
    let is_same = compiler == COSTS.rustc;
    if !is_same {
        let counted = &COSTS.rustc;
        println!(
            "this is rustc {compiler}, and the table was counted with {counted}: no comparison"
        );
    }
    (toolchain, is_same)
}

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
                assert!(low.cycles <= high.cycles, "{pair:?}");
            }
            for entry in entries {
                assert!(entry.update.instructions_most >= entry.update.instructions_least);
            }
        }
    }
}

#[test]
fn what_is_counted_now_is_what_the_table_says() {
    let (toolchain, is_same) = toolchain();
    for processor in Processor::ALL {
        let guest = guest(&toolchain, processor);
        for structure in Structure::ALL {
            let counted = held(guest.count(structure, &ORDERS));
            assert_eq!(counted.len(), 2);
            for now in counted.into_iter().map(|counted| counted.entry) {
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

#[test]
fn the_filters_alone_take_what_was_promised() {
    /// Instructions of a stage, with its share of loops and calls.
    const STAGE_INSTRUCTIONS: u32 = 12;
    let (toolchain, _) = toolchain();
    let peers = held(guest(&toolchain, Processor::CortexM4).count_peers());
    let order = MAX_ORDER as u32;
    for (name, most) in [
        (
            "stylus: normalised lattice, 32 bits",
            STAGE_INSTRUCTIONS * order,
        ),
        // A plain sum, as the compiler makes it.
        ("stylus: direct form, 32 bits", 4 * order),
    ] {
        let found = peers.iter().find(|(peer, _)| *peer == name);
        let (_, dearest) = found.unwrap_or_else(|| panic!("{name}"));
        let instructions = dearest.instructions();
        assert!(instructions <= most, "{name}: {instructions}");
    }
}

/// The model is llvm-mca's, which only the command that writes the table needs.
#[test]
fn the_table_has_a_lattices_stage_within_nine_and_a_half_modelled_cycles_of_a_cortex_m7() {
    let cycles = |order| {
        let entry = COSTS.entry(Structure::NormalisedLattice32, 4, Core::M7, order);
        f64::from(entry.expect("it is in the table").sample.cycles)
    };
    let per_stage = (cycles(400) - cycles(200)) / 200.0;
    assert!((4.0..=9.5).contains(&per_stage), "{per_stage} per stage");
}

#[test]
fn between_two_orders_no_less_is_looked_up_than_what_is_counted_but_for_a_few_instructions() {
    let (toolchain, is_same) = toolchain();
    if !is_same {
        return;
    }
    let guest = guest(&toolchain, Processor::CortexM4);
    for looked_for in Structure::ALL {
        for now in held(guest.count(looked_for, &ORDERS_BETWEEN)) {
            let now = now.entry;
            let (nodes, order) = (now.nodes as usize, now.order as usize);
            let cost = LookUps::measured().at(looked_for, nodes, Core::M4, order);
            let looked_up = cost.expect("the table has orders around it").sample;
            let looked_up = looked_up.instructions;
            assert!(
                f64::from(now.sample.instructions) <= looked_up + BETWEEN_INSTRUCTIONS,
                "the look-up gives {looked_up:.0} instructions, and a sample takes {now:?}"
            );
        }
    }
}
