//! Choices of the removed-node test.

use serde::Serialize;

use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::fit::Order;

/// Widths of the kernel that smooths amplitudes for C, Hz, over which its dependence is shown.
pub const SMOOTHING_WIDTHS_HZ: [f64; 7] = [0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0];

/// The neighbours that a removed node is predicted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Around {
    /// Neighbours along speed and along force.
    #[default]
    Both,
    /// Neighbours along speed only, as if nothing had been recorded at that speed.
    Speed,
    /// Neighbours along force only.
    Force,
}

/// Options of the test.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// From three axes to one.
    pub reduction: Reduction,
    /// Order of the models; the paper's is 400 for all.
    pub order: Order,
    /// Neighbours that predict.
    pub around: Around,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, Hz.
    pub smoothing_hz: f64,
    /// Shortest duration of a synthesis, s.
    pub synthesis_s: f64,
    /// Seed of the syntheses; each trial has its own noise, the same for every method.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            reduction: Reduction::Pca,
            order: Order::Fixed(model_format::limits::MAX_ORDER),
            around: Around::Both,
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 5.0,
            seed: 1,
        }
    }
}
