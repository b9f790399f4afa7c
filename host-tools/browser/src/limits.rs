//! Bounds of one call.

/// Blocks that one call plays at most: half a second.
pub const MOST_BLOCKS: usize = 256;

/// Samples of so many blocks at 10 kHz.
pub const MOST_SAMPLES: usize = MOST_BLOCKS * 20;
