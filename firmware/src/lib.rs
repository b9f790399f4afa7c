//! Instructions of the stylus's processor that no compiler generates by itself, for the kernel's inner loops.
//!
//! All unsafe code of the product is in this package. On a host this library is empty.
#![no_std]

#[cfg(target_arch = "arm")]
mod interpolate;
#[cfg(target_arch = "arm")]
mod multiply;

#[cfg(target_arch = "arm")]
pub use multiply::{CortexM4, CortexM7};
