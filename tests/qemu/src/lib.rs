//! What a call costs on an emulated processor: every instruction that it executes, and the cycles that those take.
//!
//! QEMU runs an image one instruction a block and tells the address of each ([`trace`]); the image's own bytes are decoded
//! there ([`thumb`]), and each instruction takes the cycles that Arm's manual of the Cortex-M4 gives it ([`cortex_m4`]).
//! Instructions are exact and repeat exactly. Cycles are a model, between a best and a worst case, with neither wait
//! states nor interrupts. For a Cortex-M7 no such manual exists: it issues up to two instructions a cycle and predicts
//! branches, so that the worst column bounds it.
//!
//! The tests are in `tests/`; the image that they run is in `guest/`; what a sample and an update cost stands in
//! `costs.json` ([`costs`]), written by `cargo tasks costs`.

pub mod cortex_m4;
pub mod costs;
pub mod count;
pub mod error;
pub mod image;
pub mod thumb;
pub mod trace;
