//! The table of costs, `tests/qemu/costs.json`: written by `cargo tasks costs`, read by the tests and by the host command.

use serde::{Deserialize, Serialize};

use crate::error::Result;

/// How an all-pole filter is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Structure {
    /// The product's normalised lattice.
    #[serde(rename = "normalised_lattice_32")]
    NormalisedLattice32,
    /// The same in 16 bits; not shipped.
    #[serde(rename = "normalised_lattice_16")]
    NormalisedLattice16,
    /// Two multiplications a stage, in 32 bits; not shipped.
    #[serde(rename = "two_multiplier_lattice_32")]
    TwoMultiplierLattice32,
    /// The product's direct form in 32 bits.
    #[serde(rename = "direct_form_32")]
    DirectForm32,
    /// The product's direct form in 16 bits.
    #[serde(rename = "direct_form_16")]
    DirectForm16,
}

impl Structure {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::NormalisedLattice32,
        Self::NormalisedLattice16,
        Self::TwoMultiplierLattice32,
        Self::DirectForm32,
        Self::DirectForm16,
    ];

    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NormalisedLattice32 => "normalised lattice, 32 bits",
            Self::NormalisedLattice16 => "normalised lattice, 16 bits",
            Self::TwoMultiplierLattice32 => "two-multiplier lattice, 32 bits",
            Self::DirectForm32 => "direct form, 32 bits",
            Self::DirectForm16 => "direct form, 16 bits",
        }
    }
}

/// The processor that the code was built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Core {
    /// Cortex-M4.
    M4,
    /// Cortex-M7.
    M7,
}

/// What a sample takes: the same for every input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleCost {
    /// Instructions executed.
    pub instructions: u32,
    /// Cycles of a Cortex-M4, modelled, at best.
    pub best_cycles: u32,
    /// At worst; this bounds a Cortex-M7 too.
    pub worst_cycles: u32,
}

/// What an update of coefficients takes: it depends on where the motion goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UpdateCost {
    /// Instructions of the cheapest update.
    pub instructions_least: u32,
    /// Instructions of the dearest.
    pub instructions_most: u32,
    /// Cycles of a Cortex-M4, modelled, of the cheapest at best.
    pub best_cycles: u32,
    /// Of the dearest at worst.
    pub worst_cycles: u32,
}

/// What one structure costs at one order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// The structure.
    pub structure: Structure,
    /// Nodes of the grid: one, or the four around a motion.
    pub nodes: u32,
    /// The processor that it was built for.
    pub core: Core,
    /// Stages or taps.
    pub order: u32,
    /// Of a sample.
    pub sample: SampleCost,
    /// Of an update.
    pub update: UpdateCost,
}

/// Where a peer's figures are from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Counted in the same run as the entries.
    Measured,
    /// Counted before, by the same rules, from a library that is not part of this repository.
    Reference,
}

/// A filter of 400 taps or stages on a Cortex-M4, one sample a call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Whose, and what.
    pub name: String,
    /// Where the figures are from.
    pub origin: Origin,
    /// What the call does beside the filter.
    pub includes: String,
    /// Stages or taps.
    pub order: u32,
    /// Instructions executed.
    pub instructions: u32,
    /// Cycles of a Cortex-M4, modelled, at best.
    pub best_cycles: u32,
    /// At worst.
    pub worst_cycles: u32,
}

/// The table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// The compiler's version.
    pub rustc: String,
    /// The emulator's.
    pub qemu: String,
    /// One for each structure, number of nodes, core and order.
    pub entries: Vec<Entry>,
    /// Ours at order 400, and others'.
    pub peers: Vec<Peer>,
}

impl Costs {
    /// Reads the file.
    ///
    /// # Errors
    /// A text of something else.
    pub fn parse(text: &str) -> Result<Self> {
        Ok(serde_json::from_str(text)?)
    }

