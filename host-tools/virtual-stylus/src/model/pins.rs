//! The two pins of the output: its voltage at ADC2, and the amplifier's enable.
//!
//! **The voltage**, [`ReadBack`]: PA4 is both DAC1's first output and INP18 of ADC1 and ADC2 (DS12110, pin
//! definitions). ADC2 itself is the emulator's model. The wrapper here supplies the voltage at the instant of sampling,
//! with the properties and faults of the [`OutputPin`].
//!
//! | What | Section |
//! |---|---|
//! | The pin is sampled as the sampling time ends: half a cycle and half a cycle per bit before the word | 25.4.17 |
//! | The buffered output approaches a new code exponentially; a full step is half a code away after 3.6 µs | 26.4.3 |
//! | A pin that nothing drives floats | |
//!
//! Left out: channels other than 18, which read zero, and the load of the sampling capacitor.
//!
//! **The enable**, [`PinRecord`]: it wraps the emulator's model of the pin's port, and records every change of the
//! [`Drive`], which is what the part does to the pin (chapter 11).
//!
//! A pin floats until the image makes it an output: after every reset all pins of the ports C to K are analogue
//! (section 11.4.1). The level at which the board holds a floating pin is not modelled.

use std::collections::VecDeque;

use rigless::device::RegisterFile;
use rigless::soc::stm32h743::generated::adc3::{Register, sqr1};
use rigless::soc::stm32h743::generated::gpioa;
use rigless::soc::stm32h743::peripherals::adc::Adc;
use rigless::soc::stm32h743::peripherals::gpio::Gpio;
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

use super::around::{Around, Call};
use super::dac::Output;
use crate::chance::Chance;
use crate::electrical::OldConverter;

/// Channel of PA4.
const CHANNEL: u64 = 18;
/// Number of outputs that are kept, many times the number during one conversion.
const REMEMBERED: usize = 32;
/// ADC codes of 16 bits per DAC code of 12 bits.
const WORDS_PER_CODE: f64 = 16.0;
/// Half cycles from the end of sampling to the word, at 16 bits.
const SUCCESSIVE_HALF_CYCLES: u64 = 17;
/// Level that is read at a pin that nothing drives, words.
const FLOATING: f64 = 21_000.0;

/// Properties of the pin and of the circuit at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputPin {
    /// Factor from the ideal to the actual voltage.
    pub gain: f64,
    /// Offset, in codes of 12 bits.
    pub offset: f64,
    /// Bits of the code that the DAC always treats as zero.
    pub stuck_low: u16,
    /// Noise, words RMS.
    pub noise: f64,
    /// Time constant of the step response, ns.
    pub settling_ns: f64,
    /// True if the DAC does not reach the pin.
    pub disconnected: bool,
}

impl Default for OutputPin {
    /// A healthy pin: its gain is slightly below one, and it has a small offset.
    fn default() -> Self {
        Self {
            gain: 0.998,
            offset: 2.0,
            stuck_low: 0,
            noise: 8.0,
            settling_ns: 400.0,
            disconnected: false,
        }
    }
}

/// The pin, as ADC2 sees it.
#[derive(Debug, Default)]
pub struct ReadBack {
    /// The pin.
    pub pin: OutputPin,
    outputs: VecDeque<Output>,
    hz: u64,
    word: u16,
    chance: Chance,
    silicon: OldConverter,
}

impl ReadBack {
    /// Gives the converter the differences of `silicon`. To be called before its clock runs.
    pub fn set_silicon(&mut self, silicon: OldConverter) {
        self.silicon = silicon;
    }

    /// Notes the latest output of the DAC.
    pub fn follow(&mut self, latest: Option<Output>) {
        if latest == self.outputs.back().copied() {
            return;
        }
        self.outputs.extend(latest);
        while self.outputs.len() > REMEMBERED {
            self.outputs.pop_front();
        }
    }

    /// Level to which the DAC settles with `code`, in words of 16 bits.
    fn level(&self, code: Option<u16>) -> f64 {
        match code {
            Some(code) if !self.pin.disconnected => {
                let taken = f64::from(code & !self.pin.stuck_low);
                (taken * self.pin.gain + self.pin.offset) * WORDS_PER_CODE
            }
            _ => FLOATING,
        }
    }

