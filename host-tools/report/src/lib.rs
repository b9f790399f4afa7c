//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report draws and words the results of other wings; it judges nothing itself.

// The wings below, by the names that this crate has for them.
use stylus_fit::{fit, texture};
use stylus_signals::{playing, recording};
use {stylus_dsp as dsp, stylus_evaluation as evaluation, stylus_support as support};

pub mod evaluation_page;
pub mod family;
pub mod frontier_page;
pub mod html;
pub mod listening_page;
pub mod plot;
pub mod rub_page;
pub mod sound;
