//! Identity of the device, its activity, its worst cases and all its counters.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{
    LeaseStatus, MUTE_REASON_COUNT, MotionSource, MuteReasons, OutputLimits, Selection, SettingsProposal,
    SettingsState, SlotId, StartReport, UploadState,
};

/// Width of one bin of the histogram, cycles.
pub const TICK_BIN_CYCLES: u32 = 4096;

/// Number of bins of the histogram. The last bin also counts all longer ticks. At 400 MHz, a period is 80 000 cycles,
/// which lies in the last bin.
pub const TICK_BIN_COUNT: usize = 20;

/// Activity of the player.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub enum Activity {
    /// Nothing is played.
    Idle,
    /// A texture or scene is played, or muted.
    Playing {
        /// The texture or scene.
        selection: Selection,
        /// Source of speed and force.
        motion: MotionSource,
    },
    /// A probe is played, or about to be.
    Probing,
    /// The output fades out, before it stops or another texture or library takes over.
    FadingOut,
    /// Another library is being activated.
    Activating,
}

/// State of the output and of its safety stages.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct OutputStatus {
    /// Activity of the player.
    pub activity: Activity,
    /// True if the output is at mid-scale because of the current mute, whose ramp has ended.
    pub at_rest: bool,
    /// Reasons for which the output is muted now.
    pub mute: MuteReasons,
    /// Number of times that a mute began for each reason of [`super::MuteReason::ALL`].
    pub mute_counts: [u32; MUTE_REASON_COUNT],
    /// Number of samples at the kernel's full scale.
    pub saturations: u32,
    /// Number of samples that the hard limit cut.
    pub hard_limited: u32,
    /// Number of samples that the slew limit held back.
    pub slew_limited: u32,
    /// Number of samples that the thermal limiter attenuated.
    pub thermally_limited: u32,
    /// Modelled temperature rise of the coil, per mille of the rise at the continuous power limit.
    pub thermal_load_permille: u16,
    /// Gain of the thermal limiter, per mille.
    pub thermal_gain_permille: u16,
    /// True while the amplifier is enabled.
    pub amplifier: bool,
}

/// Counters of the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct TickCounters {
    /// Ticks since the start.
    pub ticks: u64,
    /// Ticks that did not run in their period.
    pub missed: u32,
    /// Blocks of ten ticks that began without new coefficients (a frame).
    pub late_frames: u32,
    /// Conversions that were not complete when the tick read them.
    pub late_conversions: u32,
    /// Ticks whose codes did not directly follow the last code of the output, because they, or the codes before them,
    /// came too late.
    pub late_outputs: u32,
}

/// Histogram of the ticks' durations, from entry to exit of the handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct TickHistogram {
    /// Clock of the processor, Hz.
    pub core_hz: u32,
    /// Shortest tick, cycles; all ones before the first tick.
    pub shortest: u32,
    /// Longest tick, cycles.
    pub longest: u32,
    /// Number of ticks per bin. Bin n counts ticks of n to (n + 1) x [`TICK_BIN_CYCLES`] cycles, and the last bin also
    /// all longer ticks.
    pub bins: [u32; TICK_BIN_COUNT],
}

/// Counters of the recorder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RecordCounters {
    /// True while a recording is under way.
    pub recording: bool,
    /// Blocks of the current recording, or of the last one if none is under way.
    pub blocks: u32,
    /// Number of these blocks that were lost in the device.
    pub lost_blocks: u32,
}

/// Counters of one link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct LinkCounters {
    /// Frames that were understood.
    pub frames: u32,
    /// Frames that could not be decoded.
    pub malformed: u32,
    /// Frames longer than [`super::MAX_HOST_FRAME_BYTES`].
    pub oversized: u32,
    /// Faults below the frames: framing, noise, parity, overrun.
    pub line_errors: u32,
    /// Frames that could not be sent in time.
    pub unsent: u32,
}

/// Cause of the processor's last reset (RM0433 section 8.4.4, RCC_RSR).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResetReason {
    /// Power was switched on.
    PowerOn,
    /// Power dipped.
    Brownout,
    /// The reset button or the debug probe.
    Pin,
    /// A request of the firmware, without a fault.
    Software,
    /// The independent watchdog: the tick or the executor had stopped.
    Watchdog,
    /// A fault that was caught; see [`Status::fault`].
    Fault,
    /// No cause that the device knows.
    Unknown,
}

impl core::fmt::Display for ResetReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::PowerOn => "power on",
            Self::Brownout => "brownout",
            Self::Pin => "reset pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::Fault => "fault",
            Self::Unknown => "unknown",
        })
    }
}

/// Kind of a fault that was caught.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum FaultKind {
    /// HardFault, or a usage fault that escalated to it.
    HardFault,
    /// Non-maskable interrupt: the flash has an error that cannot be corrected.
    Nmi,
    /// A panic.
    Panic,
    /// An interrupt or exception without a handler.
    UnexpectedInterrupt,
    /// The tick stopped; the watchdog followed.
    TickStopped,
    /// The executor stopped; the watchdog followed.
    ExecutorStopped,
    /// The external clock failed while the processor ran on it.
    ClockFailed,
    /// A stage of the start did not end; the watchdog followed. See [`StartReport::hung_stage`].
    StartHung,
    /// The stack overflowed.
    StackOverflow,
    /// An access that the memory protection refused: see [`Fault::address`].
    MemoryProtection,
    /// An access that the bus refused: see [`Fault::address`].
    BusFault,
}

