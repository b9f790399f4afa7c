//! What the device is doing, and everything it counts.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{MotionSource, Selection, SlotId, UploadState};

/// Cycles that one bin of the histogram is wide.
pub const TICK_BIN_CYCLES: u32 = 4096;

/// Bins of the histogram; the last one takes all that is longer. At 400 MHz the period of 80 000 cycles ends in it.
pub const TICK_BIN_COUNT: usize = 20;

/// A reason for the output to be at mid-scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[repr(u8)]
pub enum MuteReason {
    /// Nothing is being played.
    NotPlaying,
    /// Speed or force is older than [`super::STALE_AFTER_MS`].
    Stale,
    /// The host has not been heard for [`super::LINK_LOST_AFTER_MS`].
    LinkLost,
    /// A library is being activated, or a texture changed for another.
    Changing,
    /// A fault was found; only a restart ends it.
    Fault,
}

/// How many reasons there are.
pub const MUTE_REASON_COUNT: usize = 5;

impl MuteReason {
    /// All reasons, in the order of the counters in [`OutputStatus`].
    pub const ALL: [Self; MUTE_REASON_COUNT] = [
        Self::NotPlaying,
        Self::Stale,
        Self::LinkLost,
        Self::Changing,
        Self::Fault,
    ];
}

impl core::fmt::Display for MuteReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotPlaying => "not playing",
            Self::Stale => "speed or force out of date",
            Self::LinkLost => "link lost",
            Self::Changing => "changing texture or library",
            Self::Fault => "fault",
        })
    }
}

/// Reasons, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct MuteReasons(u8);

impl MuteReasons {
    /// None: the output is on.
    pub const NONE: Self = Self(0);

    /// The bits, bit n for the nth of [`MuteReason::ALL`].
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// From [`MuteReasons::bits`]; bits that stand for nothing are dropped.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & ((1 << MUTE_REASON_COUNT) - 1))
    }

    /// With or without `reason`.
    #[must_use]
    pub const fn set(self, reason: MuteReason, on: bool) -> Self {
        let bit = 1 << reason as u8;
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    /// Whether `reason` is one of them.
    pub const fn contains(self, reason: MuteReason) -> bool {
        self.0 & (1 << reason as u8) != 0
    }

    /// Whether there is none.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Each reason.
    pub fn iter(self) -> impl Iterator<Item = MuteReason> {
        MuteReason::ALL
            .into_iter()
            .filter(move |&reason| self.contains(reason))
    }
}

impl core::fmt::Display for MuteReasons {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (index, reason) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{reason}")?;
        }
        Ok(())
    }
}

/// What the player is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub enum Activity {
    /// Nothing.
    Idle,
    /// Playing, or muted while it would.
    Playing {
        /// What.
        selection: Selection,
        /// Where speed and force come from.
        motion: MotionSource,
    },
    /// Fading out, before it stops, or another texture or library takes over.
    FadingOut,
    /// Taking over another library.
    Activating,
}

/// The output and what was done to keep it safe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct OutputStatus {
    /// What the player is about.
    pub activity: Activity,
    /// Why the output is muted now.
    pub mute: MuteReasons,
    /// How often each of [`MuteReason::ALL`] began.
    pub mute_counts: [u32; MUTE_REASON_COUNT],
    /// Samples at the kernel's full scale.
    pub saturations: u32,
    /// Samples that the hard limit cut.
    pub hard_limited: u32,
    /// Samples that the slew limit held back.
    pub slew_limited: u32,
    /// Samples that the thermal limiter attenuated.
    pub thermally_limited: u32,
    /// The coil's modelled temperature rise, per mille of what the continuous limit leads to.
    pub thermal_load_permille: u16,
    /// The thermal limiter's gain, per mille.
    pub thermal_gain_permille: u16,
}

/// What the tick counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct TickCounters {
    /// Ticks since the start.
    pub ticks: u64,
    /// Ticks that did not run in their period.
    pub missed: u32,
    /// Blocks that began without a new frame.
    pub late_frames: u32,
    /// Conversions that were not there when the tick wanted them.
    pub late_conversions: u32,
}

/// How long ticks took, from entry to exit of the handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct TickHistogram {
    /// The processor's clock, Hz.
    pub core_hz: u32,
    /// The shortest, cycles; all ones before the first tick.
    pub shortest: u32,
    /// The longest, cycles.
    pub longest: u32,
    /// Ticks of n x [`TICK_BIN_CYCLES`] cycles and more, but less than (n + 1) times; the last bin takes the rest.
    pub bins: [u32; TICK_BIN_COUNT],
}

/// What the recorder counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct RecordCounters {
    /// Whether a recording is under way.
    pub recording: bool,
    /// Blocks of this recording, or the last.
    pub blocks: u32,
    /// Blocks of it that were lost in the device.
    pub lost_blocks: u32,
}

/// What one link counts.
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

/// Why the processor was last reset (RM0433 section 8.4.4, RCC_RSR), or by what fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResetReason {
    /// Power came.
    PowerOn,
    /// Power dipped.
    Brownout,
    /// The reset button or the probe.
    Pin,
    /// The firmware asked for it, without a fault.
    Software,
    /// The independent watchdog: the tick or the executor had stopped.
    Watchdog,
    /// A fault was caught; see [`Status::fault`].
    Fault,
    /// None of these.
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

/// What kind of fault was caught.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum FaultKind {
    /// HardFault, or a fault that escalated to it.
    HardFault,
    /// Non-maskable interrupt: the clock failed or the flash has an error that cannot be corrected.
    Nmi,
    /// A panic.
    Panic,
    /// An interrupt or exception without a handler.
    UnexpectedInterrupt,
    /// The tick stopped; the watchdog followed.
    TickStopped,
    /// The executor stopped; the watchdog followed.
    ExecutorStopped,
}

/// Where a panic was, or what else is to be told of a fault.
pub type FaultText = String<64>;

/// A fault that was caught before the last reset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Fault {
    /// What it was.
    pub kind: FaultKind,
    /// The program counter, 0 if not known.
    pub program_counter: u32,
    /// The fault's status: CFSR for a HardFault, the number of an interrupt, 0 otherwise.
    pub detail: u32,
    /// File and line of a panic.
    pub text: FaultText,
}

/// Everything that the device counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// Since the start, ms.
    pub uptime_ms: u64,
    /// The output.
    pub output: OutputStatus,
    /// The tick.
    pub tick: TickCounters,
    /// How long ticks took.
    pub tick_histogram: TickHistogram,
    /// The recorder.
    pub record: RecordCounters,
    /// The USB link.
    pub usb: LinkCounters,
    /// The serial link.
    pub serial: LinkCounters,
    /// The slot whose library is active.
    pub active: Option<SlotId>,
    /// CRC-32 of that library, 0 if none is active.
    pub library_crc32: u32,
    /// The upload, if one is under way.
    pub upload: UploadState,
    /// Why the processor was last reset.
    pub reset: ResetReason,
    /// Resets since power came.
    pub resets: u32,
    /// The last fault since power came.
    pub fault: Option<Fault>,
    /// Whether settings could not be read and defaults hold.
    pub settings_faulty: bool,
}
