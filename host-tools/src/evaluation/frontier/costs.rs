//! Costs of a sample on a microcontroller: the table that `cargo tasks costs` measures, and look-ups in it.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use stylus_kernel::arithmetic::TURN_TAPS;

use crate::evaluation::frontier::FilterStructure;

/// A microcontroller's core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Core {
    /// Cortex-M4.
    M4,
    /// Cortex-M7, whose cycles are bounded by the Cortex-M4's worst ones.
    M7,
}

impl std::fmt::Display for Core {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::M4 => "Cortex-M4",
            Self::M7 => "Cortex-M7",
        })
    }
}

/// The cost of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleCost {
    /// Instructions, counted on QEMU; the same for all inputs.
    pub instructions: f64,
    /// Cycles of the Cortex-M4's published timings: loads pipelined, branches cheapest.
    pub best_cycles: f64,
    /// Cycles of the same: nothing pipelined, branches dearest.
    pub worst_cycles: f64,
}

/// The cost of one update of the coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct UpdateCost {
    /// Instructions of the cheapest update: of a direct form, one that stays in its cell.
    pub instructions_least: f64,
    /// Instructions of the dearest: of a direct form, one that unpacks a new cell's nodes.
    pub instructions_most: f64,
    /// Cycles of the cheapest, at best.
    pub best_cycles: f64,
    /// Cycles of the dearest, at worst.
    pub worst_cycles: f64,
}

/// A structure at one order on one core.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// The structure.
    pub structure: FilterStructure,
    /// Nodes of the grid: one, or the four around a motion.
    pub nodes: usize,
    /// The core.
    pub core: Core,
    /// Stages or taps.
    pub order: usize,
    /// Of a sample.
    pub sample: SampleCost,
    /// Of an update.
    pub update: UpdateCost,
}

/// The whole table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// The compiler that built what was counted.
    pub rustc: String,
    /// The emulator that counted.
    pub qemu: String,
    /// The entries.
    pub entries: Vec<Entry>,
    /// Other implementations beside ours.
    #[serde(default)]
    pub peers: Vec<Peer>,
}

/// Origin of a peer's figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Counted in the same run as the entries.
    Measured,
    /// Counted before, by the same rules.
    Reference,
}

/// A filter of 400 taps or stages on a Cortex-M4, one sample a call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Whose, and what.
    pub name: String,
    /// Origin of the figures.
    pub origin: Origin,
    /// Work of the call beside the filter.
    pub includes: String,
    /// Stages or taps.
    pub order: u32,
    /// Instructions executed.
    pub instructions: f64,
    /// Cycles, modelled, at best.
    pub best_cycles: f64,
    /// At worst.
    pub worst_cycles: f64,
}

/// The result of a look-up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Of a sample.
    pub sample: SampleCost,
    /// Of an update.
    pub update: UpdateCost,
}

