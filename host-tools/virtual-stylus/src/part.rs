//! The microcontroller: the emulator's STM32H743, in which models of this board replace or wrap some of the emulator's.
//!
//! A reset keeps RAM, the backup SRAM, the flash and the flags in `RCC_RSR`, to which it adds those of its cause
//! (RM0433 section 8.4.4 and table 56). RAM is lost only when the power is cut.

use rigless::device::{Device, DeviceContext, ErasedDevice, Level, RegisterFile, ResetCause};
use rigless::mcu::Mcu;
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::{crs, dbgmcu, exti, flash, otg1_hs_global, pwr, ramecc1, rcc};
use rigless::soc::stm32h743::peripherals::adc::{Adc, Converter};
use rigless::soc::stm32h743::peripherals::flash::{Flash, OptionBytes};
use rigless::soc::stm32h743::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32h743::peripherals::rcc::{Kernel, Rcc};
use rigless::soc::stm32h743::peripherals::tim::{BASIC_TIMERS, Basic, General, TIMER_16, TIMERS, Tim, Tim16};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;
use stylus_board::Board;

use crate::electrical::{Defects, Electrical, Interrupt, OldConverter};
use crate::model::adc::{Injected, Pins};
use crate::model::around::{Around, Call, Extended};
use crate::model::dac::{Dac, TIM6_TRIGGER, TIM7_TRIGGER};
use crate::model::encoder::Quadrature;
use crate::model::flash::{Busy, Journal, Unreadable};
use crate::model::oscillators::{LowSpeedInput, Oscillators};
use crate::model::pins::{Drive, PinRecord, ReadBack};
use crate::model::trigger::TriggerOutput;
use crate::model::usb::host::Host;
use crate::model::usb::{self, Usb};
use crate::model::watchdog::Watchdog;

/// Indices of TIM6 and TIM7 among the basic timers, and of TIM3 among the general ones.
const TIM6: usize = 0;
const TIM7: usize = 1;
const TIM3: usize = 1;
/// Names of the ports that a board may use.
pub const PORTS: [&str; 5] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE"];
/// Names of serial ports without their numbers. Of the emulator's own models only theirs look outside at a stop.
const SERIAL_PORTS: [&str; 3] = ["USART", "UART", "LPUART"];

#[derive(Clone, Copy, Debug)]
struct Slots {
    dac: usize,
    adc: usize,
    read_back: usize,
    low_speed: usize,
    timer: usize,
    code_timer: usize,
    amplifier: usize,
    encoder: usize,
    flash: usize,
    watchdog: usize,
    usb: usize,
    usb_reset: usize,
    rcc: usize,
    crs: usize,
    debug: usize,
}

/// Observes a reset of the USB core by the clock controller, because the emulator does not report it to the core's
/// window.
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

/// Observes the trimming of HSI48, whose registers are in the register file.
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

fn registers(rest: &mut Stm32h743, slot: usize) -> &mut RegisterFile {
    rest.bus_mut().slot_mut(slot).registers_mut()
}

/// Clock of USB, Hz (section 57.4.2), and the code of `USBSEL` that selects HSI48 for it (section 8.7.20).
const USB_HZ: i64 = 48_000_000;
const USB_FROM_HSI48: u64 = 3;
/// Code of `PLLSRC` that selects HSI (section 8.7.11).
const PLLS_FROM_HSI: u64 = 0;
/// Code of `SYNCSRC` that selects the frames of USB2, which is the core OTG2 (CRS_CFGR; ST's driver calls it
/// RCC_CRS_SYNC_SOURCE_USB2).
const FRAMES_OF_USB2: u64 = 3;
/// EXTI's line of the voltage detector (table 153).
const DETECTOR_LINE: u64 = 1 << 16;
/// Deviation that stands for a clock that does not run, parts per million.
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
    /// ADC2, which reads the output's pin back.
    pub read_back: Extended<Adc, ReadBack>,
    /// TIM16, which measures LSI.
    pub low_speed: Extended<Tim<Tim16>, LowSpeedInput>,
    /// TIM6, the clock of the samples.
    pub timer: Extended<Tim<Basic>, TriggerOutput>,
    /// TIM7, the clock of the codes at the output.
    pub code_timer: Extended<Tim<Basic>, TriggerOutput>,
    /// The port with the amplifier's enable.
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
    /// The clock controller.
    pub rcc: Extended<Rcc, Oscillators>,
    trimming: Trimming,
    board: &'static Board,
    electrical: Electrical,
    defects: Defects,
    slots: Slots,
    /// Slots of the models that look outside at every stop: the serial ports, and those of this board whose wrapper
    /// acts then. Every other model would be asked for nothing, some hundred at each event.
    polled: Vec<usize>,
}

