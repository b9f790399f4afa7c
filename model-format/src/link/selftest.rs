//! Measurements of the device's self test. The device measures; the host compares with limits.
//!
//! Each request is for one measurement. A request is refused while anything is played, and nothing can be played until
//! it is answered. The measurement ends by itself, even if the host is no longer there.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{Reason, SlotId};

/// Number of codes of [`OutputValues::sums`].
pub const OUTPUT_CODES: usize = 32;

/// Lowest of these codes, 0.2 V of 3.3 V. The output's buffer does not reach lower voltages (DS12110, DAC
/// characteristics).
pub const LOWEST_OUTPUT_CODE: u16 = 256;

/// Difference of two successive codes. The highest code is 3821, a little more than 0.2 V below the reference.
pub const OUTPUT_CODE_STEP: u16 = 115;

/// Number of conversions per sum of [`OutputValues::sums`].
pub const CONVERSIONS_PER_CODE: u32 = 64;

/// Number of conversions of [`RestValues::sum`]: they take longer than two ticks.
pub const REST_CONVERSIONS: u32 = 64;

/// Number of instants of [`OutputValues::step_words`].
pub const STEP_INSTANTS: usize = 16;

/// Time between two successive instants, cycles of the core.
pub const STEP_INSTANT_CYCLES: u32 = 400;

/// Codes of the output before and after its step.
pub const STEP_CODES: [u16; 2] = [1024, 3072];

/// Number of RAMECC monitors (RM0433 chapter 3).
pub const RAM_MONITORS: usize = 12;

/// Number of bytes that the test writes to flash and reads back.
pub const FLASH_TEST_BYTES: u32 = 4096;

/// Returns code number `index` of the sweep.
pub const fn output_code(index: usize) -> u16 {
    LOWEST_OUTPUT_CODE + index as u16 * OUTPUT_CODE_STEP
}

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum SelfTestRequest {
    /// Identity of the silicon.
    Chip,
    /// Option bytes of the flash.
    OptionBytes,
    /// Clocks, counted against each other. Takes about a second.
    Clocks,
    /// Errors that memories have corrected or found since the start.
    ErrorCorrection,
    /// The output's pin, moved and read back, with the amplifier disabled. Takes about a second.
    Output {
        /// True if the host's user states that no amplifier is connected. Otherwise its enable input must be wired, see
        /// [`super::Setting::EnableWired`].
        disconnected: bool,
    },
    /// The output's pin at rest, read back without moving it.
    Rest,
    /// Levels of the encoder's lines.
    Encoder,
    /// Erasing and writing one sector of a slot, which is erased again at the end. Takes some seconds.
    Flash {
        /// The slot.
        slot: SlotId,
        /// True if a library in the slot may be erased. The active library is never erased.
        erases_library: bool,
    },
}

/// The values of a measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub enum SelfTestValues {
    /// Values of [`SelfTestRequest::Chip`].
    Chip(ChipValues),
    /// Values of [`SelfTestRequest::OptionBytes`].
    OptionBytes(OptionByteValues),
    /// Values of [`SelfTestRequest::Clocks`].
    Clocks(ClockValues),
    /// Values of [`SelfTestRequest::ErrorCorrection`].
    ErrorCorrection(ErrorCorrectionValues),
    /// Values of [`SelfTestRequest::Output`].
    Output(OutputValues),
    /// Values of [`SelfTestRequest::Rest`].
    Rest(RestValues),
    /// Values of [`SelfTestRequest::Encoder`].
    Encoder(EncoderValues),
    /// Values of [`SelfTestRequest::Flash`].
    Flash(FlashValues),
}

/// Identity of the silicon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ChipValues {
    /// `DEV_ID` of `DBGMCU_IDC` (RM0433 section 60.5.8).
    pub device: u16,
    /// `REV_ID` of the same register.
    pub revision: u16,
    /// The unique id (RM0433 section 61.1).
    pub unique_id: [u32; 3],
    /// Size of the flash, KB (RM0433 section 61.2).
    pub flash_kb: u16,
    /// `PKG` of `SYSCFG_PKGR` (RM0433 section 12.3.11).
    pub package: u8,
}

