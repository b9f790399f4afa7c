//! The bootloader: what is flashed with it, and an exchange of images with a low supply or with write-protected
//! sectors.

use std::fs;

use embassy_futures::block_on;
use fake_stylus::flash::{Memory, SimulatedFlash};
use model_format::link::{ImageVersion, UpdatePhase};
use stylus_board::{ALL, Board, Pin};
use stylus_boot::map::{RECORDS, SECTOR_BYTES, SLOTS, WORD_BYTES};
use stylus_boot::record::{Record, Store, mark};
use virtual_stylus::ResetCause;
use virtual_stylus::model::flash::{BASE, Contents, ONES};
use virtual_stylus::part::PORTS;

use crate::device::{Device, SECOND, product, product_of, with_faults};
use crate::library;
use crate::update::{EXCHANGE_NS, active, image};

/// Supplies, mV: the board's, and one that is too low to write flash.
const SUPPLY: u32 = 3_300;
pub const LOW_SUPPLY: u32 = 2_700;
/// MODER and ODR of a port.
const MODER: u64 = 0;
const ODR: u64 = 0x14;

fn place(contents: &mut Contents, offset: u32, bytes: &[u8]) {
    contents
        .place(u64::from(BASE + offset), bytes)
        .expect("it is in the flash");
}

/// The flash with the product and with an update to `new` in the second slot, which the bootloader is to exchange.
fn committed(new: &[u8]) -> Contents {
    committed_on(&ALL[0], new)
}

/// The same on `board`.
pub fn committed_on(board: &Board, new: &[u8]) -> Contents {
    let mut contents = Device::new(&product_of(board), library::options()).stylus.flash();
    let memory = block_on(async {
        let flash = SimulatedFlash::new(Memory::blank(RECORDS.end as usize));
        let mut store = Store::open(flash, RECORDS).await;
        store
            .replace(Record::marked(mark::SWAP, 1, [1, 2, 3]))
            .await
            .expect("it is kept");
        store.into_flash().memory
    });
    let record = &memory.bytes()[RECORDS.start as usize..][..WORD_BYTES];
    place(&mut contents, RECORDS.start, record);
    place(&mut contents, SLOTS[1].start, new);
    contents
}

impl Device {
    /// Returns true if the LED of faults is lit.
    fn shows_fault(&mut self) -> bool {
        self.is_lit(ALL[0].fault_led())
    }

    /// Returns true if the LED at `pin` is lit.
    pub fn is_lit(&mut self, pin: Pin) -> bool {
        let mut read = |offset| self.stylus.read_register(PORTS[pin.port], offset);
        let [mode, level] = [MODER, ODR].map(|offset| read(offset).expect("there is one"));
        mode >> (2 * pin.number) & 0b11 == 1 && level >> pin.number & 1 == 1
    }

    pub fn flash_operations(&mut self) -> usize {
        self.stylus.flash_operations().len()
    }
}

#[test]
fn the_file_for_the_parts_own_loader_leaves_the_flash_as_a_probe_does() {
    let mut before = library::flash_with(&[&library::small()]);
    // Something in the record's sectors, which flashing must erase.
    place(&mut before, RECORDS.start, &vec![0; 2 * SECTOR_BYTES]);
    let mut by_probe = Device::new(&product(), library::of(before.clone()));
    let by_probe = by_probe.stylus.flash().bytes;
    let file = fs::read(product().with_extension("dfu")).expect("it lies beside the image");
    // UM0391, sections 2.2 to 2.4: after the prefixes of 11 and 274 bytes, each element follows its address and length.
    // A suffix of 16 bytes ends the file.
    let mut elements = Vec::new();
    let mut rest = &file[285..file.len() - 16];
    while let Some((head, behind)) = rest.split_first_chunk::<8>() {
        let [address, length] = [0, 4].map(|at| head[at..at + 4].try_into().expect("four bytes"));
        let (bytes, behind) = behind.split_at(u32::from_le_bytes(length) as usize);
        elements.push((u64::from(u32::from_le_bytes(address)), bytes));
        rest = behind;
    }
    let mut by_loader = before;
    by_loader.flash(&elements).expect("they are in the flash");
    assert!(by_loader.bytes == by_probe);
    let records = RECORDS.start as usize..RECORDS.end as usize;
    assert!(by_probe[records].iter().all(|&byte| byte == 0xFF));
}

