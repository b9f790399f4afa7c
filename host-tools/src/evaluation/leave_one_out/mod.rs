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

mod options;
mod play;
mod prepared;
mod removal;
mod results;
mod run;
mod summary;

pub use options::{Around, Options, SMOOTHING_WIDTHS_HZ};
pub use play::{Judged, Voice, synthesis};
pub use prepared::Prepared;
pub use results::{LeaveOneOut, Outcome, Removed, Row};
pub use summary::{
    PAPER_TABLE_I, PaperColumn, PaperRow, Summary, TableOneRow, paper_row, summarise, table_one,
};
