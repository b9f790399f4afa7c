//! The part: the emulator's STM32H743 with the board's models in place of, or around, eight of its own.
//!
//! A reset of the part leaves RAM, the backup SRAM, the flash and the reset flags of `RCC_RSR` as they were, as in
//! section 8.4.4 and table 56; only a power cut, which ends the run, loses RAM.

use rigless::device::{Device, DeviceContext, ErasedDevice, RegisterFile, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::otg1_hs_global;
use rigless::soc::stm32h743::peripherals::adc::{Adc, Converter};
use rigless::soc::stm32h743::peripherals::flash::Flash;
use rigless::soc::stm32h743::peripherals::gpio::Gpio;
use rigless::soc::stm32h743::peripherals::tim::{BASIC_TIMERS, Basic, General, TIMERS, Tim};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::model::adc::{Injected, Pins};
use crate::model::around::Extended;
use crate::model::dac::{Dac, TIM6_TRIGGER, TIM7_TRIGGER};
use crate::model::encoder::Quadrature;
use crate::model::flash::{Journal, Unreadable};
use crate::model::pin::PinRecord;
use crate::model::trigger::TriggerOutput;
use crate::model::usb::host::Host;
use crate::model::usb::{self, Usb};
use crate::model::watchdog::Watchdog;

/// TIM6 and TIM7 among the basic timers, and TIM3 among the general ones.
const TIM6: usize = 0;
const TIM7: usize = 1;
const TIM3: usize = 1;
/// The amplifier's enable in port E.
const AMPLIFIER_PIN: u32 = 9;

#[derive(Clone, Copy, Debug)]
struct Slots {
    dac: usize,
    adc: usize,
    timer: usize,
    code_timer: usize,
    amplifier: usize,
    encoder: usize,
    flash: usize,
    watchdog: usize,
    usb: usize,
    usb_reset: usize,
}

/// Observer of a reset of the USB core by the clock controller, of which the core's window is not told.
#[derive(Debug, Default)]
struct UsbReset {
    asked: bool,
}

impl Device for UsbReset {
    type Register = otg1_hs_global::Register;

    fn reset_line(&mut self, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
        self.asked = true;
    }
}

/// The part.
#[derive(Debug)]
pub struct Part {
    /// The emulator's own models.
    pub rest: Stm32h743,
    /// DAC1.
    pub dac: Dac,
    /// ADC1.
    pub adc: Extended<Adc, Injected>,
    /// TIM6, the clock of the samples.
    pub timer: Extended<Tim<Basic>, TriggerOutput>,
    /// TIM7, the clock of the codes at the output.
    pub code_timer: Extended<Tim<Basic>, TriggerOutput>,
    /// Port E, with the amplifier's enable on PE9.
    pub amplifier: Extended<Gpio, PinRecord>,
    /// TIM3, which counts the encoder.
    pub encoder: Extended<Tim<General>, Quadrature>,
    /// The flash's registers.
    pub flash: Extended<Flash, Journal>,
    /// IWDG1.
    pub watchdog: Watchdog,
    /// The USB core, and the host at the other end of the cable.
    pub usb: Usb,
    usb_reset: UsbReset,
    slots: Slots,
}

impl Part {
    /// The part as the power comes on, with `pins` at its converter.
    ///
    /// # Errors
    /// The emulator's description of the part does not fit the models.
    pub fn new(pins: Box<dyn Pins>, unreadable: Unreadable) -> Result<Self, Error> {
        let mut rest = Stm32h743::new()?;
        let usb_slot = rest.bus_mut().add_window(usb::window())?;
        let layout = rest.bus().slots()[usb_slot].peripheral().registers;
        let slot = |name| rest.bus().slot(name);
        let slots = Slots {
            dac: slot("DAC")?,
            adc: slot("ADC1")?,
            timer: slot("TIM6")?,
            code_timer: slot("TIM7")?,
            amplifier: slot("GPIOE")?,
            encoder: slot("TIM3")?,
            flash: slot("Flash")?,
            watchdog: slot("IWDG")?,
            usb: usb_slot,
            usb_reset: slot(usb::GLOBAL)?,
        };
        Ok(Self {
            rest,
            dac: Dac::default(),
            adc: Extended::new(Adc::new(Converter::Adc1, 0), Injected::new(pins)),
            timer: Extended::new(Tim::new(BASIC_TIMERS[TIM6]), TriggerOutput::default()),
            code_timer: Extended::new(Tim::new(BASIC_TIMERS[TIM7]), TriggerOutput::default()),
            amplifier: Extended::new(Gpio::default(), PinRecord::new(AMPLIFIER_PIN)),
            encoder: Extended::new(Tim::new(TIMERS[TIM3]), Quadrature::default()),
            flash: Extended::new(Flash::new(), Journal::new(unreadable)),
            watchdog: Watchdog::default(),
            usb: Usb::new(layout),
            usb_reset: UsbReset::default(),
            slots,
        })
    }

    /// Has `work` done at `at` by the software of the host on USB.
    pub fn drive_usb<T>(&mut self, at: VirtualNanos, work: impl FnOnce(&mut Host, u64) -> T) -> T {
        let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.usb);
        self.usb.drive(&mut context, work)
    }

    /// Hands each pulse of the timers' trigger outputs to the converters, at its instant, and the acknowledge of a
    /// request to the one that asked.
    fn deliver_triggers(&mut self) {
        while let Some(at) = self.timer.around.take() {
            let bus = self.rest.bus_mut();
            let (registers, mut context) = bus.drive(at, self.slots.dac);
            self.dac.trigger(TIM6_TRIGGER, registers, &mut context);
            let (registers, mut context) = bus.drive(at, self.slots.adc);
            self.adc.around.trigger(registers, &mut context);
        }
        while let Some(at) = self.code_timer.around.take() {
            let (registers, mut context) = self.rest.bus_mut().drive(at, self.slots.dac);
            self.dac.trigger(TIM7_TRIGGER, registers, &mut context);
        }
        if let Some((at, channel)) = self.code_timer.around.take_acknowledge() {
            let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.dac);
            self.dac.acknowledge(channel, &mut context);
        }
    }
}

