//! The part of the stylus that is bound to its processor: instructions that no compiler finds by itself.
//!
//! All unsafe code of the product is in this package. On a host it is empty.
#![no_std]

#[cfg(target_arch = "arm")]
mod multiply;

#[cfg(target_arch = "arm")]
pub use multiply::CortexM;
