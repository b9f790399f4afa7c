//! Playing on the host: a motion over time, and the samples that the stylus plays along this motion.
//!
//! Invariant: the samples come from the device's own kernel and are equal to the device's to the bit.

pub mod motion;
pub mod pin;
pub mod render;
pub mod wavefront;
