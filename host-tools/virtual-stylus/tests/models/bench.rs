//! The part without a core: a test writes and reads registers one by one, at given instants.

use rigless::emulator::{Error, Memory};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::time::VirtualNanos;
use stylus_board::ALL;
use virtual_stylus::electrical::{Defects, Electrical};
use virtual_stylus::model::flash::{Busy, Unreadable};
use virtual_stylus::part::Part;
use virtual_stylus::sensors::ConstantPins;

pub const RCC: u64 = 0x5802_4400;
pub const AHB1ENR: u64 = RCC + 0xD8;

/// Memory in which every access fails.
pub struct NoMemory;

impl Memory for NoMemory {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        Err(Error::Memory { address, width })
    }

    fn write(&mut self, address: u64, width: Width, _value: u64) -> Result<(), Error> {
        Err(Error::Memory { address, width })
    }
}

/// The part at an instant.
pub struct EmulatedPart {
    pub part: Part,
    pub now: VirtualNanos,
}

impl EmulatedPart {
    /// A part with all clocks off.
    pub fn new(electrical: Electrical) -> Self {
        let part = Part::new(
            &ALL[0],
            Box::new(ConstantPins::default()),
            electrical,
            Unreadable::default(),
            Busy::default(),
            Defects::default(),
        );
        let mut bench = Self {
            part: part.expect("the models fit the part"),
            now: VirtualNanos(0),
        };
        bench.part.rest.set_supply(3300);
        bench
    }

    pub fn write(&mut self, address: u64, value: u64) {
        self.part
            .write(self.now, address, Width::W32, value)
            .expect("the register is there");
        self.settle();
    }

    pub fn read(&mut self, address: u64) -> u64 {
        self.part
            .read(self.now, address, Width::W32)
            .expect("the register is there")
    }

    /// Advances to the next event, or to `until`.
    pub fn step(&mut self, until: VirtualNanos) {
        let next = self.part.next_event().unwrap_or(until);
        self.now = next.min(until);
        self.part.advance_to(self.now);
        self.settle();
    }

    pub fn wait(&mut self, nanos: u64) {
        let until = VirtualNanos(self.now.0 + nanos);
        while self.now < until {
            self.step(until);
        }
    }

    fn settle(&mut self) {
        (self.part.settle(&mut NoMemory)).expect("no model uses memory");
    }
}
