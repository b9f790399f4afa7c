//! The schema of `host-tools/costs/costs.json`, the table of measured costs.
//!
//! The table was counted once, by a tool that commit d3f74c5d still has; `tests/qemu` compares the shipped structure
//! with new counts, and the `stylus` command embeds it. Counts are whole instructions and whole cycles. A look-up
//! between two measured orders gives fractions, so the types are generic over the type of number.

use serde::{Deserialize, Serialize};

/// The computation of an all-pole filter, with its word length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Structure {
    /// The product's normalised lattice.
    #[serde(rename = "normalised_lattice_32")]
    NormalisedLattice32,
    /// The direct form in 32 bits; not shipped.
    #[serde(rename = "direct_form_32")]
    DirectForm32,
    /// The direct form with coefficients of 16 bits, computed in 32 bits; not shipped.
    #[serde(rename = "direct_form_16")]
    DirectForm16,
}

impl Structure {
    /// All structures, in the order of reports.
    pub const ALL: [Self; 3] = [Self::DirectForm16, Self::DirectForm32, Self::NormalisedLattice32];

    /// The name for printed tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NormalisedLattice32 => "normalised lattice, 32 bits",
            Self::DirectForm32 => "direct form, 32 bits",
            Self::DirectForm16 => "direct form, 16 bits",
        }
    }

    /// Returns whether the structure is a direct form, which sums over past outputs. The stylus plays the lattice.
    pub fn is_direct(self) -> bool {
        matches!(self, Self::DirectForm16 | Self::DirectForm32)
    }
}

impl std::fmt::Display for Structure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
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

impl std::fmt::Display for Core {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::M4 => "Cortex-M4",
            Self::M7 => "Cortex-M7",
        })
    }
}

/// The cost of a sample, which is the same for every input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleCost<N = u32> {
    /// Instructions, counted on QEMU.
    pub instructions: N,
    /// Cycles of these instructions, as llvm-mca models the core.
    pub cycles: N,
}

/// The cost of an update of the coefficients, which depends on the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UpdateCost<N = u32> {
    /// Instructions of the cheapest update.
    pub instructions_least: N,
    /// Instructions of the most expensive update.
    pub instructions_most: N,
    /// Cycles of the most expensive update, as llvm-mca models the core.
    pub cycles: N,
}

/// The cost of one structure at one order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// The structure.
    pub structure: Structure,
    /// Nodes of the grid: one, or the four around a motion.
    pub nodes: u32,
    /// The processor that the code was built for.
    pub core: Core,
    /// Stages or taps.
    pub order: u32,
    /// The cost of a sample.
    pub sample: SampleCost,
    /// The cost of an update.
    pub update: UpdateCost,
}

/// The source of a peer's figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Counted in the same run as the entries.
    Measured,
    /// Counted earlier by the same rules, in a library outside this repository.
    Reference,
}

/// A filter of 400 taps or stages, per sample; one sample per call unless the name says otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Peer {
    /// The library and the filter.
    pub name: String,
    /// The source of the figures.
    pub origin: Origin,
    /// The work of the call in addition to the filter.
    pub includes: String,
    /// Stages or taps.
    pub order: u32,
    /// Instructions on a Cortex-M4, counted on QEMU.
    pub instructions: u32,
    /// Cycles on a Cortex-M4 as llvm-mca models it; none for a reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cortex_m4_cycles: Option<u32>,
    /// Cycles on a Cortex-M7 of the code that is built for it; none for a reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cortex_m7_cycles: Option<u32>,
}

/// The whole table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Costs {
    /// The version of the compiler that built the counted code.
    pub rustc: String,
    /// The version of the emulator that counted the instructions.
    pub qemu: String,
    /// The version of LLVM whose llvm-mca modelled the cycles.
    pub llvm_mca: String,
    /// One entry for each structure, number of nodes, core and order.
    pub entries: Vec<Entry>,
    /// The product's filters at order 400, and those of other libraries.
    pub peers: Vec<Peer>,
}

impl Costs {
    /// The entry of `structure` at `order`, if it was counted.
    pub fn entry(&self, structure: Structure, nodes: u32, core: Core, order: u32) -> Option<&Entry> {
        self.entries
            .iter()
            .find(|entry| (entry.structure, entry.nodes, entry.core, entry.order) == (structure, nodes, core, order))
    }
}
