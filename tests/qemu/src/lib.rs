//! The cost of a call on an emulated processor: the executed instructions and their cycles.
//!
//! QEMU runs an image one instruction per block and logs the address of each ([`trace`]). The image's own bytes at that
//! address are decoded ([`thumb`]), and each instruction takes the cycles of Arm's manual of the Cortex-M4
//! ([`cortex_m4`]). Instructions are exact and repeat exactly. Cycles are a model, between a best and a worst case,
//! with neither wait states nor interrupts. For a Cortex-M7 no such manual exists. It issues up to two instructions per
//! cycle and predicts branches, so that the Cortex-M4's worst case bounds it.
//!
//! The tests are in `tests/`, and the image that they run is in `guest/`. The costs of samples and updates are kept in
//! `host-tools/costs/costs.json` ([`costs`]), which `cargo tasks costs` writes.

pub mod cortex_m4;
pub mod costs;
pub mod count;
pub mod error;
pub mod image;
pub mod thumb;
pub mod trace;
