//! The application of the stylus, without its hardware. The same code runs in the image, in tests, and on the host when
//! it computes the device's output.
//!
//! Nothing here allocates, waits for hardware, or knows a register. Hardware stands behind small traits:
//! [`control::Device`], [`slots::MappedFlash`], [`storage::Stage`], [`self_test::SelfTestHardware`].
//!
//! | module | runs in |
//! |---|---|
//! | [`safety`], [`ring`] | the tick |
//! | [`inputs`] | the tick (encoder, conversions) and below it (motion) |
//! | [`levels`] | thread mode, never waits |
//! | [`recorder`] | the tick (one sample in a queue) and thread mode (blocks) |
//! | [`start`] | the start, before the clocks are set up |
//! | [`player`], [`control`] | thread mode, never waits |
//! | [`requests`] | thread mode, never waits; its jobs are asynchronous |
//! | [`slots`], [`upload`], [`settings`], [`storage`], [`self_test`] | thread mode, asynchronous |
//! | [`update`], [`update_requests`] | thread mode, asynchronous |
#![no_std]
#![expect(
    clippy::result_large_err,
    reason = "errors carry their reason as text, and there is no heap to put it on"
)]

#[cfg(test)]
extern crate std;

pub mod control;
pub mod inputs;
pub mod lease;
pub mod levels;
pub mod player;
pub mod proposals;
pub mod recorder;
pub mod requests;
pub mod ring;
pub mod safety;
pub mod self_test;
pub mod settings;
pub mod slots;
pub mod start;
pub mod status;
pub mod storage;
pub mod update;
pub mod update_requests;
pub mod upload;
mod words;

/// Geometry of the STM32H743's flash.
pub mod flash {
    pub use stylus_boot::map::{BANK_BYTES, SECTOR_BYTES, WORD_BYTES};
}

pub use model_format::SAMPLE_RATE_HZ;

/// Ticks between two updates, 2 ms: at 5 kHz there is one sample per tick.
pub const UPDATE_INTERVAL_TICKS: u32 = stylus_kernel::UPDATE_INTERVAL_SAMPLES;

/// Deadline of an update: ticks from its request to the beginning of the block that its coefficients shape, 0.6 ms.
///
/// The lead is short, because it delays the response to the hand. An update of two voices takes 25 000 instructions.
/// While ticks take half of the processor, the lead leaves more than four cycles per instruction.
pub const UPDATE_LEAD_TICKS: u32 = 3;

/// Ticks per millisecond: there is one tick per sample at 5 kHz.
pub const TICKS_PER_MS: u32 = SAMPLE_RATE_HZ / 1_000;
