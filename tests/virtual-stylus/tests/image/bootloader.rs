//! The bootloader: what is flashed with it, and an exchange of images with a low supply or with a write-protected
//! record.

use std::fs;

use embassy_futures::block_on;
use fake_stylus::flash::{Memory, SimulatedFlash};
use stylus_boot::map::{RECORDS, SECTOR_BYTES, SLOTS, WORD_BYTES};
use stylus_boot::record::{Record, Store, mark};
use virtual_stylus::ResetCause;
use virtual_stylus::model::flash::{BASE, Contents};

use crate::device::{Device, SECOND, product, with_faults};
use crate::library;
use crate::update::{EXCHANGE_NS, active, image};

/// Supplies, mV: the board's, and one that is too low to write flash.
const SUPPLY: u32 = 3_300;
const LOW_SUPPLY: u32 = 2_700;
/// MODER and ODR of a port, and LD3's pin on port B.
const MODER: u64 = 0;
const ODR: u64 = 0x14;
const LD3: u32 = 14;

fn place(contents: &mut Contents, offset: u32, bytes: &[u8]) {
    let placed = contents.place(u64::from(BASE + offset), bytes);
    placed.expect("it is in the flash");
}

/// The flash with the product and with an update to `new` in the second slot, which the bootloader is to exchange.
fn committed(new: &[u8]) -> Contents {
    let mut contents = Device::new(&product(), library::options()).stylus.flash();
    let memory = block_on(async {
        let flash = SimulatedFlash::new(Memory::blank(RECORDS.end as usize));
        let mut store = Store::open(flash, RECORDS).await;
        let replaced = store.replace(Record::marked(mark::SWAP, 1, [1, 2, 3]));
        replaced.await.expect("it is kept");
        store.into_flash().memory
    });
    let record = &memory.bytes()[RECORDS.start as usize..][..WORD_BYTES];
    place(&mut contents, RECORDS.start, record);
    place(&mut contents, SLOTS[1].start, new);
    contents
}

impl Device {
    /// Returns true if LD3 is lit.
    fn shows_fault(&mut self) -> bool {
        let mut read = |offset| self.stylus.read_register("GPIOB", offset);
        let [mode, level] = [MODER, ODR].map(|offset| read(offset).expect("there is one"));
        mode >> (2 * LD3) & 0b11 == 1 && level >> LD3 & 1 == 1
    }

    fn flash_operations(&mut self) -> usize {
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

/// Returns a device whose start has stopped because the record of the update in its second slot is write-protected, and
/// the update's image.
fn stayed() -> (Device, Vec<u8>) {
    /// The sectors of the record, one bit per sector.
    const PROTECTED: u8 = 0b11_0000;
    let new = image(&with_faults());
    let mut device = Device::new(&product(), library::after(committed(&new)));
    (device.stylus).board(|board| board.part.protect_sectors(PROTECTED));
    device.run_for(4 * SECOND);
    assert_eq!((device.resets(), device.shows_fault()), (vec![], true));
    (device, new)
}

#[test]
fn a_record_that_cannot_be_written_ends_the_start_with_a_sign_and_no_resets() {
    let (mut device, _) = stayed();
    // Neither time nor the button B1 ends this state.
    device.stylus.press_button(true);
    device.run_for(SECOND);
    assert_eq!((device.resets(), device.shows_fault()), (vec![], true));
}

#[test]
fn after_a_record_could_not_be_written_a_reset_tries_again_and_goes_on_once_it_can_be() {
    let (mut device, new) = stayed();
    let old = active(&device.stylus.flash().bytes);
    device.stylus.reset_by_pin();
    device.run_for(SECOND);
    assert!(device.shows_fault() && device.runs(&old), "it fails again");
    (device.stylus).board(|board| board.part.protect_sectors(0));
    device.run_for(SECOND);
    assert!(device.shows_fault(), "only a reset tries again");
    device.stylus.reset_by_pin();
    assert!(device.answers_within(EXCHANGE_NS));
    assert!(device.runs(&new) && device.is_on_trial() && !device.shows_fault());
    assert_eq!(device.resets(), [ResetCause::Other; 2]);
}