impl Costs {
    /// The table of `tests/qemu/costs.json`, which is part of this program.
    pub fn measured() -> &'static Self {
        static COSTS: LazyLock<Costs> = LazyLock::new(|| {
            serde_json::from_str(include_str!("../../../../tests/qemu/costs.json"))
                .expect("the table that comes with the program holds; a test reads it")
        });
        &COSTS
    }

    /// Returns the cost of `structure` over `nodes` nodes at `order` on `core`: linear between the measured orders, below the
    /// lowest as much as that. `None` above the highest, or where nothing was measured.
    pub fn at(
        &self,
        structure: FilterStructure,
        nodes: usize,
        core: Core,
        order: usize,
    ) -> Option<Cost> {
        let of = |entry: &&Entry| entry.structure == structure && entry.core == core;
        let entries = self.entries.iter().filter(of);
        let mut entries: Vec<&Entry> = entries.filter(|entry| entry.nodes == nodes).collect();
        entries.sort_by_key(|entry| entry.order);
        let (lowest, highest) = (entries.first()?, entries.last()?);
        if order > highest.order {
            return None;
        }
        // A direct form sums in turns: what is between two measured orders may cost as much as the next multiple. No dearer than
        // the next measured order, whatever the turns.
        let next = entries[entries.partition_point(|entry| entry.order < order)].order;
        let order = if structure.is_direct() {
            order.next_multiple_of(TURN_TAPS).min(next)
        } else {
            order
        };
        let after = entries.partition_point(|entry| entry.order < order);
        let to = entries[after];
        let from = if after == 0 {
            lowest
        } else {
            entries[after - 1]
        };
        let fraction = if after == 0 {
            1.0
        } else {
            (order - from.order) as f64 / (to.order - from.order) as f64
        };
        let mean = |of: fn(&Entry) -> f64| of(from) + (of(to) - of(from)) * fraction;
        Some(Cost {
            sample: SampleCost {
                instructions: mean(|entry| entry.sample.instructions),
                best_cycles: mean(|entry| entry.sample.best_cycles),
                worst_cycles: mean(|entry| entry.sample.worst_cycles),
            },
            update: UpdateCost {
                instructions_least: mean(|entry| entry.update.instructions_least),
                instructions_most: mean(|entry| entry.update.instructions_most),
                best_cycles: mean(|entry| entry.update.best_cycles),
                worst_cycles: mean(|entry| entry.update.worst_cycles),
            },
        })
    }

    /// The highest order whose sample takes at most `cycles`, at worst; `Err` is what order 0 takes, if that is too much or
    /// nothing is known.
    ///
    /// # Errors
    /// The least number of cycles that would do; `None` where nothing was measured.
    pub fn highest_order(
        &self,
        structure: FilterStructure,
        nodes: usize,
        core: Core,
        cycles: f64,
    ) -> Result<usize, Option<f64>> {
        let worst = |order| {
            let cost = self.at(structure, nodes, core, order);
            cost.map(|cost| cost.sample.worst_cycles)
        };
        let fits = |order: &usize| worst(*order).is_some_and(|worst| worst <= cycles);
        let highest = (0..=model_format::limits::MAX_ORDER).rev().find(fits);
        highest.ok_or_else(|| worst(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_table_has_every_structure_at_every_order_on_both_cores() {
        for structure in FilterStructure::ALL {
            for core in [Core::M4, Core::M7] {
                for nodes in [1, 4] {
                    for order in super::super::ORDERS {
                        let cost = Costs::measured().at(structure, nodes, core, order);
                        let cost = cost.unwrap_or_else(|| {
                            panic!("{structure}, {nodes} nodes, {core}, order {order}: run `cargo tasks costs`")
                        });
                        let sample = cost.sample;
                        assert!(sample.instructions > 0.0);
                        assert!(sample.best_cycles >= sample.instructions * 0.9);
                        assert!(sample.worst_cycles >= sample.best_cycles);
                        assert!(cost.update.instructions_most >= cost.update.instructions_least);
                    }
                }
            }
        }
    }

    #[test]
    fn what_a_sample_costs_rises_with_the_order() {
        for structure in FilterStructure::ALL {
            let worst = |order| {
                let cost = Costs::measured().at(structure, 4, Core::M4, order).unwrap();
                cost.sample.worst_cycles
            };
            for order in 0..400 {
                assert!(worst(order) <= worst(order + 1), "{structure} at {order}");
            }
        }
    }

    proptest! {
        #[test]
        fn the_highest_order_fits_and_the_next_does_not(cycles in 0.0..20_000.0f64) {
            for structure in FilterStructure::ALL {
                let costs = Costs::measured();
                let worst = |order| costs.at(structure, 4, Core::M4, order).map(|c| c.sample.worst_cycles);
                match costs.highest_order(structure, 4, Core::M4, cycles) {
                    Ok(order) => {
                        prop_assert!(worst(order).unwrap() <= cycles);
                        prop_assert!(worst(order + 1).is_none_or(|worst| worst > cycles));
                    }
                    Err(least) => prop_assert!(least.unwrap() > cycles),
                }
            }
        }
    }
}
