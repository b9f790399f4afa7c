//! Choices of a comparison, and the constants that every part of it shares.

use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::evaluation::stress::cases::{Case, Length, suite};

/// Orders that are the same for all nodes.
pub const ORDERS: [usize; 6] = [10, 20, 50, 100, 200, 400];

/// Intervals of updates, samples: 0.2 (every sample) to 10 ms at 5 kHz.
pub const INTERVALS: [usize; 6] = [1, 2, 5, 10, 25, 50];

/// Clocks that a sample's time is shown for, Hz.
pub const CLOCKS_HZ: [f64; 3] = [80e6, 168e6, 480e6];

/// Options of a comparison.
#[derive(Clone, Debug)]
pub struct Options {
    /// Orders that are the same for all nodes.
    pub orders: Vec<usize>,
    /// From three axes to one.
    pub reduction: Reduction,
    /// Width of C's smoothing, Hz.
    pub smoothing_hz: f64,
    /// Duration of each synthesis at rest, s.
    pub synthesis_s: f64,
    /// Of the noise.
    pub seed: u64,
    /// The hard cases that are played, at least one.
    pub cases: Vec<Case>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            orders: ORDERS.to_vec(),
            reduction: Reduction::Pca,
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 4.0,
            seed: 1,
            cases: suite(Length::Short),
        }
    }
}
