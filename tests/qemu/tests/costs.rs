//! `tests/qemu/costs.json` against what is counted now.

use std::sync::LazyLock;

use qemu_tests::costs::{Core, Costs, Structure};
use tasks::costs::{self, Guest};
use tasks::guest::Processor;
use tasks::toolchain::Toolchain;

/// The orders that are counted anew: the code has no other way for another.
const ORDERS: [usize; 1] = [50];

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
