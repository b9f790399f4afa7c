//! The digital-to-analogue converter DAC1 (chapter 26).
//!
//! | What | Section |
//! |---|---|
//! | `CR`: `ENx`, `TENx`, `TSELx` of four bits, for both channels | 26.4.5, 26.7.1 |
//! | `TSELx` does not change while `ENx` is set | 26.4.7, note |
//! | `DHR12Rx` load the holding registers | 26.4.4, 26.7.3, 26.7.6 |
//! | `TENx` clear: a holding register goes to `DORx` as it is written, even before the channel is enabled | 26.4.6 |
//! | `TENx` cleared: what the holding register has taken meanwhile goes to `DORx` | 26.4.6 |
//! | `TENx` set: it goes at the trigger of `TSELx`: TIM6 (5), TIM7 (6) | 26.4.7, table 217 |
//! | `DMAENx`: a trigger raises the channel's request; its acknowledge lowers it | 26.4.8 |
//! | A trigger before the acknowledge sets `DMAUDRx`: no request until a one is written to clear it | 26.4.8, 26.7.14 |
//! | `DORx`, read only | 26.7.12, 26.7.13 |
//! | `MCR`: a mode without the pin drives no pin; `CCR` and the sample-and-hold registers keep their bits | 26.7.16 |
//! | The registers are accessed by words; any other access is in the run's report | 26.7 |
//! | A reset clears all of it, and nothing drives the pin | 8.4.4 |
//!
//! The emulator's description does not pass the acknowledges of the request multiplexer to this instance, but it does
//! to TIM7. So the wrapper of TIM7 receives them and passes them on (`trigger.rs`).
//!
//! Left out: the two or three cycles of the bus clock between a trigger or write and `DORx` (constant, 30 ns at most at
//! 100 MHz), settling and the buffer, the other triggers and holding registers, waves (`WAVEx`), calibration (`CENx`),
//! the interrupt on an underrun (`DMAUDRIEx`), and the timing of sample and hold. The run's report says so (`told`) if
//! the image asks for another holding register, a trigger by software, waves, calibration or the interrupt.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::dac::Register;
use rigless::soc::{Layout, Width};
use rigless::time::VirtualNanos;

/// Table 217: the selection of TIM6's trigger output.
pub const TIM6_TRIGGER: u64 = 5;
/// Table 217: the selection of TIM7's trigger output.
pub const TIM7_TRIGGER: u64 = 6;
const CHANNELS: usize = 2;
const CODE: u64 = 0xFFF;
/// The bits of channel 1 in `CR` and `SR`; those of channel 2 are 16 higher.
const ENABLE: u64 = 1;
const TRIGGER_ENABLE: u64 = 1 << 1;
const SELECTION: u64 = 0xF << 2;
const DMA_ENABLE: u64 = 1 << 12;
const UNDERRUN: u64 = 1 << 13;

const WAVES: &str = "RM0433 26.4.10: WAVEx is not modelled, so DHRx goes to DORx as it is";
const LOCKED: &str = "RM0433 26.4.7: TSELx cannot be changed while ENx is set, so it stays";
const NARROW: &str = "RM0433 26.7: the registers have to be accessed by words";
const LEFT_OUT: &str = "RM0433 26.7: of the registers of codes, DHR12Rx alone are modelled, and no trigger by software";
const INTERRUPT: &str = "RM0433 26.6: DMAUDRIEx is not modelled, so an underrun is no interrupt";
const CALIBRATION: &str = "RM0433 26.4.13: CENx is not modelled, so nothing is calibrated";

/// Cause of a change of the output, or of a code that was latched again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The trigger of a timer.
    Trigger,
    /// A holding register was written while the trigger was off, or the trigger was switched off after that.
    Write,
    /// The channel was enabled, or connected to its pin.
    Enabled,
    /// The channel was disabled, or disconnected from its pin.
    Disabled,
    /// The part was reset.
    Reset,
}

/// Output of channel 1 from one instant on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// The instant, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The code of 12 bits, or `None` if the pin is not driven.
    pub code: Option<u16>,
    /// The cause.
    pub cause: Cause,
}

/// The model.
#[derive(Debug, Default)]
pub struct Dac {
    control: u64,
    mode: u64,
    holding: [u16; CHANNELS],
    output: [u16; CHANNELS],
    /// True for each channel whose request waits for its acknowledge.
    requested: [bool; CHANNELS],
    /// `DMAUDRx`.
    underruns: u64,
    driven: bool,
    latest: Option<Output>,
    record: Vec<Output>,
}

impl Dac {
    /// Returns the outputs of channel 1 recorded so far, and clears them.
    pub fn take_record(&mut self) -> Vec<Output> {
        std::mem::take(&mut self.record)
    }

    /// The latest output of channel 1.
    pub fn latest(&self) -> Option<Output> {
        self.latest
    }

    /// The code that channel 1 now drives, or `None` if its pin is not driven.
    fn pin(&self) -> Option<u16> {
        self.driven.then_some(self.output[0])
    }

    /// Handles a timer's trigger, which `TSELx` selects by `selection`.
    pub fn trigger(&mut self, selection: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        for channel in 0..CHANNELS {
            if self.hears(channel, selection) {
                self.latch(context.now(), channel, Cause::Trigger, registers);
                self.request(channel, context);
            }
        }
    }

