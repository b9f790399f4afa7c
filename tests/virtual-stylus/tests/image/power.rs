//! Power cuts: after a cut at any moment there is a library, the old one or the new one.

use model_format::link::{SlotId, SlotState};
use virtual_stylus::Options;
use virtual_stylus::model::flash::{Contents, Moment};

use crate::device::{Device, announced};
use crate::library;

/// Number of operations that are cut.
const CUTS: u64 = 60;

/// The active slot and its library's checksum.
pub fn state_of(device: &mut Device) -> Option<(SlotId, u32)> {
    let slots = device.slots();
    let active = slots.active?;
    match &slots.slots[active.index()] {
        SlotState::Valid(info) => Some((active, info.crc32)),
        _ => None,
    }
}

/// The content of the flash after each of several cuts of an upload of `library` onto `flash`: at the first operations,
/// the last ones, and some between, each at another moment.
fn cuts(flash: &Contents, library: &[u8]) -> Vec<virtual_stylus::stylus::PowerCut> {
    let with = |flash: &Contents| Options {
        flash: flash.clone(),
        ..Options::default()
    };
    let mut counted = Device::started(with(flash));
    counted.upload(library);
    let operations = counted
        .stylus
        .flash_operations()
        .expect("the run goes on")
        .len() as u64;
    assert!(operations > 100, "{operations} operations");

    let spread = |n: u64| 1 + n * (operations - 1) / (CUTS - 1);
    let ends = (1..=5).chain(operations - 4..=operations);
    let cuts = (0..CUTS).map(spread).chain(ends).map(|number| {
        let moment = match number % 3 {
            0 => Moment::Before,
            1 => Moment::During { seed: number },
            _ => Moment::After,
        };
        (number, moment)
    });
    let torn_header =
        (operations - 1..=operations).map(|number| (number, Moment::During { seed: 1 }));
    let mut device = Device::started(with(flash));
    let wanted = cuts.chain(torn_header).collect();
    device
        .stylus
        .capture_power_cuts(wanted)
        .expect("the run goes on");
    device.upload(library);
    device.stylus.take_power_cuts().expect("the run goes on")
}

#[test]
fn after_a_power_cut_at_any_flash_operation_the_old_or_the_new_library_is_active() {
    let flash = library::flash_with_small();
    let library = library::other();
    let old = announced(library::small()).crc32;
    let new = announced(&library).crc32;
    let cuts = cuts(&flash, &library);
    assert!(cuts.len() as u64 >= CUTS, "{} cuts", cuts.len());
    let (mut old_ones, mut new_ones, mut torn) = (0, 0, 0);
    for cut in cuts {
        torn += usize::from(!cut.contents.unreadable.is_empty());
        let options = Options {
            flash: cut.contents.clone(),
            keep_flash: true,
            watch_ticks: false,
            ..Options::default()
        };
        let mut device = Device::started(options);
        match state_of(&mut device) {
            Some((_, crc32)) if crc32 == old => old_ones += 1,
            Some((_, crc32)) if crc32 == new => new_ones += 1,
            other => panic!(
                "{other:?} after {:?} of {:?}",
                cut.moment, cut.operation.number
            ),
        }
    }
    println!(
        "{old_ones} times the old library, {new_ones} times the new one; {torn} times with torn words"
    );
    assert!(old_ones > 0 && new_ones > 0 && torn > 0);
}
