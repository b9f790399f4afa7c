//! Level that the part drives at a pin of a port (chapter 11), around the emulator's model of the port.
//!
//! A pin floats until the image makes it an output: after every reset all pins of the ports C to K are analogue
//! (section 11.4.1). The level at which the board holds a floating pin is not modelled.

use rigless::device::RegisterFile;
use rigless::soc::stm32h743::generated::gpioa::Register;
use rigless::soc::stm32h743::peripherals::gpio::Gpio;
use rigless::time::VirtualNanos;

use super::around::{Around, Call};

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
        let mode = registers.get(Register::Moder) >> (2 * self.pin) & 0b11;
        match (mode, bit(Register::Odr), bit(Register::Otyper)) {
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
