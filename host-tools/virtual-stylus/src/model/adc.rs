//! The injected sequence of the analogue-to-digital converter ADC1 (chapter 25), around the emulator's model of the
//! rest of it: clock, regulator, calibration, enable, regular sequence.
//!
//! | What | Section |
//! |---|---|
//! | `JSQR`: length `JL`, channels `JSQ1` to `JSQ4`, trigger `JEXTSEL`, its edge `JEXTEN` | 25.4.19, 25.6.16 |
//! | `JADSTART` without an edge: one sequence at once, then clear | 25.4.14, 25.4.19, 25.6.3 |
//! | `JADSTART` with an edge: one sequence per trigger of TIM6 (14), until `JADSTP` | 25.4.14, 25.4.19, 25.6.3 |
//! | A trigger during a sequence is lost | 25.4.20 |
//! | A conversion takes the channel's sampling time (`SMPR1`, `SMPR2`) and half a cycle | 25.4.13, 25.4.17, 25.4.23 |
//! | and half a cycle per bit | as above |
//! | The pin is sampled as the sampling time ends; the word is its code at the resolution `RES` | 25.4.17, 25.4.23 |
//! | `JDR1` to `JDR4`, `JEOC` at each word and clear on reading one, `JEOS` after the last | 25.4.24, 25.6.1, 25.6.18 |
//! | `JEOC` and `JEOS` are cleared by a written one | 25.6.1 |
//! | Revisions Z and Y: the clock is not halved, and there is no `LDORDY` | 25.4.3, 25.6.1 |
//! | The converter's interrupt on `JEOC` and `JEOS` | 25.5 |
//!
//! Left out: the two to three cycles from a trigger to the start, which are constant for one clock setting, and their
//! jitter with an asynchronous clock; the queue of contexts (`JQDIS` clear, `JQM`, `JQOVF`): `JSQR` counts as written;
//! `JAUTO`, `JDISCEN`, oversampling (`JOVSE`), offsets (`OFRy`), differential channels, analogue watchdogs, dual mode,
//! and the interruption of a regular sequence by an injected one. The run's report says so if the image asks for
//! another trigger, `JAUTO`, `JDISCEN`, `JOVSE`, `OFRy` or dual mode.

use std::fmt::Debug;

use rigless::device::{Level, RegisterFile};
use rigless::soc::stm32h743::generated::adc3::{Register, cfgr, cfgr2, cr, ier, isr, jsqr};
use rigless::soc::stm32h743::peripherals::adc::Adc;
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

use super::around::{Around, Call};
use super::dac::Output;
use crate::electrical::OldConverter;

/// Section 25.4.19, table of injected triggers: TIM6's trigger output.
const TIM6_TRIGGER: u64 = 14;
/// The sampling times of section 25.4.13 in half cycles: 1.5, 2.5, 8.5, 16.5, 32.5, 64.5, 387.5 and 810.5.
const SAMPLING_HALF_CYCLES: [u64; 8] = [3, 5, 17, 33, 65, 129, 775, 1621];
/// Index of the converter's interrupt among the interrupts of its instance.
const INTERRUPT: usize = 0;
const RESULTS: [Register; 4] = [Register::Jdr1, Register::Jdr2, Register::Jdr3, Register::Jdr4];

const WITHOUT_ENABLE: &str = "RM0433 25.6.3: JADSTART may be set only with ADEN set, so no sequence started";
const WITHOUT_CLOCK: &str = "RM0433 25.4.3: the converter has no clock, so no sequence ends";
const OTHER_TRIGGER: &str =
    "RM0433 25.4.19: of the injected triggers only TIM6's (14) is modelled, so no sequence starts";
const OTHER_MODE: &str = "RM0433 25.4.20, 25.4.21: JAUTO and JDISCEN are not modelled, so a sequence runs whole";
const OVERSAMPLING: &str = "RM0433 25.4.31: JOVSE is not modelled, so a word is one conversion's";
const OFFSETS: &str = "RM0433 25.4.27: OFRy is not modelled, so a word is not reduced";

/// Signals on the pins of the converter.
pub trait Pins: Send + Debug {
    /// The 16-bit code of `channel` at `at_ns` of virtual time. Full scale is the reference voltage.
    fn code(&mut self, channel: u8, at_ns: u64) -> u16;

    /// Called with each new `output` of the digital-to-analogue converter, and whether the amplifier is enabled.
    fn follow(&mut self, _output: Output, _enabled: bool) {}
}

/// One sampled pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// End of the sampling time, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The channel.
    pub channel: u8,
    /// Index of the sample in the sequence, 0 to 3.
    pub rank: u8,
    /// The word that was written to the data register.
    pub word: u16,
}

/// A sequence under way.
#[derive(Debug)]
struct Sequence {
    /// Start of the present conversion, in half cycles after `began`.
    half_cycles: u64,
    began: VirtualNanos,
    rank: usize,
    event: EventId,
}

