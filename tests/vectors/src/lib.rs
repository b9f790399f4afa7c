//! Textures and a motion from which every processor must compute the same bits.
//!
//! Host and target play the same library, [`library`] (feature `library`, for hosts), along the same path of the hand,
//! [`motion`], and their output is compared sample by sample. The textures are made from a seed such that they reach
//! every path of the kernel: one node and grids, orders that differ from node to node, steep resonances, silent nodes,
//! full scale, fractions of θ, every law of the level, codebooks, and two voices at a time.
#![no_std]

#[cfg(feature = "library")]
extern crate alloc;

mod hard;
pub mod job;
#[cfg(feature = "library")]
mod library;
mod play;
pub mod scenes;
mod textures;

pub use hard::{HardCase, Way, edges};
pub use job::Libraries;
#[cfg(feature = "library")]
pub use library::{COUNTED_ORDERS, DIGESTED, counted_library, counted_texture, digest_library, library, specs};
pub use play::{PlayError, run};
pub use textures::{COST_BUDGETS, COUNTED_UPDATES, CostBudget, PATH_UPDATES, VECTORS, Vector, counted_motion, motion};

/// Lines of the image's report to the host on the words that it played and the costs that it measured.
///
/// ```text
/// vector portable lattice of unequal orders      then words, the samples in order, then
/// full-scale 0                                   the number of them at full scale
/// edges portable                                 then words
/// words 0000002a fffffffe ...                    two's complement, hexadecimal
/// sample-cost 5600 5600 1600 lattice             fewest and most instructions, and the number of calls
/// follow-cost 11000 30000 160 lattice
/// library-cost 4000 90000 5 30000 20000          bytes, decoding, steps, longest step, longest plan
/// digest 89abcdef cortex-m                       digest of the first words, arithmetic
/// end                                            the report is complete
/// ```
pub mod report {
    /// First word of the line before a texture's samples. The arithmetic and the name follow.
    pub const VECTOR: &str = "vector";

    /// First word of the line before the words of [`crate::edges`]. The arithmetic follows.
    pub const EDGES: &str = "edges";

    /// First word of a line of up to [`WORDS_PER_LINE`] words.
    pub const WORDS: &str = "words";

    /// Largest number of words per line.
    pub const WORDS_PER_LINE: usize = 16;

    /// First word of the line with the number of the vector's samples at full scale.
    pub const FULL_SCALE: &str = "full-scale";

    /// First word of the line with a sample's instructions: fewest, most, number of calls, name.
    pub const SAMPLE_COST: &str = "sample-cost";

    /// First word of the line with the instructions of an update of coefficients: fewest, most, number of calls, name.
    pub const FOLLOW_COST: &str = "follow-cost";

    /// First word of the line with the cost of a library: its size in bytes, the instructions of the whole decoding,
    /// the number of steps, and the most instructions of a step and of making a plan.
    pub const LIBRARY_COST: &str = "library-cost";

    /// First word of the line with the digest of a texture's first words: the digest, arithmetic.
    pub const DIGEST: &str = "digest";

    /// The last line.
    pub const END: &str = "end";

    /// The arithmetic of [`stylus_kernel::arithmetic::Portable`].
    pub const PORTABLE: &str = "portable";

    /// The arithmetic that uses the processor's own instructions.
    pub const CORTEX_M: &str = "cortex-m";

    /// Every arithmetic, in the order of a report.
    pub const ARITHMETICS: [&str; 2] = [PORTABLE, CORTEX_M];

    /// Prefix of the name of a hard case whose samples the product's synthesis computed.
    pub const SYNTHESIS: &str = "synthesis";

    /// Prefix of the name of a hard case whose samples its filter computed.
    pub const FILTER: &str = "filter";
}
