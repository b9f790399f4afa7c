//! Oscillators that do not start and PLLs that do not lock, which the emulator's clock controller lacks (chapter 8).
//!
//! | What | Section |
//! |---|---|
//! | HSE without a clock at its pin never becomes ready, nor does a crystal in bypass or a clock without | 8.5.1 |
//! | A PLL locks only with a reference of 1 to 16 MHz within the range of `PLLxRGE` | 8.5.5, 8.7.12 |
//! | and a VCO within 192 to 960 MHz (wide) or 150 to 420 MHz (medium, reference of 1 to 2 MHz) | 8.5.5, 8.7.13 |
//! | A failure of HSE under the clock security system is a non-maskable interrupt | 8.5.3 |
//!
//! A source that does not start is withheld from the emulator's model: the image reads its enable bit as written, but
//! the model sees the bit clear, so nothing runs on the source. On the part, a PLL outside its range may lock always or
//! at times; here it never does.
//!
//! Left out: a failing HSE without the clock security system, where the part's PLL runs away.
//!
//! Another wrapper drives LSI at TIM16's input: `TISEL` of 1 connects it to TI1 (RM0433, TIM16 timer input selection
//! register). The timer is the emulator's model.
//!
//! Edges are driven only while the timer counts and captures this input, because no other reader could see them. Left
//! out: LSI's jitter, and its enable, because the watchdog keeps it on.

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::soc::FieldSpec;
use rigless::soc::stm32h743::generated::rcc::{Register, cr, pll1divr, pll2divr, pll3divr, pllcfgr, pllckselr};
use rigless::soc::stm32h743::generated::tim16;
use rigless::soc::stm32h743::peripherals::rcc::Rcc;
use rigless::soc::stm32h743::peripherals::tim::{Channel, Tim, Tim16};
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};
use stylus_board::Board;

use super::around::{Around, Call};

/// Lowest and highest reference of the medium range, Hz.
const MEDIUM_REFERENCE_HZ: [u64; 2] = [1_000_000, 2_000_000];
/// Lowest and highest VCO frequency of the wide range and of the medium range, Hz.
const WIDE_VCO_HZ: [u64; 2] = [192_000_000, 960_000_000];
const MEDIUM_VCO_HZ: [u64; 2] = [150_000_000, 420_000_000];
/// Ranges of the reference that the codes of `PLLxRGE` select, Hz.
const REFERENCES_HZ: [[u64; 2]; 4] = [
    [1_000_000, 2_000_000],
    [2_000_000, 4_000_000],
    [4_000_000, 8_000_000],
    [8_000_000, 16_000_000],
];
const HSI_HZ: u64 = 64_000_000;
const CSI_HZ: u64 = 4_000_000;
/// Code of `PLLSRC` that selects HSE.
const SOURCE_HSE: u64 = 2;

/// Clocks of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Rate of the clock at HSE's pin, Hz, or `None` if there is no clock.
    pub external_hz: Option<u64>,
    /// True if that clock is a crystal.
    pub is_crystal: bool,
    /// PLLs that never lock on the external clock, PLL1 first.
    pub unlocked_external: [bool; 3],
    /// PLLs that never lock on an internal clock.
    pub unlocked_internal: [bool; 3],
    /// Deviation of HSI from 64 MHz, parts per million. Only USB is affected by it here.
    pub hsi_ppm: i64,
    /// Deviation of HSI48 from 48 MHz while it is not trimmed, parts per million. On the part it may reach 40 000 over
    /// the range of temperatures (DS12110, HSI48 oscillator characteristics).
    pub hsi48_ppm: i64,
}

impl Clocks {
    /// The clocks of `board`.
    pub fn of(board: &Board) -> Self {
        Self {
            external_hz: Some(board.clock.hz.into()),
            is_crystal: board.clock.is_crystal,
            unlocked_external: [false; 3],
            unlocked_internal: [false; 3],
            hsi_ppm: 5_000,
            hsi48_ppm: 5_000,
        }
    }
}

struct Fields {
    on: &'static FieldSpec,
    divm: &'static FieldSpec,
    range: &'static FieldSpec,
    medium: &'static FieldSpec,
    divn: &'static FieldSpec,
    dividers: Register,
}

const PLLS: [Fields; 3] = [
    Fields {
        on: cr::PLL1ON,
        divm: pllckselr::DIVM1,
        range: pllcfgr::PLL1RGE,
        medium: pllcfgr::PLL1VCOSEL,
        divn: pll1divr::DIVN1,
        dividers: Register::Pll1divr,
    },
    Fields {
        on: cr::PLL2ON,
        divm: pllckselr::DIVM2,
        range: pllcfgr::PLL2RGE,
        medium: pllcfgr::PLL2VCOSEL,
        divn: pll2divr::DIVN2,
        dividers: Register::Pll2divr,
    },
    Fields {
        on: cr::PLL3ON,
        divm: pllckselr::DIVM3,
        range: pllcfgr::PLL3RGE,
        medium: pllcfgr::PLL3VCOSEL,
        divn: pll3divr::DIVN3,
        dividers: Register::Pll3divr,
    },
];

/// The wrapper of the clock controller.
#[derive(Debug)]
pub struct Oscillators {
    /// Clocks of the run.
    pub clocks: Clocks,
    /// Enable bits of `CR` that the image reads as set and the model sees as clear.
    withheld: u64,
    changed: bool,
}

