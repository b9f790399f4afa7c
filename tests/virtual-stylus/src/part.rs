//! The part: the emulator's STM32H743 with the board's models in place of, or around, seven of its own.
//!
//! A reset of the part leaves RAM, the backup SRAM, the flash and the reset flags of `RCC_RSR` as they were, as in
//! section 8.4.4 and table 56; only a power cut, which ends the run, loses RAM.

use rigless::device::{Device, DeviceContext, ErasedDevice, RegisterFile, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::{crs, dbgmcu, otg1_hs_global, rcc};
use rigless::soc::stm32h743::peripherals::adc::{Adc, Converter};
use rigless::soc::stm32h743::peripherals::flash::Flash;
use rigless::soc::stm32h743::peripherals::rcc::{Kernel, Rcc};
use rigless::soc::stm32h743::peripherals::tim::{BASIC_TIMERS, Basic, General, TIMERS, Tim};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::electrical::{Defects, Electrical};
use crate::model::adc::{Injected, Pins};
use crate::model::around::{Around, Extended};
use crate::model::dac::Dac;
use crate::model::encoder::Quadrature;
use crate::model::flash::{Journal, Unreadable};
use crate::model::oscillators::Oscillators;
use crate::model::trigger::TriggerOutput;
use crate::model::usb::host::Host;
use crate::model::usb::{self, Usb};
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
    usb: usize,
    usb_reset: usize,
    rcc: usize,
    crs: usize,
    debug: usize,
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

/// Observer of the trimming of HSI48, whose registers are the register file's.
#[derive(Debug, Default)]
struct Trimming {
    changed: bool,
}

impl Device for Trimming {
    type Register = crs::Register;

    fn write(
        &mut self,
        _register: crs::Register,
        _value: u64,
        _registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
        self.changed = true;
    }
}

/// Clock of USB, Hz (section 57.4.2), and the code of `USBSEL` that takes it from HSI48 (section 8.7.20).
const USB_HZ: i64 = 48_000_000;
const USB_FROM_HSI48: u64 = 3;
/// Code of `PLLSRC` for HSI (section 8.7.11).
const PLLS_FROM_HSI: u64 = 0;
/// Code of `SYNCSRC` for the frames of USB2, which is the core OTG2 (CRS_CFGR; ST's driver calls it
/// RCC_CRS_SYNC_SOURCE_USB2).
const FRAMES_OF_USB2: u64 = 3;
/// Deviation of a clock that does not run.
const NO_CLOCK_PPM: i64 = 1_000_000;

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
    /// TIM3, which counts the encoder.
    pub encoder: Extended<Tim<General>, Quadrature>,
    /// The flash's registers.
    pub flash: Extended<Flash, Journal>,
    /// IWDG1.
    pub watchdog: Watchdog,
    /// The USB core, and the host at the other end of the cable.
    pub usb: Usb,
    usb_reset: UsbReset,
    /// The clock controller.
    pub rcc: Extended<Rcc, Oscillators>,
    trimming: Trimming,
    electrical: Electrical,
    defects: Defects,
    slots: Slots,
}

impl Part {
    /// The part as the power comes on, with `pins` at its converter; `defects` are told to the core.
    ///
    /// # Errors
    /// The emulator's description of the part does not fit the models.
    pub fn new(
        pins: Box<dyn Pins>,
        electrical: Electrical,
        unreadable: Unreadable,
        defects: Defects,
    ) -> Result<Self, Error> {
        let mut rest = Stm32h743::new()?;
        let usb_slot = rest.bus_mut().add_window(usb::window())?;
        let layout = rest.bus().slots()[usb_slot].peripheral().registers;
        let slot = |name| rest.bus().slot(name);
        let slots = Slots {
            dac: slot("DAC")?,
            adc: slot("ADC1")?,
            timer: slot("TIM6")?,
            encoder: slot("TIM3")?,
            flash: slot("Flash")?,
            watchdog: slot("IWDG")?,
            usb: usb_slot,
            usb_reset: slot(usb::GLOBAL)?,
            rcc: slot("RCC")?,
            crs: slot("CRS")?,
            debug: slot("DBGMCU")?,
        };
        let journal = Journal::new(unreadable, electrical.brown_out_level);
        let mut part = Self {
            rest,
            dac: Dac::default(),
            adc: Extended::new(Adc::new(Converter::Adc1, 0), Injected::new(pins)),
            timer: Extended::new(Tim::new(BASIC_TIMERS[TIM6]), TriggerOutput::default()),
            encoder: Extended::new(Tim::new(TIMERS[TIM3]), Quadrature::default()),
            flash: Extended::new(Flash::new(), journal),
            watchdog: Watchdog::default(),
            usb: Usb::new(layout),
            usb_reset: UsbReset::default(),
            rcc: Extended::new(Rcc::new(), Oscillators::new(electrical.clocks)),
            trimming: Trimming::default(),
            electrical,
            defects,
            slots,
        };
        part.show_revision();
        Ok(part)
    }

