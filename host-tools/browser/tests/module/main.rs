//! The page's WebAssembly module, in an interpreter, against the kernel on this computer.
//!
//! The module is the kept one, or that which `STYLUS_BROWSER_MODULE` names.

mod calls;
mod faults;
mod same_bits;
mod session;
mod wasm;
