//! The cost of a call on an emulated processor: the executed instructions.
//!
//! QEMU runs an image one instruction per block and logs the address of each ([`trace`]). The image's own bytes at that
//! address are decoded ([`thumb`]). Counts are exact and repeat exactly. Cycles are not counted here: `cargo tasks
//! costs` gives the executed instructions to llvm-mca.
//!
//! The tests are in `tests/`, and the image that they run is in `guest/`. The costs of samples and updates are kept in
//! `host-tools/costs/costs.json`, which `cargo tasks costs` writes.

pub mod count;
pub mod error;
pub mod image;
pub mod thumb;
pub mod trace;
