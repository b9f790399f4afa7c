//! The removed-node test of the paper's section IV: each inner node of a texture's grid is removed, predicted from its
//! neighbours, played by the device's kernel, and compared with what was recorded there.
//!
//! A node is *inner* if it was recorded, is not silent, and does not lie at an end of an axis of more than two values.
//! Its neighbours are the next nodes on both sides along speed and along force. An axis counts only if both neighbours
//! along it were recorded and are not silent. (At 0 N nothing touches, so the lowest force in contact has neighbours
//! along speed only.) Within an axis, neighbours are weighted by nearness, and both axes have the same weight. The
//! weights are the same for every method.
//!
//! A prediction that the device could not play (an unstable mean, or one that is too loud) counts with C = 1, the score
//! of silence.

mod play;
mod prepared;
mod results;
mod run;

use stylus_dsp::spectrum;
use stylus_fit::fit::Order;
use stylus_fit::fit::conditioning::Conditioning;

pub use play::Judged;
pub use prepared::Prepared;
pub use results::{LeaveOneOut, Outcome, PAPER_TABLE_I, PaperColumn, Removed, Row, Summary, summarise};

/// Options of the test.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Conversion of three axes to one.
    pub conditioning: Conditioning,
    /// Order of the models; the paper's is 400 for all.
    pub order: Order,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, Hz.
    pub smoothing_hz: f64,
    /// Duration of each synthesis, s.
    pub synthesis_s: f64,
    /// Seed of the syntheses; each trial has its own noise, the same for every method.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            conditioning: Conditioning::default(),
            order: Order::Fixed(model_format::limits::MAX_ORDER),
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 5.0,
            seed: 1,
        }
    }
}
