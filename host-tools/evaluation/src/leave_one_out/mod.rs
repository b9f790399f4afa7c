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

mod prepared;
mod results;
mod run;

use stylus_fit::fit::Order;

use crate::evaluate;

pub use prepared::Prepared;
pub use results::{Judged, LeaveOneOut, Outcome, Removed, Row, Summary, summarise};

/// Options of the test.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Options that an evaluation has, too. Each synthesis takes half of the duration there, and every method has the
    /// same noise.
    pub judging: evaluate::Options,
    /// Order of the models; the paper's is 400 for all.
    pub order: Order,
}