impl Part {
    /// The part on `board` as the power comes on, with `pins` at its converter. `defects` passes its defects to the
    /// core.
    pub fn new(
        board: &'static Board,
        pins: Box<dyn Pins>,
        electrical: Electrical,
        unreadable: Unreadable,
        busy: Busy,
        defects: Defects,
    ) -> Result<Self, Error> {
        let mut rest = Stm32h743::new()?;
        let usb_slot = rest.bus_mut().add_window(usb::window())?;
        let layout = rest.bus().slots()[usb_slot].peripheral().registers;
        let slot = |name| rest.bus().slot(name);
        let enable = board.pins.amplifier;
        let slots = Slots {
            dac: slot("DAC")?,
            adc: slot("ADC1")?,
            read_back: slot("ADC2")?,
            low_speed: slot("TIM16")?,
            timer: slot("TIM6")?,
            code_timer: slot("TIM7")?,
            amplifier: slot(PORTS[enable.port])?,
            encoder: slot("TIM3")?,
            flash: slot("Flash")?,
            watchdog: slot("IWDG")?,
            usb: usb_slot,
            usb_reset: slot(usb::GLOBAL)?,
            rcc: slot("RCC")?,
            crs: slot("CRS")?,
            debug: slot("DBGMCU")?,
        };
        let serial = rest
            .bus()
            .slots()
            .iter()
            .map(|slot| slot.peripheral().name)
            .enumerate()
            .filter(|(_, name)| SERIAL_PORTS.contains(&name.trim_end_matches(char::is_numeric)));
        let own = [
            slots.adc,
            slots.read_back,
            slots.low_speed,
            slots.timer,
            slots.code_timer,
            slots.amplifier,
        ];
        let polled = serial
            .map(|(slot, _)| slot)
            .chain(own)
            .chain([slots.encoder, slots.flash])
            .collect();
        let journal = Journal::new(unreadable, busy, electrical.brown_out_level);
        let mut part = Self {
            rest,
            dac: Dac::default(),
            adc: Extended::new(Adc::new(Converter::Adc1, 0), Injected::new(pins, board.driven)),
            read_back: Extended::new(Adc::new(Converter::Adc2, 0), ReadBack::default()),
            low_speed: Extended::new(Tim::new(TIMER_16), LowSpeedInput::default()),
            timer: Extended::new(Tim::new(BASIC_TIMERS[TIM6]), TriggerOutput::default()),
            code_timer: Extended::new(Tim::new(BASIC_TIMERS[TIM7]), TriggerOutput::default()),
            amplifier: Extended::new(Gpio::default(), PinRecord::new(enable.number as u32)),
            encoder: Extended::new(Tim::new(TIMERS[TIM3]), Quadrature::default()),
            flash: Extended::new(Flash::new(), journal),
            watchdog: Watchdog::default(),
            usb: Usb::new(layout),
            usb_reset: UsbReset::default(),
            rcc: Extended::new(Rcc::new(), Oscillators::new(electrical.clocks)),
            trimming: Trimming::default(),
            board,
            electrical,
            defects,
            slots,
            polled,
        };
        part.show_revision();
        Ok(part)
    }

