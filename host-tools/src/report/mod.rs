//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report shows figures that another wing computed; it computes none of its own.

pub mod evaluation_page;
pub mod frontier_page;
pub mod html;
pub mod plot;
pub mod whole_page;
