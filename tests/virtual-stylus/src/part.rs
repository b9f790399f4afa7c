//! The part: the emulator's STM32H743 with the board's models in place of, or around, six of its own.
//!
//! A reset of the part leaves RAM, the backup SRAM, the flash and the reset flags of `RCC_RSR` as they were, as section
//! 8.4.4 and table 56 have it; only a power cut, which ends the run, loses RAM.

use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::peripherals::adc::{Adc, Converter};
use rigless::soc::stm32h743::peripherals::flash::Flash;
use rigless::soc::stm32h743::peripherals::tim::{BASIC_TIMERS, Basic, General, TIMERS, Tim};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::model::adc::{Injected, Pins};
use crate::model::around::Extended;
use crate::model::dac::Dac;
use crate::model::encoder::Quadrature;
use crate::model::flash::{Journal, Unreadable};
use crate::model::trigger::TriggerOutput;
use crate::model::watchdog::Watchdog;

/// TIM6 among the basic timers, and TIM3 among the general ones.
const TIM6: usize = 0;
const TIM3: usize = 1;

#[derive(Clone, Copy, Debug)]
struct Slots {
    dac: usize,
    adc: usize,
    timer: usize,
    encoder: usize,
    flash: usize,
    watchdog: usize,
}

/// The part.
#[derive(Debug)]
pub struct Part {
    /// All that the emulator models.
    pub rest: Stm32h743,
    /// DAC1.
    pub dac: Dac,
    /// ADC1.
    pub adc: Extended<Adc, Injected>,
    /// TIM6, the clock of the samples.
    pub timer: Extended<Tim<Basic>, TriggerOutput>,
    /// TIM3, which counts the encoder.
    pub encoder: Extended<Tim<General>, Quadrature>,
    /// The flash's registers.
    pub flash: Extended<Flash, Journal>,
    /// IWDG1.
    pub watchdog: Watchdog,
    slots: Slots,
}

impl Part {
    /// The part as the power comes on, with `pins` at its converter.
    ///
    /// # Errors
    /// The emulator's description of the part does not fit the models.
    pub fn new(pins: Box<dyn Pins>, unreadable: Unreadable) -> Result<Self, Error> {
        let rest = Stm32h743::new()?;
        let slot = |name| rest.bus().slot(name);
        let slots = Slots {
            dac: slot("DAC")?,
            adc: slot("ADC1")?,
            timer: slot("TIM6")?,
            encoder: slot("TIM3")?,
            flash: slot("Flash")?,
            watchdog: slot("IWDG")?,
        };
        Ok(Self {
            rest,
            dac: Dac::default(),
            adc: Extended::new(Adc::new(Converter::Adc1, 0), Injected::new(pins)),
            timer: Extended::new(Tim::new(BASIC_TIMERS[TIM6]), TriggerOutput::default()),
            encoder: Extended::new(Tim::new(TIMERS[TIM3]), Quadrature::default()),
            flash: Extended::new(Flash::new(), Journal::new(unreadable)),
            watchdog: Watchdog::default(),
            slots,
        })
    }

    /// Hands each pulse of the timer's trigger output to the converters, at its instant.
    fn deliver_triggers(&mut self) {
        while let Some(at) = self.timer.around.take() {
            let bus = self.rest.bus_mut();
            let (registers, _) = bus.drive(at, self.slots.dac);
            self.dac.trigger(at, registers);
            let (registers, mut context) = bus.drive(at, self.slots.adc);
            self.adc.around.trigger(registers, &mut context);
        }
    }
}

impl Mcu for Part {
    fn bus(&self) -> &Bus {
        self.rest.bus()
    }

    /// The runner asks for this after every call of a model and before anything else happens, so a trigger is heard at
    /// its own instant.
    fn bus_mut(&mut self) -> &mut Bus {
        self.deliver_triggers();
        self.rest.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.rest.reset(at, cause);
        self.dac.part_reset(at);
        Device::reset(&mut self.adc);
        self.timer.inner = Tim::new(BASIC_TIMERS[TIM6]);
        self.timer.around = TriggerOutput::default();
        self.encoder.inner = Tim::new(TIMERS[TIM3]);
        Device::reset(&mut self.encoder);
        let options = self.flash.inner.committed_options();
        Device::reset(&mut self.flash);
        self.flash.inner = Flash::new();
        let registers = self
            .rest
            .bus_mut()
            .slot_mut(self.slots.flash)
            .registers_mut();
        self.flash.inner.keep_options(options, registers);
        Device::reset(&mut self.watchdog);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.poll_every_model(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let own: &mut dyn ErasedDevice = match slot {
            _ if slot == self.slots.dac => &mut self.dac,
            _ if slot == self.slots.adc => &mut self.adc,
            _ if slot == self.slots.timer => &mut self.timer,
            _ if slot == self.slots.encoder => &mut self.encoder,
            _ if slot == self.slots.flash => &mut self.flash,
            _ if slot == self.slots.watchdog => &mut self.watchdog,
            _ => return self.rest.split(slot),
        };
        (self.rest.bus_mut(), Some(own))
    }
}