/// The injected sequence.
#[derive(Debug)]
pub struct Injected {
    pins: Box<dyn Pins>,
    /// Inputs at pins that something on the board drives. A sensor there cannot be read. The model keeps the line at
    /// its low level; on a real board it also changes.
    driven: &'static [u8],
    hz: u64,
    /// True while `JADSTART` is set.
    started: bool,
    sequence: Option<Sequence>,
    flags: u64,
    raised: bool,
    samples: Option<Vec<Sample>>,
    silicon: OldConverter,
    followed: Option<Output>,
}

impl Injected {
    /// Creates the sequence, which converts `pins`, but for the inputs `driven` by something on the board.
    pub fn new(pins: Box<dyn Pins>, driven: &'static [u8]) -> Self {
        Self {
            pins,
            driven,
            hz: 0,
            started: false,
            sequence: None,
            flags: 0,
            raised: false,
            samples: None,
            silicon: OldConverter::default(),
            followed: None,
        }
    }

    /// Reports a new output to the pins.
    pub fn follow(&mut self, output: Option<Output>, enabled: bool) {
        if let Some(output) = output.filter(|_| output != self.followed) {
            self.pins.follow(output, enabled);
            self.followed = Some(output);
        }
    }

    /// Gives the converter the differences of `silicon`. To be called before its clock runs.
    pub fn set_silicon(&mut self, silicon: OldConverter) {
        self.silicon = silicon;
    }

    /// Changes the signals on the pins.
    pub fn set_pins(&mut self, pins: Box<dyn Pins>) {
        self.pins = pins;
    }

    /// Keeps every sample from now on.
    pub fn record_samples(&mut self) {
        self.samples.get_or_insert_default();
    }

    /// Returns the samples kept so far, and clears them.
    pub fn take_samples(&mut self) -> Vec<Sample> {
        self.samples.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Handles TIM6's trigger.
    pub fn trigger(&mut self, call: &mut Call<'_, '_>) {
        let setting = call.registers.get(Register::Jsqr);
        if !self.started || jsqr::JEXTEN.get(setting) == 0 || jsqr::JEXTSEL.get(setting) != TIM6_TRIGGER {
            return;
        }
        // A trigger during a sequence is lost.
        if self.sequence.is_none() {
            self.begin(call);
        }
    }

    /// Half cycles from the start of a conversion of `channel` to the end of its sampling, and to the end of the
    /// conversion.
    fn durations(channel: u64, registers: &RegisterFile) -> (u64, u64) {
        let (register, place) = match channel {
            0..10 => (Register::Smpr1, channel),
            _ => (Register::Smpr2, channel - 10),
        };
        let sampling = SAMPLING_HALF_CYCLES[(registers.get(register) >> (3 * place) & 0b111) as usize];
        (sampling, sampling + 1 + resolution(registers))
    }

    fn instant(&self, began: VirtualNanos, half_cycles: u64) -> VirtualNanos {
        let nanos = u128::from(half_cycles) * u128::from(NANOS_PER_SECOND) / u128::from(2 * self.hz);
        VirtualNanos(began.0 + nanos as u64)
    }

    fn begin(&mut self, call: &mut Call<'_, '_>) {
        if self.hz == 0 {
            call.context.tell("JSQR", WITHOUT_CLOCK);
            return;
        }
        self.schedule(call.context.now(), 0, 0, call);
    }

    fn schedule(
        &mut self,
        began: VirtualNanos,
        half_cycles: u64,
        rank: usize,
        Call { registers, context }: &mut Call<'_, '_>,
    ) {
        let (_, whole) = Self::durations(channel_at(rank, registers), registers);
        let event = context.schedule(self.instant(began, half_cycles + whole));
        self.sequence = Some(Sequence {
            half_cycles,
            began,
            rank,
            event,
        });
    }

    /// Handles the end of the conversion under way.
    fn converted(&mut self, done: &Sequence, call: &mut Call<'_, '_>) {
        let registers = &mut *call.registers;
        let channel = channel_at(done.rank, registers);
        let (sampling, whole) = Self::durations(channel, registers);
        let sampled = self.instant(done.began, done.half_cycles + sampling);
        let code = if self.driven.contains(&(channel as u8)) {
            0
        } else {
            self.pins.code(channel as u8, sampled.0)
        };
        let word = code >> (16 - resolution(registers));
        registers.set(RESULTS[done.rank], u64::from(word));
        if let Some(samples) = &mut self.samples {
            samples.push(Sample {
                at_ns: sampled.0,
                channel: channel as u8,
                rank: done.rank as u8,
                word,
            });
        }
        self.flags |= isr::JEOC.mask();
        let setting = registers.get(Register::Jsqr);
        if (done.rank as u64) < jsqr::JL.get(setting) {
            // Counted from the sequence's begin, so that the rounding to nanoseconds does not add up.
            self.schedule(done.began, done.half_cycles + whole, done.rank + 1, call);
            return;
        }
        self.flags |= isr::JEOS.mask();
        if jsqr::JEXTEN.get(setting) == 0 {
            self.started = false;
        }
    }

    fn command(&mut self, written: u64, call: &mut Call<'_, '_>) {
        if cr::JADSTP.is_set(written) || cr::ADDIS.is_set(written) {
            self.started = false;
            self.sequence = None;
        }
        if !cr::JADSTART.is_set(written) || cr::JADSTP.is_set(written) || self.started {
            return;
        }
        if !cr::ADEN.is_set(call.registers.get(Register::Cr)) {
            call.context.tell("CR", WITHOUT_ENABLE);
            return;
        }
        tell_what_is_left_out(call);
        self.started = true;
        if jsqr::JEXTEN.get(call.registers.get(Register::Jsqr)) == 0 {
            self.begin(call);
        }
    }

    /// Asserts the interrupt if this wrapper or the emulator's model does.
    fn refresh_interrupt(&mut self, Call { registers, context }: &mut Call<'_, '_>) {
        let enabled = registers.get(Register::Ier);
        let wanted = self.flags & enabled & (ier::JEOCIE.mask() | ier::JEOSIE.mask()) != 0;
        // The emulator's model drives the same line, and only when its own flags change.
        if wanted || self.raised {
            let others = registers.get(Register::Isr) & enabled & !injected_flags() != 0;
            context.interrupt(INTERRUPT, Level::from(wanted || others));
        }
        self.raised = wanted;
    }
}

impl Around<Adc> for Injected {
    fn before_write(&mut self, register: Register, value: u64, registers: &mut RegisterFile) {
        match register {
            // The emulator's model reports each of the two commands as not modelled, and clears it.
            Register::Cr => {
                let others = registers.get(Register::Cr) & !(cr::JADSTART.mask() | cr::JADSTP.mask());
                registers.set(Register::Cr, others);
            }
            Register::Isr => self.flags &= !value,
            _ => {}
        }
    }