    /// Level at `at_ns`, words.
    fn level_at(&self, at_ns: u64) -> f64 {
        // The outputs that are no longer remembered would change nothing: they are many time constants old.
        let mut level = self.level(None);
        let mut since = 0;
        let mut aim = level;
        for output in self.outputs.iter().filter(|output| output.at_ns <= at_ns) {
            level = self.approached(level, aim, output.at_ns - since);
            (aim, since) = (self.level(output.code), output.at_ns);
        }
        self.approached(level, aim, at_ns - since)
    }

    fn approached(&self, from: f64, to: f64, nanos: u64) -> f64 {
        to + (from - to) * (-(nanos as f64) / self.pin.settling_ns).exp()
    }

    /// Noise of unit variance: the sum of twelve uniform numbers from 0 to 1, minus 6.
    fn noise(&mut self) -> f64 {
        (0..12).map(|_| self.chance.fraction()).sum::<f64>() - 6.0
    }
}

impl Around<Adc> for ReadBack {
    fn event(&mut self, _inner: &mut Adc, _event: EventId, call: &mut Call<'_, '_>) {
        if self.hz != 0 && sqr1::SQ1.get(call.registers.get(Register::Sqr1)) == CHANNEL {
            let since = SUCCESSIVE_HALF_CYCLES * NANOS_PER_SECOND / (2 * self.hz);
            let level = self.level_at(call.context.now().0.saturating_sub(since));
            let noise = self.noise() * self.pin.noise;
            self.word = (level + noise).round().clamp(0.0, 65_535.0) as u16;
        }
    }

    fn answer(&mut self, register: Register, value: u64, registers: &RegisterFile) -> Option<u64> {
        let is_of_pin = sqr1::SQ1.get(registers.get(Register::Sqr1)) == CHANNEL;
        match register {
            Register::Dr if is_of_pin => Some(self.word.into()),
            Register::Isr => Some(self.silicon.flags(value)),
            _ => None,
        }
    }

    fn clock(&mut self, hz: u64) -> u64 {
        self.hz = self.silicon.hz(hz);
        self.hz
    }
}

/// What the part does to a pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// The part drives nothing: the pin is an input, analogue, an alternate function, or an open drain that is off.
    #[default]
    Floating,
    /// The part drives the pin low.
    Low,
    /// The part drives the pin high.
    High,
}

/// The drive of a pin from one instant on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Driven {
    /// The instant, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The drive.
    pub drive: Drive,
}

/// Every change of the drive of one pin.
#[derive(Debug)]
pub struct PinRecord {
    pin: u32,
    drive: Drive,
    record: Vec<Driven>,
}

impl PinRecord {
    /// Creates the record of the pin with this number in its port. The pin floats at first.
    pub fn new(pin: u32) -> Self {
        Self {
            pin,
            drive: Drive::Floating,
            record: Vec::new(),
        }
    }

    /// The drive now.
    pub fn drive(&self) -> Drive {
        self.drive
    }

    /// Returns the changes of the drive since the last call, or since the run began.
    pub fn take_record(&mut self) -> Vec<Driven> {
        std::mem::take(&mut self.record)
    }

    /// Handles a reset of the part at `at`, which lets the pin float.
    pub fn part_reset(&mut self, at: VirtualNanos) {
        self.keep(at, Drive::Floating);
    }

    fn keep(&mut self, at: VirtualNanos, drive: Drive) {
        if drive != self.drive {
            self.drive = drive;
            self.record.push(Driven { at_ns: at.0, drive });
        }
    }

    fn of_registers(&self, registers: &RegisterFile) -> Drive {
        /// Code of `MODER` for a general-purpose output.
        const OUTPUT: u64 = 0b01;
        let bit = |register| registers.get(register) >> self.pin & 1 != 0;
        let mode = registers.get(gpioa::Register::Moder) >> (2 * self.pin) & 0b11;
        match (mode, bit(gpioa::Register::Odr), bit(gpioa::Register::Otyper)) {
            (OUTPUT, false, _) => Drive::Low,
            (OUTPUT, true, false) => Drive::High,
            _ => Drive::Floating,
        }
    }
}

impl Around<Gpio> for PinRecord {
    fn after(&mut self, _inner: &mut Gpio, call: &mut Call<'_, '_>) {
        let drive = self.of_registers(call.registers);
        self.keep(call.context.now(), drive);
    }
}
