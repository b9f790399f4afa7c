//! The removed-node test of the paper's section IV: each inner node of a texture's grid is taken away, predicted from
//! its neighbours, played by the device's kernel, and compared with what was recorded there.
//!
//! A node is *inner* if it was recorded, sounds, and lies at no end of an axis of more than two values. Its neighbours
//! are the next nodes on both sides along speed and along force; an axis counts where both of them were recorded and
//! sound (at 0 N nothing touches, so that the lowest force in contact has neighbours along speed only). Within an axis
//! neighbours weigh by nearness, and both axes alike, for every method the same.
//!
//! A prediction that the device could not play (an unstable mean, or one too loud) counts with C = 1, which is what
//! silence scores.
//!
//! If all nodes of the removed one's speed, or of its force, are left out with it, it is predicted along that axis
//! alone, and other programs' sounds can stand beside: a benchmark.

mod play;
mod prepared;
mod results;
mod run;

use crate::dsp::spectrum;
use crate::fit::Order;
use crate::fit::conditioning::Conditioning;
use crate::fit::densify::Direction;

pub use play::{Judged, Voice, synthesis};
pub use prepared::Prepared;
pub use results::{
    Given, LeaveOneOut, Outcome, PAPER_TABLE_I, PaperColumn, Removed, Row, Summary, summarise,
};

/// Options of the test.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// From three axes to one.
    pub conditioning: Conditioning,
    /// Order of the models; the paper's is 400 for all.
    pub order: Order,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, Hz.
    pub smoothing_hz: f64,
    /// Shortest duration of a synthesis, s.
    pub synthesis_s: f64,
    /// Seed of the syntheses; each trial has its own noise, the same for every method.
    pub seed: u64,
    /// Axis at whose value all other nodes are removed together with a node; none to remove that node alone.
    pub left_out: Option<Direction>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            conditioning: Conditioning::default(),
            order: Order::Fixed(model_format::limits::MAX_ORDER),
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 5.0,
            seed: 1,
            left_out: None,
        }
    }
}
