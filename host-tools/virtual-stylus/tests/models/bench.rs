//! What the tests run: the part without a core, whose registers a test writes and reads one by one at given instants,
//! and the probe image, with which a test exchanges commands and answers.

use std::path::PathBuf;

use rigless::emulator::{Error, Memory};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::time::VirtualNanos;
use stylus_board::ALL;
use virtual_stylus::electrical::{Defects, Electrical};
use virtual_stylus::model::flash::{Busy, Unreadable};
use virtual_stylus::part::Part;
use virtual_stylus::sensors::ConstantPins;
use virtual_stylus::{Options, VirtualStylus};

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

pub const TICK_NS: u64 = 200_000;
pub const MILLISECOND_NS: u64 = 1_000_000;
/// Time within which the image is ready for commands, ns.
pub const READY_NS: u64 = 20 * MILLISECOND_NS;

/// The image that `cargo tasks test-virtual-stylus` has built.
fn image() -> PathBuf {
    std::env::var_os("VIRTUAL_STYLUS_PROBE_IMAGE")
        .expect("set VIRTUAL_STYLUS_PROBE_IMAGE, as `cargo tasks test-virtual-stylus` does")
        .into()
}

pub fn start(options: Options) -> VirtualStylus {
    VirtualStylus::new(&image(), options).expect("the image fits the part")
}

pub fn ready(options: Options) -> VirtualStylus {
    let mut stylus = start(options);
    stylus.run_until(READY_NS);
    stylus
}

/// Sends a command and waits for `expected` bytes, at most ten seconds of virtual time.
pub fn ask(stylus: &mut VirtualStylus, command: u8, expected: usize) -> Vec<u8> {
    let mut answer = Vec::new();
    stylus.send(&[command]);
    let until = stylus.now_ns() + 10_000 * MILLISECOND_NS;
    let answered = stylus.run_until_true(until, TICK_NS / 2, |stylus| {
        answer.extend(stylus.receive().iter().map(|sent| sent.byte));
        answer.len() >= expected
    });
    assert!(answered, "{:?} was answered with {answer:?}", char::from(command));
    answer
}

pub fn words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}
