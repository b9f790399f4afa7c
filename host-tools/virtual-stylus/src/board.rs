//! The board: the part, its crystals, its rail, and the far end of the serial line.
//!
//! The far end of the serial line, in this process. Bytes for the image arrive from the instant at which the run
//! continues. Bytes from the image are kept with their instants. The host's clock has no influence, so a run repeats
//! exactly.

use std::collections::VecDeque;
use std::num::NonZeroU64;
use std::path::Path;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::image::Image;
use rigless::machine::stm32h743_bench::Stm32h743Bench;
use rigless::machine::{Board, Target};
use rigless::mcu::Mcu;
use rigless::snapshot::Store;
use rigless::soc::RegionKind;
use rigless::soc::stm32h743::MEMORY;
use rigless::soc::stm32h743::peripherals::usart;
use rigless::time::VirtualNanos;
use stylus_board::Board as Described;

use crate::chance::Chance;
use crate::core::{self, Auditor, Touched};
use crate::electrical::{Defects, Electrical};
use crate::model::adc::Pins;
use crate::model::flash::{Busy, Unreadable};
use crate::model::ram::Ram;
use crate::part::Part;
use crate::{Error, Result};

const NAME: &str = "virtual-stylus";
/// Pessimistic rate of the core: 400 MHz at two cycles per instruction. A Cortex-M7 often retires two instructions per
/// cycle.
pub const PESSIMISTIC_INSTRUCTIONS_PER_SECOND: NonZeroU64 = NonZeroU64::new(200_000_000).expect("not zero");
/// The low-speed crystal.
const LOW_SPEED_HZ: u64 = 32_768;
const SERIAL: &str = "USART3";
/// Address of the part's unique identifier, which has 96 bits (section 61.1).
const UNIQUE_ID_ADDRESS: u64 = 0x1FF1_E800;
const UNIQUE_ID: &[u8; 12] = b"VIRTUAL-0001";
/// Address of the size of the flash, KB (section 61.2).
const FLASH_SIZE_ADDRESS: u64 = 0x1FF1_E880;
const FLASH_KB: u16 = 2048;

/// The board.
#[derive(Debug)]
pub struct StylusBoard {
    /// The part.
    pub part: Part,
    serial: usize,
    unreadable: Unreadable,
    /// The RAM.
    pub ram: Ram,
    busy: Busy,
    defects: Defects,
    auditor: Auditor,
    /// The registers that the core has touched.
    pub touched: Touched,
}

impl StylusBoard {
    /// The board that `described` describes, with `pins` at its converter.
    pub fn new(
        described: &'static Described,
        pins: Box<dyn Pins>,
        electrical: Electrical,
        unreadable: Unreadable,
        busy: Busy,
        auditor: Auditor,
    ) -> Result<Self> {
        let told = |error: rigless::soc::Error| Error::Emulator(error.to_string());
        let defects = Defects::of(electrical.revision);
        let mut part = Part::new(
            described,
            pins,
            electrical,
            unreadable.clone(),
            busy.clone(),
            defects.clone(),
        )
        .map_err(told)?;
        // The emulator needs a rate. Without an external clock, the wrapper of the clock controller withholds HSE.
        let high_speed_hz = electrical.clocks.external_hz.unwrap_or(described.clock.hz.into());
        part.rcc.inner.attach_crystals(high_speed_hz, LOW_SPEED_HZ);
        part.rest.set_supply(electrical.supply_millivolts);
        part.rest.set_analog_supply(electrical.supply_millivolts);
        let serial = usart::INSTANCES
            .iter()
            .position(|&name| name == SERIAL)
            .ok_or_else(|| Error::Emulator(format!("the part has no {SERIAL}")))?;
        part.rest.usart[serial].attach(Line::default());
        Ok(Self {
            part,
            serial,
            unreadable,
            ram: Ram::default(),
            busy,
            defects,
            auditor,
            touched: Touched::default(),
        })
    }

    /// The far end of the serial line.
    pub fn line(&mut self) -> &mut Line {
        let serial = &mut self.part.rest.usart[self.serial];
        serial.chip_mut().expect("it was attached at the start")
    }
}

/// Noise from `seed` for all RAM of the part, as after power-on: addresses with 64 bits each. The noise is not an image
/// of the emulator, because the emulator places its images again at each reset.
pub fn noise(seed: u64) -> impl Iterator<Item = (u64, u64)> {
    let mut chance = Chance(seed);
    MEMORY
        .iter()
        .filter(|region| region.kind == RegionKind::Ram)
        .flat_map(|region| (region.base..region.base + region.size).step_by(8))
        .map(move |address| (address, chance.draw()))
}

// Runs start from reset, never from a snapshot.
impl Store for StylusBoard {}

impl Board for StylusBoard {
    fn name(&self) -> &'static str {
        NAME
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![NAME]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.part)
    }

    /// The part's core as the emulator's own board describes it, at a pessimistic rate.
    fn targets(&mut self) -> Vec<Target<'_>> {
        let mut bench = Stm32h743Bench::new().expect("the emulator's own board is one of its own parts");
        let mut core = bench.targets().swap_remove(0).core;
        core.instructions_per_second = PESSIMISTIC_INSTRUCTIONS_PER_SECOND;
        let unique_id = Image::new(Path::new("unique-id"), UNIQUE_ID.to_vec(), Some(UNIQUE_ID_ADDRESS));
        core.factory_images
            .push(unique_id.expect("bytes with an address make an image"));
        let flash_size = Image::new(
            Path::new("flash-size"),
            FLASH_KB.to_le_bytes().to_vec(),
            Some(FLASH_SIZE_ADDRESS),
        );
        core.factory_images
            .push(flash_size.expect("bytes with an address make an image"));
        core::wrap(
            &mut core,
            self.unreadable.clone(),
            self.ram.clone(),
            self.busy.clone(),
            self.defects.clone(),
            self.auditor.clone(),
            self.touched.clone(),
        );
        vec![Target::new(NAME, &mut self.part, core)]
    }
}

/// A byte that the image sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// Instant of the end of the byte's stop bit, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The byte.
    pub byte: u8,
}

/// The far end.
#[derive(Debug, Default)]
pub struct Line {
    to_image: VecDeque<u8>,
    from_image: Vec<Sent>,
}

impl Line {
    /// Puts `bytes` on the line, after the bytes that wait already.
    pub fn put(&mut self, bytes: &[u8]) {
        self.to_image.extend(bytes);
    }

    /// Number of bytes that the image's receiver has not begun to receive.
    pub fn waiting(&self) -> usize {
        self.to_image.len()
    }

    /// Returns the bytes that the image has sent since the last call.
    pub fn take(&mut self) -> Vec<Sent> {
        std::mem::take(&mut self.from_image)
    }
}

impl Store for Line {}

impl Peer for Line {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let [byte, _] = word.to_le_bytes();
        self.from_image.push(Sent {
            at_ns: context.now().0,
            byte,
        });
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        self.to_image.pop_front().map(u16::from)
    }
}
