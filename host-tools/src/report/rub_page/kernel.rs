//! The kernel that every page holds.

/// The kernel as a WebAssembly module, as `cargo tasks browser-module` builds it.
pub const KERNEL: &[u8] = include_bytes!("kernel.wasm");

/// Name and version of the compiler that built it.
pub const KERNEL_BUILT_BY: &str = include_str!("kernel.txt");