    fn after_write(&mut self, register: Register, value: u64, call: &mut Call<'_, '_>) {
        if register == Register::Cr {
            self.command(value, call);
        }
    }

    fn answer(&mut self, register: Register, value: u64, _registers: &RegisterFile) -> Option<u64> {
        if RESULTS.contains(&register) {
            self.flags &= !isr::JEOC.mask();
        }
        let flags = || self.silicon.flags(value) & !injected_flags() | self.flags;
        (register == Register::Isr).then(flags)
    }

    fn event(&mut self, _inner: &mut Adc, event: EventId, call: &mut Call<'_, '_>) {
        // Without a clock the conversion does not end.
        if let Some(done) = self.sequence.take_if(|sequence| sequence.event == event)
            && self.hz != 0
        {
            self.converted(&done, call);
        }
    }

    fn clock(&mut self, hz: u64) -> u64 {
        self.hz = self.silicon.hz(hz);
        self.hz
    }

    fn after(&mut self, _inner: &mut Adc, call: &mut Call<'_, '_>) {
        let others = call.registers.get(Register::Cr) & !(cr::JADSTART.mask() | cr::JADSTP.mask());
        // The image reads `JADSTART` as set while a sequence runs or waits for its trigger (25.6.3).
        let control = cr::JADSTART.set(others, u64::from(self.started));
        call.registers.set(Register::Cr, control);
        self.refresh_interrupt(call);
    }

    fn reset(&mut self) {
        self.started = false;
        self.sequence = None;
        self.flags = 0;
        self.raised = false;
    }
}

const fn injected_flags() -> u64 {
    isr::JEOC.mask() | isr::JEOS.mask() | isr::JQOVF.mask()
}

/// The resolution in bits that `RES` selects on revision V (25.6.4); the reserved code counts as 16.
fn resolution(registers: &RegisterFile) -> u64 {
    match cfgr::RES.get(registers.get(Register::Cfgr)) {
        0b001 | 0b101 => 14,
        0b010 | 0b110 => 12,
        0b011 => 10,
        0b111 => 8,
        _ => 16,
    }
}

fn channel_at(rank: usize, registers: &RegisterFile) -> u64 {
    [jsqr::JSQ1, jsqr::JSQ2, jsqr::JSQ3, jsqr::JSQ4][rank].get(registers.get(Register::Jsqr))
}

fn tell_what_is_left_out(Call { registers, context }: &mut Call<'_, '_>) {
    let setting = registers.get(Register::Jsqr);
    if jsqr::JEXTEN.get(setting) != 0 && jsqr::JEXTSEL.get(setting) != TIM6_TRIGGER {
        context.tell("JSQR", OTHER_TRIGGER);
    }
    let control = registers.get(Register::Cfgr);
    if cfgr::JAUTO.is_set(control) || cfgr::JDISCEN.is_set(control) {
        context.tell("CFGR", OTHER_MODE);
    }
    if cfgr2::JOVSE.is_set(registers.get(Register::Cfgr2)) {
        context.tell("CFGR2", OVERSAMPLING);
    }
    let offsets = [Register::Ofr1, Register::Ofr2, Register::Ofr3, Register::Ofr4];
    // The offset itself, without the channel that it is for.
    if offsets.iter().any(|&offset| registers.get(offset) & 0x03FF_FFFF != 0) {
        context.tell("OFR1", OFFSETS);
    }
}
