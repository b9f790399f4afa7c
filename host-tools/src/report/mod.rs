//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report shows figures that another wing computed; it computes none of its own.

pub mod evaluation_folder;
pub mod frontier_page;
pub mod html;
pub mod plot;
pub mod removed_nodes;
mod sections;
pub mod set_page;
mod sound;
