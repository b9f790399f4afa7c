#![doc = include_str!("../README.md")]
#![no_std]

#[cfg(feature = "alloc")]
extern crate alloc;

mod decimal;
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
pub use encode::{CodeSpec, NodeSpec, TextureSpec, encode, encode_with_scenes};
pub use error::{DecodeError, Place, Problem};
pub use library::{
    Axis, BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, Codebook, Coefficients, Decoder,
    Excitation, FadeLaw, LEVEL_FRACTION_BITS, Laws, LevelLaw, Library, Line, Lines,
    MU_LAW_FRACTION_BITS, Modulation, Node, NodeFlags, Outline, PartKind, Tail, Texture, Wander,
    Workspace, block_scale, block_share, level_amplitude, mu_law,
};
#[cfg(feature = "alloc")]
pub use library::{
    CodebookSpec, ExcitationSpec, LineSpec, LinesSpec, ModulationSpec, PartsSpec, TailSpec,
};
pub use units::{
    AdcCode, DacCode, MetresPerSecondSquared, MillimetresPerSecond, Newton, OutputSample, PlayRate,
    SAMPLE_RATE_HZ, Volt,
};
pub use wire::{FORMAT_VERSION, Provenance};

/// Angle of one step of a stored lattice code, rad: codes of ±2¹⁵ are ±π/2.
///
/// A node of a normalised lattice stores θ = arcsin k, not the reflection coefficient k itself: near |k| = 0.9999,
/// where resonances live, a step of θ is worth 7e-7 in k, forty times finer than a 16-bit k.
pub const THETA_STEP_RAD: f64 = core::f64::consts::PI / 65_536.0;

/// Binary digits that a θ has in addition to its 16-bit code: in the first stages of a lattice with a fine part, and
/// between nodes.
pub const THETA_FRACTION_BITS: u32 = 8;

/// Largest θ of a library, in steps of [`FINE_THETA_STEP_RAD`]: the largest code with the largest fraction, both ways.
///
/// This largest θ is a little below π/2, so that no stage has a reflection coefficient of magnitude 1.
pub const MAX_FINE_THETA: i32 = (i16::MAX as i32) * (1 << THETA_FRACTION_BITS) + i8::MAX as i32;

/// Angle of one step of θ with its fraction, rad: π/2²⁴.
pub const FINE_THETA_STEP_RAD: f64 = THETA_STEP_RAD / (1 << THETA_FRACTION_BITS) as f64;
