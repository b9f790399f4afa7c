#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(feature = "alloc")]
extern crate alloc;

#[cfg(feature = "alloc")]
mod encode;
mod error;
mod library;
pub mod limits;
#[cfg(feature = "link")]
pub mod link;
pub mod scene;
mod units;
mod wire;

#[cfg(feature = "alloc")]
pub use encode::{
    CodeSpec, NodeSpec, TextureSpec, encode, encode_uncertified, encode_with_scenes,
    encode_with_scenes_uncertified,
};
pub use error::{DecodeError, Place, Problem};
pub use library::{
    Axis, CELL_MARGIN_STEPS_PER_OCTAVE, Certificate, Coefficients, Library, Node, NodeFlags,
    Texture, UNCERTIFIED_CELL,
};
pub use units::{
    AdcCode, DacCode, MetresPerSecondSquared, MillimetresPerSecond, Newton, OutputSample,
    SAMPLE_RATE_HZ, Volt,
};
pub use wire::{FORMAT_VERSION, Provenance, Structure};

/// Angle of one step of a stored lattice code, rad: codes of ±2¹⁵ are ±π/2.
///
/// A node of a normalised lattice stores θ = arcsin k, not the reflection coefficient k itself: near |k| = 0.9999,
/// where resonances live, a step of θ is worth 7e-7 in k, forty times finer than a 16-bit k.
pub const THETA_STEP_RAD: f64 = core::f64::consts::PI / 65_536.0;
