//! Self-contained pictures and pages of results.
//!
//! Invariant: a report draws and describes results that other wings computed. It does not judge anything itself.

pub mod evaluation_page;
pub mod frontier_page;
pub mod html;
pub mod listening_page;
pub mod plot;
pub mod rub_page;
pub mod sound;
