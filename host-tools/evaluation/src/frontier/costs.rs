//! Costs of a sample on a microcontroller: a table that was measured, and look-ups in it.

use std::sync::LazyLock;

use serde::Serialize;
pub use stylus_costs::Core;
use stylus_costs::{Entry, SampleCost, Structure, UpdateCost};

/// The result of a look-up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Cost of a sample.
    pub sample: SampleCost<f64>,
    /// Cost of an update.
    pub update: UpdateCost<f64>,
}

/// The measured table, with look-ups between its orders.
pub struct Costs {
    table: stylus_costs::Costs,
}

impl Costs {
    /// The table of `host-tools/costs/costs.json`, which is part of this program.
    pub fn measured() -> &'static Self {
        static COSTS: LazyLock<Costs> = LazyLock::new(|| {
            let text = include_str!("../../../costs/costs.json");
            let table = serde_json::from_str(text);
            Costs {
                table: table.expect("the table that comes with the program holds; a test reads it"),
            }
        });
        &COSTS
    }

    /// The table as it was measured.
    pub fn table(&self) -> &stylus_costs::Costs {
        &self.table
    }

    /// Returns the cost of `structure` over `nodes` nodes at `order` on `core`. It is interpolated linearly between the
    /// measured orders, and equals that of the lowest order below it. Returns `None` above the highest order, or if
    /// nothing was measured.
    pub fn at(&self, structure: Structure, nodes: usize, core: Core, order: usize) -> Option<Cost> {
        let of = |entry: &&Entry| entry.structure == structure && entry.core == core && entry.nodes as usize == nodes;
        let mut entries: Vec<&Entry> = self.table.entries.iter().filter(of).collect();
        entries.sort_by_key(|entry| entry.order);
        let (lowest, highest) = (entries.first()?, entries.last()?);
        let order = u32::try_from(order).ok()?;
        if order > highest.order {
            return None;
        }
        // A filter's loop takes the same time per stage, so that a line fits; `tests/qemu` counts orders between.
        let after = entries.partition_point(|entry| entry.order < order);
        let to = entries[after];
        let from = if after == 0 { lowest } else { entries[after - 1] };
        let fraction = if after == 0 {
            1.0
        } else {
            f64::from(order - from.order) / f64::from(to.order - from.order)
        };
        let mean = |of: fn(&Entry) -> u32| {
            let [from, to] = [from, to].map(|entry| f64::from(of(entry)));
            from + (to - from) * fraction
        };
        Some(Cost {
            sample: SampleCost {
                instructions: mean(|entry| entry.sample.instructions),
                cycles: mean(|entry| entry.sample.cycles),
            },
            update: UpdateCost {
                instructions_least: mean(|entry| entry.update.instructions_least),
                instructions_most: mean(|entry| entry.update.instructions_most),
                cycles: mean(|entry| entry.update.cycles),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_every_structure_at_every_order_on_both_cores() {
        for structure in Structure::ALL {
            for core in [Core::M4, Core::M7] {
                for nodes in [1, 4] {
                    for order in super::super::ORDERS {
                        let cost = Costs::measured()
                            .at(structure, nodes, core, order)
                            .unwrap_or_else(|| panic!("{structure}, {nodes} nodes, {core}, order {order}"));
                        let sample = cost.sample;
                        assert!(sample.instructions > 0.0);
                        // A Cortex-M7 issues up to two instructions per cycle.
                        assert!(sample.cycles >= sample.instructions / 2.0);
                        assert!(cost.update.instructions_most >= cost.update.instructions_least);
                    }
                }
            }
        }
    }

    #[test]
    fn what_a_sample_costs_rises_with_the_order() {
        for structure in Structure::ALL {
            let worst = |order| {
                Costs::measured()
                    .at(structure, 4, Core::M4, order)
                    .unwrap()
                    .sample
                    .cycles
            };
            for order in 0..400 {
                assert!(worst(order) <= worst(order + 1), "{structure} at {order}");
            }
        }
    }
}