    /// Puts the revision into DBGMCU_IDC, above the device's identifier, and gives the converters that revision's
    /// differences.
    fn show_revision(&mut self) {
        let registers = registers(&mut self.rest, self.slots.debug);
        let device = registers.get(dbgmcu::Register::Idc) & 0xFFFF;
        let revision = u64::from(self.electrical.revision) << 16;
        registers.set(dbgmcu::Register::Idc, revision | device);
        let silicon = OldConverter::of(self.electrical.revision);
        self.adc.around.set_silicon(silicon);
        self.read_back.around.set_silicon(silicon);
    }

    /// Stops the external clock at `at`. If the clock security system watches it, its interrupt follows.
    pub fn fail_external_clock(&mut self, at: VirtualNanos) {
        self.rcc.around.clocks.external_hz = None;
        let (registers, mut context) = self.rest.bus_mut().drive(at, self.slots.rcc);
        self.rcc.inner.fail_hse(registers, &mut context);
        if rcc::cifr::HSECSSF.is_set(registers.get(rcc::Register::Cifr)) {
            self.defects.interrupt(Interrupt::NonMaskable);
        }
    }

    /// Makes the internal oscillators deviate from now on, in parts per million. Only USB is affected by it here.
    pub fn drift(&mut self, hsi_ppm: i64, hsi48_ppm: i64) {
        let clocks = &mut self.electrical.clocks;
        (clocks.hsi_ppm, clocks.hsi48_ppm) = (hsi_ppm, hsi48_ppm);
        let deviation = self.usb_clock_ppm();
        self.usb.host.set_clock_deviation(deviation);
    }

    /// Deviation of the clock of USB from 48 MHz, parts per million.
    fn usb_clock_ppm(&self) -> i64 {
        let slots = self.rest.bus().slots();
        let clocks = slots[self.slots.rcc].registers();
        let hz = self.rcc.inner.kernel_clock(clocks, Kernel::Usb) as i64;
        if hz == 0 {
            return NO_CLOCK_PPM;
        }
        // What the dividers and the external clock make of it; the deviations of internal oscillators are added below.
        let set = (hz - USB_HZ) * 1_000_000 / USB_HZ;
        let source = rcc::d2ccip2r::USBSEL.get(clocks.get(rcc::Register::D2ccip2r));
        let reference = rcc::pllckselr::PLLSRC.get(clocks.get(rcc::Register::Pllckselr));
        let trimming = slots[self.slots.crs].registers();
        let control = trimming.get(crs::Register::Cr);
        let follows = crs::cfgr::SYNCSRC.get(trimming.get(crs::Register::Cfgr)) == FRAMES_OF_USB2;
        let is_trimmed = crs::cr::CEN.is_set(control) && crs::cr::AUTOTRIMEN.is_set(control) && follows;
        let of_source = match (source, reference) {
            (USB_FROM_HSI48, _) if is_trimmed => 0,
            (USB_FROM_HSI48, _) => self.electrical.clocks.hsi48_ppm,
            (_, PLLS_FROM_HSI) => self.electrical.clocks.hsi_ppm,
            _ => 0,
        };
        set + of_source
    }

    /// Programs option bytes, as a debug probe does before the power comes on.
    pub fn set_option_bytes(&mut self, change: impl FnOnce(&mut OptionBytes)) {
        let mut options = self.flash.inner.committed_options();
        change(&mut options);
        let registers = registers(&mut self.rest, self.slots.flash);
        self.flash.inner.keep_options(options, registers);
    }

    /// Sets the part's revision: `REV_ID` of `DBGMCU_IDC` (section 60.5.8).
    pub fn set_revision(&mut self, revision: u16) {
        self.electrical.revision = revision;
        self.show_revision();
    }

