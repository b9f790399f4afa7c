//! Self-contained pictures and pages of results.
//!
//! Invariant: a report draws and describes results that other wings computed. It does not judge anything itself.

// The wings below this crate, by the names that this crate uses.
use stylus_fit::{fit, texture};
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_evaluation as evaluation, stylus_pages as family, stylus_support as support};

pub mod evaluation_page;
pub mod frontier_page;
pub mod html;
pub mod listening_page;
pub mod plot;
pub mod rub_page;
pub mod sound;
