//! Playing on the host: a motion over time, and the samples that the stylus plays along it.
//!
//! Invariant: the samples come from the device's own kernel and are bit-equal to the device's.

pub mod motion;
pub mod pin;
pub mod render;
pub mod wavefront;