impl Mcu for Part {
    fn bus(&self) -> &Bus {
        self.rest.bus()
    }

    /// The runner calls this after every call of a model and before anything else happens, so a trigger takes effect at
    /// its own instant.
    fn bus_mut(&mut self) -> &mut Bus {
        if std::mem::take(&mut self.usb_reset.asked) {
            self.usb.core_reset();
        }
        self.deliver_triggers();
        self.rest.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.rest.reset(at, cause);
        self.dac.part_reset(at);
        Device::reset(&mut self.adc);
        self.timer.inner = Tim::new(BASIC_TIMERS[TIM6]);
        self.timer.around = TriggerOutput::default();
        self.code_timer.inner = Tim::new(BASIC_TIMERS[TIM7]);
        self.code_timer.around = TriggerOutput::default();
        Device::reset(&mut self.amplifier);
        self.amplifier.around.part_reset(at);
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
        self.usb_reset = UsbReset::default();
        let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.usb);
        self.usb.part_reset(&mut context);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.poll_every_model(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let own: &mut dyn ErasedDevice = match slot {
            _ if slot == self.slots.dac => &mut self.dac,
            _ if slot == self.slots.adc => &mut self.adc,
            _ if slot == self.slots.timer => &mut self.timer,
            _ if slot == self.slots.code_timer => &mut self.code_timer,
            _ if slot == self.slots.amplifier => &mut self.amplifier,
            _ if slot == self.slots.encoder => &mut self.encoder,
            _ if slot == self.slots.flash => &mut self.flash,
            _ if slot == self.slots.watchdog => &mut self.watchdog,
            _ if slot == self.slots.usb => &mut self.usb,
            _ if slot == self.slots.usb_reset => &mut self.usb_reset,
            _ => return self.rest.split(slot),
        };
        (self.rest.bus_mut(), Some(own))
    }
}