/// Location of a panic, or other detail of a fault.
pub type FaultText = String<64>;

/// A fault that was caught since power-on; a reset followed it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Fault {
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Program counter, 0 if not known.
    pub program_counter: u32,
    /// Status of the fault: CFSR for a fault of the processor, the number of an interrupt, 0 otherwise.
    pub detail: u32,
    /// Address of the access that was refused, or the address that the stack had reached, if the processor knows it.
    pub address: Option<u32>,
    /// File and line of a panic.
    pub text: FaultText,
}

/// State and counters of the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// Time since the start, ms.
    pub uptime_ms: u64,
    /// The output.
    pub output: OutputStatus,
    /// The tick.
    pub tick: TickCounters,
    /// Durations of ticks.
    pub tick_histogram: TickHistogram,
    /// Worst cases since the start.
    pub marks: Marks,
    /// Levels of the sensors.
    pub levels: Levels,
    /// The recorder.
    pub record: RecordCounters,
    /// The USB link.
    pub usb: LinkCounters,
    /// The serial link.
    pub serial: LinkCounters,
    /// The slot whose library is active, if any.
    pub active: Option<SlotId>,
    /// CRC-32 of that library, 0 if none is active.
    pub library_crc32: u32,
    /// State of the upload.
    pub upload: UploadState,
    /// Cause of the processor's last reset.
    pub reset: ResetReason,
    /// Resets since power-on.
    pub resets: u32,
    /// The last fault since power-on.
    pub fault: Option<Fault>,
    /// State of the settings.
    pub settings: SettingsState,
    /// The start: clock, silicon, supply, safe mode.
    pub start: StartReport,
    /// State of the lease to play.
    pub lease: LeaseStatus,
    /// Limits of the output that are in force.
    pub limits: OutputLimits,
    /// The change of settings that was proposed and not yet applied.
    pub proposal: Option<SettingsProposal>,
}

/// Worst cases since the start. Cycles are those of the processor, see [`super::TickHistogram::core_hz`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Marks {
    /// Length of the stack, bytes.
    pub stack_bytes: u32,
    /// Largest number of bytes of the stack that tasks and interrupts together have used. The value may be a second
    /// old.
    pub stack_used_bytes: u32,
    /// Longest delay from the timer's trigger to the first instruction of the tick, cycles. Missed ticks are counted in
    /// [`TickCounters::missed`] and are not included.
    pub longest_tick_delay_cycles: u32,
    /// Longest time for which interrupts were masked since the first tick, cycles.
    pub longest_critical_section_cycles: u32,
    /// Longest time between two feeds of the watchdog, µs.
    pub longest_watchdog_gap_us: u32,
}

/// Levels of the sensors over the last complete window, in decibels according to ISO 1683. A level below 0 dB, the
/// reference itself, is given as 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
pub struct Levels {
    /// Number of samples of the window; 0 before the first one is complete.
    pub samples: u32,
    /// RMS of the acceleration of all axes together, without its mean, dB re 1 µm/s².
    pub vibration_decibel: f32,
    /// Mean force, N.
    pub force_newton: f32,
    /// Standard deviation of the force, dB re 1 µN.
    pub force_noise_decibel: f32,
}

/// Range of the durations of one handler's runs, from its entry to its exit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct CycleRange {
    /// Number of runs.
    pub runs: u32,
    /// Shortest run, cycles; all ones without a run.
    pub shortest: u32,
    /// Longest run, cycles; 0 without a run.
    pub longest: u32,
}

impl CycleRange {
    /// The range of no runs.
    pub const NONE: Self = Self {
        runs: 0,
        shortest: u32::MAX,
        longest: 0,
    };

    /// Returns the range over the runs of both ranges.
    #[must_use]
    pub fn merged(self, other: Self) -> Self {
        Self {
            runs: self.runs.saturating_add(other.runs),
            shortest: self.shortest.min(other.shortest),
            longest: self.longest.max(other.longest),
        }
    }
}

/// Durations since the previous request, or since the start. Each request begins a new range, so that a host can
/// measure several textures or scenes one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct CycleReport {
    /// Clock of the processor, Hz.
    pub core_hz: u32,
    /// The tick.
    pub tick: CycleRange,
    /// The update, with the ticks and the serial port's interrupts that interrupted it.
    pub update: CycleRange,
}

/// Name of a product.
pub type ProductName = String<32>;
/// Serial number of a board, hexadecimal: the 96-bit unique id of the STM32 (RM0433 section 61.1).
pub type Serial = String<24>;
/// A version as text.
pub type VersionText = String<64>;

/// Identity and versions of a device. This type never changes; anything else goes to an endpoint of its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct DeviceInfo {
    /// Name of the product.
    pub product: ProductName,
    /// Serial number of the board.
    pub serial: Serial,
    /// Version of the firmware.
    pub firmware_version: VersionText,
    /// Build of the firmware: profile, compiler, revision if known.
    pub build: VersionText,
    /// [`crate::link::PROTOCOL_VERSION`] of the device.
    pub protocol_version: u16,
    /// [`crate::FORMAT_VERSION`] of the libraries that the device plays.
    pub library_format_version: u16,
    /// [`crate::link::SCHEMA_HASH`] of the device.
    pub schema_hash: u64,
}
