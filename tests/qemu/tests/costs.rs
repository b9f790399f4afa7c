//! `tests/qemu/costs.json` against what is counted now.

use std::sync::LazyLock;

use host_tools::evaluation::frontier::FilterStructure;
use host_tools::evaluation::frontier::costs as frontier;
use qemu_tests::costs::{Core, Costs, Structure};
use tasks::costs::{self, Guest};
use tasks::guest::Processor;
use tasks::toolchain::Toolchain;

/// The orders that are counted anew: the code has no other way for another.
const ORDERS: [usize; 1] = [50];

/// Orders between those of the table: just above a turn of a direct form's sum, and with stages beyond whole turns of a lattice's.
const ORDERS_BETWEEN: [usize; 4] = [21, 23, 41, 121];

/// What a sample may take more than `fit --budget-cycles` looks up, cycles: three stages that a lattice does not do four at a time.
const BETWEEN_CYCLES: f64 = 30.0;

/// What a figure may differ, as a share of itself.
const TOLERANCE: f64 = 0.01;

static COSTS: LazyLock<Costs> = LazyLock::new(|| {
    let text = std::fs::read_to_string(costs::path()).unwrap();
    Costs::parse(&text).unwrap_or_else(|error| panic!("{error}"))
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
                // No instruction takes less than a cycle but IT, and few are those.
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
            "counted by rustc {compiler}, and the table by {}: no comparison",
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
                    "{:.1} % off: the table says\n{entry:?}, and it is\n{now:?}; make it anew with `cargo tasks costs`",
                    100.0 * difference
                );
            }
        }
    }
}

#[test]
fn a_budget_looks_up_no_less_than_what_is_counted_but_for_a_few_cycles() {
    let toolchain = Toolchain::find().unwrap_or_else(|error| panic!("{error}"));
    let compiler = costs::compiler(&toolchain).unwrap();
    if compiler != COSTS.rustc {
        println!(
            "rustc {compiler}, and the table is of {}: no comparison",
            COSTS.rustc
        );
        return;
    }
    let table = frontier::Costs::measured();
    let processor = Processor::CortexM4;
    let guest = Guest::build(&toolchain, processor).unwrap_or_else(|error| panic!("{error}"));
    for structure in Structure::ALL {
        let counted = guest.count(structure, &ORDERS_BETWEEN);
        // Both sides name structures as the file does.
        let name = serde_json::to_value(structure).unwrap();
        let looked_for: FilterStructure = serde_json::from_value(name).unwrap();
        for now in counted.unwrap_or_else(|error| panic!("{error}")) {
            let (nodes, order) = (now.nodes as usize, now.order as usize);
            let cost = table.at(looked_for, nodes, frontier::Core::M4, order);
            let looked_up = cost
                .expect("the table has orders around it")
                .sample
                .worst_cycles;
            let worst = f64::from(now.sample.worst_cycles);
            assert!(
                worst <= looked_up + BETWEEN_CYCLES,
                "{looked_up:.0} cycles are looked up, and it is {now:?}"
            );
        }
    }
}
