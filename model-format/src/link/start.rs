//! Report of the start: clock, silicon, supply, and faults that came soon after a start.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize, Serializer};

/// Time after a start within which a fault counts as quick, ms. A run that lasts longer counts as healthy.
pub const QUICK_FAULT_MS: u32 = 10_000;

/// Number of quick faults in succession after which the device starts in safe mode.
pub const QUICK_FAULTS: u8 = 3;

/// Supply below which flash is neither erased nor programmed, mV: the falling threshold of level 6 of the voltage
/// detector (DS12110, embedded reset and power control block, typical).
pub const FLASH_SUPPLY_MV: u16 = 2_760;

/// Source of the processor's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ClockSource {
    /// The clock or crystal of the board, multiplied.
    #[default]
    External,
    /// The internal oscillator of 64 MHz, multiplied. All times have its tolerance, about 1 %.
    Internal,
    /// The internal oscillator without multiplication. No sample is converted or output.
    InternalUnmultiplied,
}

impl core::fmt::Display for ClockSource {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::External => "external",
            Self::Internal => "internal",
            Self::InternalUnmultiplied => "internal, not multiplied",
        })
    }
}

/// Stage of the start, in the order of the stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum StartStage {
    /// Supply and clocks, from the external oscillator.
    ExternalClock,
    /// Supply and clocks, from the internal oscillator.
    InternalClock,
    /// Supply and clocks, without a multiplied clock.
    UnmultipliedClock,
    /// Converter, encoder and tick.
    Inputs,
    /// Settings and slots in flash.
    Storage,
    /// Serial port and USB.
    Links,
}

impl StartStage {
    /// All stages, in order.
    pub const ALL: [Self; 6] = [
        Self::ExternalClock,
        Self::InternalClock,
        Self::UnmultipliedClock,
        Self::Inputs,
        Self::Storage,
        Self::Links,
    ];
}

impl core::fmt::Display for StartStage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::ExternalClock => "external clock",
            Self::InternalClock => "internal clock",
            Self::UnmultipliedClock => "clock without multiplication",
            Self::Inputs => "inputs",
            Self::Storage => "flash",
            Self::Links => "links",
        })
    }
}

/// Lowest level of the brown-out reset that a board should have. Levels are 0 to 3, and 0 is off.
///
/// If the brown-out reset is off, the processor runs until its supply falls below a threshold between 1.58 and 1.68 V
/// (DS12110, reset and power control block, falling threshold of the power-down reset). But the core and the flash need
/// 1.62 V (DS12110, general operating conditions). A comparison with [`FLASH_SUPPLY_MV`] does not replace the brown-out
/// reset, because it comes only before a flash operation, and an erasure takes up to 4 s. Each level from 1 on lies
/// above 1.62 V.
pub const LEAST_BROWN_OUT_LEVEL: u8 = 1;

/// Revision of the silicon: REV_ID of DBGMCU_IDC (RM0433 section 60.5.8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SiliconRevision(pub u16);

impl SiliconRevision {
    /// Returns true for the revisions that misread the AXI SRAM unless a workaround is active (ES0392 section 2.2.9).
    pub const fn misreads_axi_sram(self) -> bool {
        self.0 < 0x2000
    }

    /// Returns true for the revisions that halve the clock of their converters (RM0433 section 25.4.3; ST's driver
    /// does so above revision Y).
    pub const fn halves_converter_clock(self) -> bool {
        self.0 > 0x1003
    }

    /// Returns true for the revisions that the image is made for, [`Self::SUPPORTED`]. On older revisions, it runs with
    /// workarounds for the known errors and is otherwise untested.
    pub const fn is_supported(self) -> bool {
        matches!(self.letter(), Some('X' | 'V'))
    }

    /// Returns true for the revisions that, according to users' reports, cannot trim the USB clock by the host's
    /// frames, so that USB needs the external clock.
    pub const fn lacks_trimming(self) -> bool {
        self.0 <= 0x1003
    }

    /// The revisions of [`Self::is_supported`], as text.
    pub const SUPPORTED: &str = "X or V";

    const fn letter(self) -> Option<char> {
        match self.0 {
            0x1001 => Some('Z'),
            0x1003 => Some('Y'),
            0x2001 => Some('X'),
            0x2003 => Some('V'),
            _ => None,
        }
    }
}

impl core::fmt::Display for SiliconRevision {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.letter() {
            Some(letter) => write!(f, "{letter} ({:#06x})", self.0),
            None => write!(f, "unknown ({:#06x})", self.0),
        }
    }
}

/// Name of a board, with zeros after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Schema)]
pub struct BoardName(pub [u8; 16]);

impl Serialize for BoardName {
    /// Writes text into JSON.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            return serializer.serialize_str(self.as_str());
        }
        self.0.serialize(serializer)
    }
}

impl BoardName {
    /// The board called `name`, of which 16 bytes count.
    pub const fn new(name: &str) -> Self {
        let mut bytes = [0; 16];
        let mut index = 0;
        while index < bytes.len() && index < name.len() {
            bytes[index] = name.as_bytes()[index];
            index += 1;
        }
        Self(bytes)
    }

    /// The name; empty if it is none.
    pub fn as_str(&self) -> &str {
        core::str::from_utf8(&self.0).unwrap_or_default().trim_end_matches('\0')
    }
}

impl core::fmt::Display for BoardName {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Report of the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct StartReport {
    /// The board that the image was built for.
    pub board: BoardName,
    /// Source of the clock.
    pub clock: ClockSource,
    /// Revision of the silicon.
    pub revision: SiliconRevision,
    /// Brown-out level in the option bytes, 0 to 3; 0 is off.
    pub brown_out_level: u8,
    /// True while the supply is below [`FLASH_SUPPLY_MV`].
    pub supply_low: bool,
    /// Quick faults in succession.
    pub quick_faults: u8,
    /// True if nothing is played until the power is switched off and on or the reset button is pressed.
    pub safe_mode: bool,
    /// Stage in which a start hung until the watchdog ended it. If several starts hung since power-on, this is the
    /// stage of the last such start.
    pub hung_stage: Option<StartStage>,
}