#[test]
fn while_the_supply_is_low_the_bootloader_waits_with_a_sign_and_writes_no_flash() {
    let new = image(&with_faults());
    let mut device = Device::new(&product(), library::after(committed(&new)));
    device.stylus.set_supply(LOW_SUPPLY);
    device.run_for(2 * SECOND);
    assert_eq!((device.flash_operations(), device.shows_fault()), (0, true));
    device.stylus.set_supply(SUPPLY);
    device.run_for(3 * SECOND);
    assert!(!device.shows_fault());
    device.stylus.set_supply(LOW_SUPPLY);
    // An operation that has begun may end, but no further one may start.
    let begun = device.flash_operations();
    device.run_for(5 * SECOND);
    let after = (device.flash_operations(), device.shows_fault());
    assert!(begun > 1 && after == (begun, true), "{begun}, {after:?}");
    device.stylus.set_supply(SUPPLY);
    assert!(device.answers_within(EXCHANGE_NS));
    assert!(device.runs(&new) && device.is_on_trial());
    assert_eq!(device.resets(), []);
}

/// Protects these sectors of bank 1 from writing, a bit for each.
fn protect(device: &mut Device, sectors: u8) {
    (device.stylus).board(move |board| board.part.protect_sectors(sectors));
}

#[test]
fn an_exchange_whose_sector_cannot_be_written_is_given_up_and_the_old_image_says_so() {
    /// The image's last sector, which the second step of an exchange replaces.
    const LAST: u8 = 0b1000;
    let new = image(&with_faults());
    let mut device = Device::new(&product(), library::after(committed(&new)));
    let old = active(&device.stylus.flash().bytes);
    protect(&mut device, LAST);
    assert!(device.answers_within(EXCHANGE_NS));
    let version = ImageVersion::new([1, 2, 3]);
    assert_eq!(device.update_state().phase, UpdatePhase::GivenUp { version });
    assert!(device.runs(&old) && !device.shows_fault());
    assert_eq!(device.resets(), []);
}

#[test]
fn a_record_that_cannot_be_written_amid_an_exchange_ends_the_start_with_a_sign_until_a_reset_can_write_it() {
    /// The sectors of the record.
    const RECORD: u8 = 0b11_0000;
    let new = image(&with_faults());
    let mut device = Device::new(&product(), library::after(committed(&new)));
    // The record of a step that is done.
    let records = RECORDS.start as usize..RECORDS.end as usize;
    while device.stylus.flash().bytes[records.clone()]
        .chunks(WORD_BYTES)
        .filter(|&word| word != ONES)
        .count()
        < 3
    {
        device.run_for(SECOND / 2);
    }
    protect(&mut device, RECORD);
    device.run_for(EXCHANGE_NS);
    assert_eq!((device.resets(), device.shows_fault()), (vec![], true));
    // Neither time nor the button B1 ends this state, and nor does the end of the protection.
    device.stylus.press_button(true);
    device.run_for(SECOND);
    device.stylus.press_button(false);
    protect(&mut device, 0);
    device.run_for(SECOND);
    assert_eq!((device.resets(), device.shows_fault()), (vec![], true));
    device.stylus.reset_by_pin();
    assert!(device.answers_within(EXCHANGE_NS));
    assert!(device.runs(&new) && device.is_on_trial() && !device.shows_fault());
    assert_eq!(device.resets(), [ResetCause::Other]);
}