impl Oscillators {
    /// Creates a wrapper with these clocks.
    pub fn new(clocks: Clocks) -> Self {
        Self {
            clocks,
            withheld: 0,
            changed: true,
        }
    }

    /// Returns whether a clock may have changed since the last call.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    fn locks(&self, pll: usize, registers: &RegisterFile) -> bool {
        let selection = registers.get(Register::Pllckselr);
        let source = pllckselr::PLLSRC.get(selection);
        let (source_hz, refused) = match source {
            0 => (Some(HSI_HZ), self.clocks.unlocked_internal),
            1 => (Some(CSI_HZ), self.clocks.unlocked_internal),
            SOURCE_HSE => (self.clocks.external_hz, self.clocks.unlocked_external),
            _ => (None, [true; 3]),
        };
        let Fields {
            divm,
            range,
            medium,
            divn,
            dividers,
            ..
        } = &PLLS[pll];
        let (Some(source_hz), divided, false) = (source_hz, divm.get(selection), refused[pll]) else {
            return false;
        };
        if divided == 0 {
            return false;
        }
        let reference_hz = source_hz / divided;
        let vco_hz = reference_hz * (divn.get(registers.get(*dividers)) + 1);
        let configuration = registers.get(Register::Pllcfgr);
        let within = |[low, high]: [u64; 2], hz: u64| (low..=high).contains(&hz);
        // The wide range needs a reference above the medium one's (section 8.5.5).
        let vco = if medium.is_set(configuration) {
            within(MEDIUM_REFERENCE_HZ, reference_hz) && within(MEDIUM_VCO_HZ, vco_hz)
        } else {
            reference_hz > MEDIUM_REFERENCE_HZ[1] && within(WIDE_VCO_HZ, vco_hz)
        };
        within(REFERENCES_HZ[range.get(configuration) as usize], reference_hz) && vco
    }
}

impl Around<Rcc> for Oscillators {
    fn before_write(&mut self, register: Register, _value: u64, registers: &mut RegisterFile) {
        if register != Register::Cr {
            return;
        }
        let written = registers.get(Register::Cr);
        self.withheld = 0;
        let is_wrong = cr::HSEBYP.is_set(written) == self.clocks.is_crystal;
        if cr::HSEON.is_set(written) && (is_wrong || self.clocks.external_hz.is_none()) {
            self.withheld |= cr::HSEON.mask();
        }
        for (pll, fields) in PLLS.iter().enumerate() {
            if fields.on.is_set(written) && !self.locks(pll, registers) {
                self.withheld |= fields.on.mask();
            }
        }
        registers.set(Register::Cr, written & !self.withheld);
    }

    fn answer(&mut self, register: Register, value: u64, _registers: &RegisterFile) -> Option<u64> {
        (register == Register::Cr && self.withheld != 0).then_some(value | self.withheld)
    }

    fn after(&mut self, _inner: &mut Rcc, _call: &mut Call<'_, '_>) {
        self.changed = true;
    }

    fn reset(&mut self) {
        self.withheld = 0;
        self.changed = true;
    }
}

/// Value of `TISEL` that selects LSI.
const SELECTION: u8 = 1;
const CHANNEL_1: Channel = Channel::new(1).expect("every timer has it");
/// DS12110 table 136: the typical rate.
const TYPICAL_HZ: u64 = 32_000;

/// The oscillator at the timer's input.
#[derive(Debug)]
pub struct LowSpeedInput {
    hz: Option<u64>,
    /// Instant from which the edges are counted, number of the next edge, and the next edge's event.
    next: Option<(u64, u64, EventId)>,
}

impl Default for LowSpeedInput {
    fn default() -> Self {
        Self {
            hz: Some(TYPICAL_HZ),
            next: None,
        }
    }
}

impl LowSpeedInput {
    /// Sets the oscillator's rate, Hz; `None` stops the oscillator.
    pub fn set_hz(&mut self, hz: Option<u64>) {
        self.hz = hz;
    }

    fn is_seen(registers: &RegisterFile) -> bool {
        registers.get(tim16::Register::Tim16Tisel) & 0xF == u64::from(SELECTION)
            && tim16::ccer::CC1E.is_set(registers.get(tim16::Register::Ccer))
            && tim16::cr1::CEN.is_set(registers.get(tim16::Register::Cr1))
    }

    fn schedule(&mut self, began: u64, edge: u64, context: &mut DeviceContext<'_>) {
        self.next = self.hz.map(|hz| {
            // Counted from the first edge, so that the rounding to nanoseconds does not add up.
            let at = began + edge * NANOS_PER_SECOND / (2 * hz);
            (began, edge, context.schedule(VirtualNanos(at)))
        });
    }
}

impl Around<Tim<Tim16>> for LowSpeedInput {
    fn event(&mut self, inner: &mut Tim<Tim16>, event: EventId, call: &mut Call<'_, '_>) {
        if let Some((began, edge, _)) = self.next.take_if(|(_, _, asked)| *asked == event)
            && Self::is_seen(call.registers)
        {
            let level = Level::from(edge % 2 != 0);
            inner.drive_input_source(CHANNEL_1, SELECTION, level, call.registers, call.context);
            self.schedule(began, edge + 1, call.context);
        }
    }

    fn after(&mut self, _inner: &mut Tim<Tim16>, call: &mut Call<'_, '_>) {
        if self.next.is_none() && Self::is_seen(call.registers) {
            self.schedule(call.context.now().0, 1, call.context);
        }
    }

    fn reset(&mut self) {
        self.next = None;
    }
}
