//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report draws and words the results of other wings; it judges nothing itself.

pub mod evaluation_folder;
pub mod frontier_page;
pub mod html;
pub mod plot;
pub mod removed_nodes;
mod sections;
pub mod set_page;
mod sound;
