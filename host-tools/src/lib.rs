//! From recordings of a surface to a library of texture models, and from a library to the very samples that the stylus
//! plays. The command `stylus` is a thin layer over this library.
//!
//! Each folder is a wing. A wing imports from the floors below its own, never from its own floor or above:
//!
//! ```text
//! report
//! evaluation
//! fit
//! texture    scene      link
//! recording  playing    rig
//! dsp        support
//! ```

pub mod dsp;
pub mod evaluation;
pub mod fit;
#[cfg(feature = "device")]
pub mod link;
pub mod playing;
pub mod recording;
pub mod report;
pub mod rig;
pub mod scene;
pub mod support;
pub mod texture;
