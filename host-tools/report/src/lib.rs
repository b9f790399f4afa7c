//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report draws and words the results of other wings; it judges nothing itself.

pub mod evaluation_page;
pub mod family;
pub mod frontier_page;
pub mod html;
pub mod listening_page;
pub mod plot;
pub mod rub_page;
pub mod sound;