    /// The text of the file: a line for each entry and peer, so that a difference shows what changed.
    ///
    /// # Panics
    /// Never: all of it is numbers and text.
    pub fn to_text(&self) -> String {
        fn lines<T: Serialize>(values: &[T]) -> String {
            let line = |value| format!("    {}", json(value));
            values.iter().map(line).collect::<Vec<_>>().join(",\n")
        }
        format!(
            "{{\n  \"rustc\": {},\n  \"qemu\": {},\n  \"entries\": [\n{}\n  ],\n  \"peers\": [\n{}\n  ]\n}}\n",
            json(&self.rustc),
            json(&self.qemu),
            lines(&self.entries),
            lines(&self.peers),
        )
    }

    /// What `structure` costs at `order`, if it was counted.
    pub fn entry(
        &self,
        structure: Structure,
        nodes: u32,
        core: Core,
        order: u32,
    ) -> Option<&Entry> {
        self.entries.iter().find(|entry| {
            (entry.structure, entry.nodes, entry.core, entry.order)
                == (structure, nodes, core, order)
        })
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("numbers and text have a form in JSON")
}

impl Entry {
    /// The largest difference of `other` from this, as a share of this, over all figures.
    pub fn difference(&self, other: &Self) -> f64 {
        let figures = |entry: &Self| {
            [
                entry.sample.instructions,
                entry.sample.best_cycles,
                entry.sample.worst_cycles,
                entry.update.instructions_least,
                entry.update.instructions_most,
                entry.update.best_cycles,
                entry.update.worst_cycles,
            ]
        };
        let pairs = figures(self).into_iter().zip(figures(other));
        pairs
            .map(|(this, other)| {
                (f64::from(other) - f64::from(this)).abs() / f64::from(this.max(1))
            })
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs() -> Costs {
        let sample = SampleCost {
            instructions: 1000,
            best_cycles: 1100,
            worst_cycles: 1500,
        };
        let update = UpdateCost {
            instructions_least: 10,
            instructions_most: 20,
            best_cycles: 12,
            worst_cycles: 40,
        };
        let entry = |order| Entry {
            structure: Structure::TwoMultiplierLattice32,
            nodes: 4,
            core: Core::M7,
            order,
            sample,
            update,
        };
        let peer = Peer {
            name: "a \"peer\"".to_owned(),
            origin: Origin::Reference,
            includes: "nothing".to_owned(),
            order: 400,
            instructions: 1,
            best_cycles: 2,
            worst_cycles: 3,
        };
        Costs {
            rustc: "1.95.0".to_owned(),
            qemu: "7.2".to_owned(),
            entries: vec![entry(10), entry(400)],
            peers: vec![peer],
        }
    }

    #[test]
    fn a_table_is_read_as_it_was_written_one_entry_a_line() {
        let text = costs().to_text();
        assert_eq!(Costs::parse(&text).unwrap(), costs());
        let line = text.lines().nth(4).unwrap();
        assert!(
            line.contains(
                r#""structure":"two_multiplier_lattice_32","nodes":4,"core":"m7","order":10,"#
            ),
            "{line}"
        );
        assert!(
            Costs::parse(&text[1..])
                .unwrap_err()
                .to_string()
                .contains("cargo tasks costs")
        );
    }

    #[test]
    fn an_entry_is_found_by_all_that_it_is_of() {
        let costs = costs();
        let entry =
            |nodes, order| costs.entry(Structure::TwoMultiplierLattice32, nodes, Core::M7, order);
        assert_eq!(entry(4, 400), Some(&costs.entries[1]));
        assert_eq!((entry(1, 400), entry(4, 401)), (None, None));
    }

    #[test]
    fn a_difference_is_that_of_the_figure_that_differs_most() {
        let [first, mut second] = [costs().entries[0]; 2];
        assert_eq!(first.difference(&second), 0.0);
        second.sample.instructions = 1010;
        assert!((first.difference(&second) - 0.01).abs() < 1e-12);
        second.update.worst_cycles = 20;
        assert!((first.difference(&second) - 0.5).abs() < 1e-12);
    }
}