    /// Puts the revision into DBGMCU_IDC, above the device's identifier.
    fn show_revision(&mut self) {
        let registers = self
            .rest
            .bus_mut()
            .slot_mut(self.slots.debug)
            .registers_mut();
        let device = registers.get(dbgmcu::Register::Idc) & 0xFFFF;
        let revision = u64::from(self.electrical.revision) << 16;
        registers.set(dbgmcu::Register::Idc, revision | device);
    }

    /// Stops the external clock at `at`. If the clock security system watches it, its interrupt follows.
    pub fn fail_external_clock(&mut self, at: VirtualNanos) {
        self.rcc.around.clocks.external_hz = None;
        let (registers, mut context) = self.rest.bus_mut().drive(at, self.slots.rcc);
        self.rcc.inner.fail_hse(registers, &mut context);
        if rcc::cifr::HSECSSF.is_set(registers.get(rcc::Register::Cifr)) {
            self.defects.interrupt();
        }
    }

    /// Deviation of the clock of USB from 48 MHz, parts per million.
    fn usb_clock_ppm(&self) -> i64 {
        let slots = self.rest.bus().slots();
        let clocks = slots[self.slots.rcc].registers();
        let hz = self.rcc.inner.kernel_clock(clocks, Kernel::Usb) as i64;
        if hz == 0 {
            return NO_CLOCK_PPM;
        }
        let set = (hz - USB_HZ) * 1_000_000 / USB_HZ;
        let source = rcc::d2ccip2r::USBSEL.get(clocks.get(rcc::Register::D2ccip2r));
        let reference = rcc::pllckselr::PLLSRC.get(clocks.get(rcc::Register::Pllckselr));
        let trimming = slots[self.slots.crs].registers();
        let control = trimming.get(crs::Register::Cr);
        let follows = crs::cfgr::SYNCSRC.get(trimming.get(crs::Register::Cfgr)) == FRAMES_OF_USB2;
        let is_trimmed =
            crs::cr::CEN.is_set(control) && crs::cr::AUTOTRIMEN.is_set(control) && follows;
        let of_source = match (source, reference) {
            (USB_FROM_HSI48, _) if is_trimmed => 0,
            (USB_FROM_HSI48, _) => self.electrical.clocks.hsi48_ppm,
            (_, PLLS_FROM_HSI) => self.electrical.clocks.hsi_ppm,
            _ => 0,
        };
        set + of_source
    }

    /// Has `work` done at `at` by the software of the host on USB.
    pub fn drive_usb<T>(&mut self, at: VirtualNanos, work: impl FnOnce(&mut Host, u64) -> T) -> T {
        let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.usb);
        self.usb.drive(&mut context, work)
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

    /// The runner calls this after every call of a model and before anything else happens, so a trigger takes effect at
    /// its own instant.
    fn bus_mut(&mut self) -> &mut Bus {
        if std::mem::take(&mut self.usb_reset.asked) {
            self.usb.core_reset();
        }
        self.deliver_triggers();
        if self.rcc.around.take_changed() | std::mem::take(&mut self.trimming.changed) {
            self.usb.host.set_clock_deviation(self.usb_clock_ppm());
        }
        self.rest.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        // The emulator's part resets the clock controller by what is kept over a reset.
        std::mem::swap(&mut self.rest.rcc, &mut self.rcc.inner);
        self.rest.reset(at, cause);
        std::mem::swap(&mut self.rest.rcc, &mut self.rcc.inner);
        Around::reset(&mut self.rcc.around);
        self.show_revision();
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
            _ if slot == self.slots.encoder => &mut self.encoder,
            _ if slot == self.slots.flash => &mut self.flash,
            _ if slot == self.slots.watchdog => &mut self.watchdog,
            _ if slot == self.slots.usb => &mut self.usb,
            _ if slot == self.slots.usb_reset => &mut self.usb_reset,
            _ if slot == self.slots.rcc => &mut self.rcc,
            _ if slot == self.slots.crs => &mut self.trimming,
            _ => return self.rest.split(slot),
        };
        (self.rest.bus_mut(), Some(own))
    }
}