/// Option bytes in use, as the flash's registers hold them (RM0433 section 4.9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct OptionByteValues {
    /// `FLASH_OPTSR_CUR`: protection level, brown-out level, watchdog.
    pub status: u32,
    /// `SWAP_BANK` of `FLASH_OPTCR`.
    pub banks_swapped: bool,
    /// `WRPSn` of both banks: a zero protects a sector.
    pub writable_sectors: [u8; 2],
    /// `FLASH_PRAR_CUR` of both banks. An area whose start lies above its end is empty.
    pub read_protected: [u32; 2],
    /// `FLASH_SCAR_CUR` of both banks, in the same form.
    pub secure: [u32; 2],
    /// `FLASH_BOOT_CUR`: the upper halves of both boot addresses.
    pub boot: u32,
}

/// A number of periods of one clock, and the time that they took, counted by another clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ClockCount {
    /// Number of periods.
    pub periods: u32,
    /// Cycles of the core, or of the timers, in these periods.
    pub cycles: u64,
}

/// Clocks, counted against each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ClockValues {
    /// Rate of the core's clock by design, Hz.
    pub core_hz: u32,
    /// Rate of the timers' clock by design, Hz.
    pub timer_hz: u32,
    /// Periods of LSI, timed in cycles of the timers; none if no edge of LSI came.
    pub low_speed: Option<ClockCount>,
    /// Frames of USB, timed in cycles of the core; none if no host is connected.
    pub usb_frames: Option<ClockCount>,
    /// Ticks of TIM6, timed in cycles of the core.
    pub ticks: ClockCount,
}

/// Errors that memories have corrected or found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ErrorCorrectionValues {
    /// Status of each RAMECC monitor since the start. Bit 0: a corrected error. Bit 1: an error that could not be
    /// corrected. Bit 2: such an error in a write of a part of a word.
    pub ram: [u8; RAM_MONITORS],
    /// Reads of each bank of the flash with a corrected error, since the start.
    pub flash_corrected: [u32; 2],
    /// Reads of each bank of the flash with an error that could not be corrected, since the start.
    pub flash_failed: [u32; 2],
}

/// The output's pin, read back by a converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct OutputValues {
    /// For each code of [`output_code`], the sum of [`CONVERSIONS_PER_CODE`] conversions of 16 bits.
    pub sums: [u32; OUTPUT_CODES],
    /// RMS noise at mid-scale, in codes of 16 bits.
    pub noise: f32,
    /// Converted code at each instant after a step of [`STEP_CODES`]. Instants are [`STEP_INSTANT_CYCLES`] apart; the
    /// first is the instant of the trigger.
    pub step_words: [u16; STEP_INSTANTS],
    /// Time from the command for a conversion to the instant of its sample, cycles of the core.
    pub sample_cycles: u32,
}

/// The output's pin at rest, read back by a converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RestValues {
    /// Sum of [`REST_CONVERSIONS`] conversions of 16 bits.
    pub sum: u32,
    /// The lowest and the highest of these conversions.
    pub range: [u16; 2],
}

/// Levels of the encoder's lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct EncoderValues {
    /// The counter, which wraps.
    pub count: u16,
    /// Levels of the first and the second line.
    pub levels: [bool; 2],
}

/// Erasing and writing one sector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct FlashValues {
    /// The slot.
    pub slot: SlotId,
    /// Duration of the erasure, µs.
    pub erase_us: u32,
    /// Number of bytes that were not blank after the erasure.
    pub not_erased: u32,
    /// Number of words of 32 bytes that were written.
    pub words: u32,
    /// Duration of writing these words, µs.
    pub write_us: u32,
    /// Longest duration of writing one of these words, µs.
    pub longest_write_us: u32,
    /// Number of bytes that read back wrong.
    pub wrong: u32,
}

/// Reason for which a measurement was not made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum SelfTestError {
    #[error("something is being played or a library is being activated: stop it first")]
    Playing,
    #[error("an upload is under way: end or abort it first")]
    Uploading,
    #[error("slot {slot} holds the active library, which is never erased: test the other slot")]
    ActiveSlot { slot: SlotId },
    #[error("slot {slot} is not empty: upload its library again later, and allow to erase it")]
    NotEmpty { slot: SlotId },
    #[error(
        "slot {slot} holds the only library that can be read, which no test erases: upload one to the other slot first"
    )]
    LastLibrary { slot: SlotId },
    #[error(
        "the amplifier may be on, and the coil would take what the test puts out: set enable-wired to 1 if its enable \
         is wired to PE9, or take it off PA4 and test with --no-amplifier"
    )]
    AmplifierMayBeOn,
    #[error("{what}: restart the device; if it stays, the part is damaged")]
    Hardware {
        /// The part, and what it did not do.
        what: Reason,
    },
}