    /// Presses the button, which pulls its pin up, or releases it. Panics if a port has no such pin.
    pub fn press_button(&mut self, at: VirtualNanos, pressed: bool) {
        let level = pressed.then_some(Level::High);
        let button = self.board.pins.button;
        let pin = Pin::new(button.number as u8).expect("a port has 16 pins");
        self.rest.drive_port(at, button.port, |gpio, registers, context| {
            gpio.drive(pin, level, registers, context);
        });
    }

    /// Sets the supply. If it falls below the detector's level, EXTI's line 16 rises (sections 6.5.3 and 20.3), and the
    /// core is interrupted if the image has enabled that. Panics if the emulator's part lacks EXTI or PWR.
    pub fn set_supply(&mut self, millivolts: u32) {
        let before = self.is_supply_low();
        self.rest.set_supply(millivolts);
        let slot = self.rest.bus().slot("EXTI").expect("the part has one");
        let lines = self.rest.bus().slots()[slot].registers();
        let is_watched = [exti::Register::Rtsr1, exti::Register::Cpuimr1]
            .iter()
            .all(|&register| lines.get(register) & DETECTOR_LINE != 0);
        if !before && self.is_supply_low() && is_watched {
            self.defects.interrupt(Interrupt::Supply);
        }
    }

    fn is_supply_low(&self) -> bool {
        let slot = self.rest.bus().slot("PWR").expect("the part has one");
        let registers = self.rest.bus().slots()[slot].registers();
        pwr::csr1::PVDO.is_set(registers.get(pwr::Register::Csr1))
    }

    /// Stops the watchdog and the output's timer while the core is halted, as a debugger does: `DBGMCU_APB4FZ1` and
    /// `DBGMCU_APB1LFZ1` (section 60.5.8).
    pub fn freeze_in_halt(&mut self) {
        let slot = self.rest.bus_mut().slot_mut(self.slots.debug);
        let registers = slot.registers_mut();
        registers.set(dbgmcu::Register::Apb4fz1, dbgmcu::apb4fz1::DBG_IWDG1.mask());
        registers.set(dbgmcu::Register::Apb1lfz1, dbgmcu::apb1lfz1::DBG_TIM7.mask());
    }

    /// Turns off the core's clocks for debugging, as probe-rs does when it detaches: `DBGMCU_CR` (section 60.5.8).
    pub fn detach_debugger(&mut self) {
        registers(&mut self.rest, self.slots.debug).set(dbgmcu::Register::Cr, 0);
    }

    /// Protects these sectors of bank 1 from writing, one bit per sector, and no others of that bank (section 4.5.2).
    pub fn protect_sectors(&mut self, sectors: u8) {
        let options = self.flash.inner.committed_options();
        // In FLASH_WPSN a zero protects its sector.
        let wpsn = [u64::from(!sectors), options.wpsn[1]];
        let registers = registers(&mut self.rest, self.slots.flash);
        let options = OptionBytes { wpsn, ..options };
        self.flash.inner.keep_options(options, registers);
    }

    /// Returns true if any peripheral of APB1L, APB2 or APB4 stops while the core is halted.
    pub fn is_frozen_in_halt(&self) -> bool {
        use dbgmcu::Register::{Apb1lfz1, Apb2fz1, Apb4fz1};
        let registers = self.rest.bus().slots()[self.slots.debug].registers();
        [Apb1lfz1, Apb2fz1, Apb4fz1]
            .iter()
            .any(|&register| registers.get(register) != 0)
    }

    /// Makes AXI SRAM's monitor report an error. In `flags`, bit 0 is a corrected error, and bit 1 an uncorrected one
    /// (section 3.4, RAMECC_M1SR).
    pub fn find_ram_error(&mut self, flags: u64) -> Result<(), Error> {
        let slot = self.rest.bus().slot("RAMECC1")?;
        registers(&mut self.rest, slot).set(ramecc1::Register::M1sr, flags);
        Ok(())
    }

    /// Makes a read of bank 1 report a corrected error: `SNECCERR1` (section 4.9.5).
    pub fn correct_flash_error(&mut self) {
        let registers = registers(&mut self.rest, self.slots.flash);
        let flags = registers.get(flash::Register::Sr1);
        registers.set(flash::Register::Sr1, flash::sr1::SNECCERR.set(flags, 1));
    }

