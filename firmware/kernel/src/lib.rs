//! The synthesis of the stylus, sample by sample, in fixed point: white Gaussian excitation through an all-pole filter
//! whose coefficients follow the speed and force of the moment.
//!
//! The same source runs on the host (`stylus render`), on QEMU and on the device, and gives the same bits: the sample
//! path has no floating point, and the little there is in [`grid`] and [`level`] is single operations that IEEE 754
//! defines to the last bit.
//!
//! Two structures share one interface. The *normalised lattice* ([`lattice`]) is the default: its state's norm cannot
//! grow, whatever its coefficients do from one sample to the next. The *direct form* ([`direct`]) is the paper's own
//! (Romano, Yoshioka, Kuchenbecker, ICRA 2010).
//!
//! A [`scene`] is played by the same two: voices, each one a frame and a playback, and what else it calls for.
//!
//! Configuration is apart from state: a *frame* holds what a (speed, force) calls for and is computed below the
//! sample's priority; the *state* holds what was played. How many instructions a sample takes depends on the texture
//! (its structure and highest order), never on the data.
#![no_std]

pub mod arithmetic;
pub mod direct;
pub mod excitation;
mod fixed;
pub mod grid;
pub mod lattice;
pub mod level;
pub mod rotation;
pub mod scene;
mod synthesis;
#[cfg(feature = "variants")]
pub mod variants;

pub use grid::{Motion, MotionError};
pub use level::Levels;
pub use synthesis::{Frame, Playback, Scale, Synthesis, UPDATE_INTERVAL_SAMPLES};
