//! The target that the microcontroller's core needs, and the packages that build for it.
//!
//! Apart from [`crate::toolchain`], because an error names both and the search for a toolchain returns errors.

/// Cortex-M4 and M7 with a floating-point unit.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Debian 12's packages that build for [`TARGET`].
pub const DEBIAN_PACKAGES: [&str; 6] = [
    "rustc-web",
    "cargo-web",
    "rust-web-src",
    "rust-web-llvm",
    "rust-web-clippy",
    "lld-22",
];