    /// Makes the software of the host on USB do `work` at `at`.
    pub fn drive_usb<T>(&mut self, at: VirtualNanos, work: impl FnOnce(&mut Host, u64) -> T) -> T {
        let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.usb);
        self.usb.drive(&mut context, work)
    }

    /// Passes each pulse of the timers' trigger outputs to the converters at its instant, and each acknowledge to the
    /// DAC.
    fn deliver_triggers(&mut self) {
        while let Some(at) = self.timer.around.take() {
            let bus = self.rest.bus_mut();
            let (registers, mut context) = bus.drive(at, self.slots.dac);
            self.dac.trigger(TIM6_TRIGGER, registers, &mut context);
            let (registers, mut context) = bus.drive(at, self.slots.adc);
            let context = &mut context;
            let mut call = Call { registers, context };
            self.adc.around.trigger(&mut call);
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
        // Not `||`: both must be taken, or the second would be found at the next call.
        if self.rcc.around.take_changed() | std::mem::take(&mut self.trimming.changed) {
            self.usb.host.set_clock_deviation(self.usb_clock_ppm());
        }
        self.read_back.around.follow(self.dac.latest());
        let enabled = self.amplifier.around.drive() == Drive::High;
        self.adc.around.follow(self.dac.latest(), enabled);
        self.rest.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        // The emulator's part resets its clock controller to what a reset keeps.
        std::mem::swap(&mut self.rest.rcc, &mut self.rcc.inner);
        self.rest.reset(at, cause);
        std::mem::swap(&mut self.rest.rcc, &mut self.rcc.inner);
        Around::reset(&mut self.rcc.around);
        // The reset has put the emulator's own revision into the register.
        self.show_revision();
        self.dac.part_reset(at);
        Device::reset(&mut self.adc);
        Device::reset(&mut self.read_back);
        self.low_speed.inner = Tim::new(TIMER_16);
        Device::reset(&mut self.low_speed);
        self.timer.inner = Tim::new(BASIC_TIMERS[TIM6]);
        self.timer.around = TriggerOutput::default();
        self.code_timer.inner = Tim::new(BASIC_TIMERS[TIM7]);
        self.code_timer.around = TriggerOutput::default();
        Device::reset(&mut self.amplifier);
        self.amplifier.around.part_reset(at);
        self.encoder.inner = Tim::new(TIMERS[TIM3]);
        Device::reset(&mut self.encoder);
        // Option bytes outlive the reset, but not the model that holds them.
        let options = self.flash.inner.committed_options();
        Device::reset(&mut self.flash);
        self.flash.inner = Flash::new();
        let registers = registers(&mut self.rest, self.slots.flash);
        self.flash.inner.keep_options(options, registers);
        Device::reset(&mut self.watchdog);
        self.usb_reset = UsbReset::default();
        let (_, mut context) = self.rest.bus_mut().drive(at, self.slots.usb);
        self.usb.part_reset(&mut context);
    }

    fn poll(&mut self, now: VirtualNanos) {
        for index in 0..self.polled.len() {
            let slot = self.polled[index];
            if let (bus, Some(model)) = self.split(slot) {
                let (registers, mut context) = bus.drive(now, slot);
                model.poll(registers, &mut context);
            }
        }
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let own: &mut dyn ErasedDevice = match slot {
            _ if slot == self.slots.dac => &mut self.dac,
            _ if slot == self.slots.adc => &mut self.adc,
            _ if slot == self.slots.read_back => &mut self.read_back,
            _ if slot == self.slots.low_speed => &mut self.low_speed,
            _ if slot == self.slots.timer => &mut self.timer,
            _ if slot == self.slots.code_timer => &mut self.code_timer,
            _ if slot == self.slots.amplifier => &mut self.amplifier,
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
