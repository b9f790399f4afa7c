//! Limits of the self test. Each function compares the values of one measurement with their limits, and names the
//! remedies.
//!
//! A limit's source is given with the limit. DS12110 is the part's datasheet, RM0433 its manual, ES0392 its errata. A
//! limit without a source is a choice, wide enough for a good device and narrow enough for the fault that the limit
//! detects.

mod board;
mod output;
mod run;
mod sensors;

pub use board::{chip, clocks, flash, memory, option_bytes};
pub use output::{output, rest};
pub use run::{Traffic, state, traffic};
pub use sensors::{at_rest, moved};

use model_format::link::BoardName;

/// Returns what helps if the clock of this board does not come, and the socket of its own USB.
fn words(board: BoardName) -> [&'static str; 2] {
    let board = stylus_board::named(board.as_str());
    board.map_or(["look at its oscillator", "its socket"], |board| {
        [board.clock.remedy, board.usb]
    })
}