    /// Handles the acknowledge of `channel`'s request.
    pub fn acknowledge(&mut self, channel: usize, context: &mut DeviceContext<'_>) {
        if std::mem::take(&mut self.requested[channel]) {
            context.request(channel, Level::Low);
        }
    }

    /// Handles a reset of the part at `at`.
    pub fn part_reset(&mut self, at: VirtualNanos) {
        let was_driven = self.driven;
        self.control = 0;
        self.mode = 0;
        self.holding = [0; CHANNELS];
        self.output = [0; CHANNELS];
        self.requested = [false; CHANNELS];
        self.underruns = 0;
        self.driven = false;
        if was_driven {
            self.keep(at, Cause::Reset);
        }
    }

    fn triggered(&self, channel: usize) -> bool {
        self.has(channel, TRIGGER_ENABLE)
    }

    fn selection(&self, channel: usize) -> u64 {
        self.control >> (16 * channel + 2) & 0xF
    }

    /// Returns true if channel 1 drives its pin. Modes 3 and 7 keep the channel from its pin. Modes 4 to 7 are sample
    /// and hold, and modes 4 to 6 drive the pin (26.7.16).
    fn reaches_pin(&self) -> bool {
        self.has(0, ENABLE) && !matches!(self.mode & 0b111, 0b011 | 0b111)
    }

    /// Returns true if the trigger with this `selection` loads the channel's code.
    fn hears(&self, channel: usize, selection: u64) -> bool {
        self.has(channel, ENABLE) && self.triggered(channel) && self.selection(channel) == selection
    }

    fn has(&self, channel: usize, bit: u64) -> bool {
        self.control >> (16 * channel) & bit != 0
    }

    fn request(&mut self, channel: usize, context: &mut DeviceContext<'_>) {
        let underrun = UNDERRUN << (16 * channel);
        if !self.has(channel, DMA_ENABLE) || self.underruns & underrun != 0 {
            return;
        }
        // The code that this trigger has put out was not fetched in time: the last one was put out again.
        if self.requested[channel] {
            self.underruns |= underrun;
        } else {
            self.requested[channel] = true;
            context.request(channel, Level::High);
        }
    }

    fn latch(&mut self, at: VirtualNanos, channel: usize, cause: Cause, registers: &mut RegisterFile) {
        self.output[channel] = self.holding[channel];
        let register = [Register::Dor1, Register::Dor2][channel];
        registers.set(register, u64::from(self.output[channel]));
        if channel == 0 && self.driven {
            self.keep(at, cause);
        }
    }

    fn keep(&mut self, at: VirtualNanos, cause: Cause) {
        let output = Output {
            at_ns: at.0,
            code: self.pin(),
            cause,
        };
        self.latest = Some(output);
        self.record.push(output);
    }

    /// Handles a write of a holding register.
    fn hold(&mut self, at: VirtualNanos, channel: usize, code: u64, registers: &mut RegisterFile) {
        self.holding[channel] = (code & CODE) as u16;
        let register = [Register::Dhr12r1, Register::Dhr12r2][channel];
        registers.set(register, u64::from(self.holding[channel]));
        if !self.triggered(channel) {
            self.latch(at, channel, Cause::Write, registers);
        }
    }

    fn connect(&mut self, at: VirtualNanos) {
        let driven = self.reaches_pin();
        if driven != self.driven {
            self.driven = driven;
            let cause = [Cause::Disabled, Cause::Enabled][usize::from(driven)];
            self.keep(at, cause);
        }
    }

    fn write_control(&mut self, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        for (bits, reason) in [
            (0x00C0_00C0, WAVES),
            (0x4000_4000, CALIBRATION),
            (0x2000_2000, INTERRUPT),
        ] {
            if value & bits != 0 {
                context.tell("CR", reason);
            }
        }
        let mut landed = value;
        for channel in 0..CHANNELS {
            let kept = SELECTION << (16 * channel);
            if self.has(channel, ENABLE) && (value ^ self.control) & kept != 0 {
                context.tell("CR", LOCKED);
                landed = landed & !kept | self.control & kept;
            }
        }
        self.control = landed;
        // A channel without DMA requests nothing, so a request that waits is lowered.
        for channel in 0..CHANNELS {
            if !self.has(channel, DMA_ENABLE) {
                self.acknowledge(channel, context);
            }
        }
        self.connect(context.now());
        for channel in 0..CHANNELS {
            if !self.triggered(channel) && self.output[channel] != self.holding[channel] {
                self.latch(context.now(), channel, Cause::Write, registers);
            }
        }
    }
}

impl Device for Dac {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        // The vendor's description gives `TSELx` three bits, but on the part it has four.
        Some(match register {
            Register::Cr => self.control,
            Register::Sr => self.underruns,
            other => registers.get(other),
        })
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let at = context.now();
        if context.access_width() != Some(Width::W32) {
            context.tell(register.spec().name, NARROW);
        }
        match register {
            Register::Cr => self.write_control(value, registers, context),
            Register::Mcr => {
                self.mode = value;
                self.connect(at);
            }
            Register::Dhr12r1 => self.hold(at, 0, value, registers),
            Register::Dhr12r2 => self.hold(at, 1, value, registers),
            Register::Sr => self.underruns &= !value,
            // Read only, or of the calibration and of sample and hold, whose timing is left out.
            Register::Dor1
            | Register::Dor2
            | Register::Ccr
            | Register::Shsr1
            | Register::Shsr2
            | Register::Shhr
            | Register::Shrr => {}
            _ => context.tell("DHR", LEFT_OUT),
        }
    }
}
