//! Results as pictures and pages that need nothing else to be read.
//!
//! Invariant: a report draws and words the results of other wings; it judges nothing itself.

pub mod evaluation_folder;
pub mod family;
pub mod figures;
pub mod frontier_page;
pub mod html;
pub mod listening_page;
mod npz;
pub mod plot;
#[cfg(feature = "spectrograms")]
pub mod removed_nodes;
pub mod rub_page;
mod sections;
#[cfg(feature = "spectrograms")]
pub mod set_page;
pub mod sound;
