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
    Axis, BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, Codebook, Coefficients, Decoder, Excitation, FadeLaw, Laws,
    LevelLaw, Library, Line, Lines, Node, NodeFlags, Outline, PartKind, SHARE_FRACTION_BITS, Tail, Texture, Wander,
    Workspace, block_scale, block_share,
};
#[cfg(feature = "alloc")]
pub use library::{CodebookSpec, ExcitationSpec, LineSpec, LinesSpec, PartsSpec, TailSpec};
pub use units::{
    AdcCode, DacCode, MetresPerSecondSquared, MillimetresPerSecond, Newton, OutputSample, PlayRate, SAMPLE_RATE_HZ,
    Volt,
};
pub use wire::{FORMAT_VERSION, Provenance};

/// Angle of one step of a stored lattice code, rad. A code of ±2¹⁵ would be ±π/2.
///
/// A node of a normalised lattice stores θ = arcsin k instead of the reflection coefficient k, because θ resolves
/// narrow resonances better: near |k| = 0.9999, where resonances live, a step of θ changes k by 7e-7, forty times less
/// than a step of a 16-bit k.
pub const THETA_STEP_RAD: f64 = core::f64::consts::PI / 65_536.0;

/// Binary digits of θ beyond its 16-bit code. The first stages of a lattice may store them, and an interpolated θ
/// between nodes has them and more.
pub const THETA_FRACTION_BITS: u32 = 8;

/// Largest magnitude of θ that `CodeSpec::fine_lattice` writes, in steps of [`FINE_THETA_STEP_RAD`]: the largest code
/// with the largest fraction.
///
/// It is a little below π/2, so that no stage has a reflection coefficient of magnitude 1.
pub const MAX_FINE_THETA: i32 = (i16::MAX as i32) * (1 << THETA_FRACTION_BITS) + i8::MAX as i32;

/// Angle of one step of the fraction of θ, rad: π/2²⁴.
pub const FINE_THETA_STEP_RAD: f64 = THETA_STEP_RAD / (1 << THETA_FRACTION_BITS) as f64;
