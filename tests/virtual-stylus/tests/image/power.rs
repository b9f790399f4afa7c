//! Power cuts: after a cut at any moment there is a library, the old one or the new one.

use model_format::link::{SlotId, SlotState};
use virtual_stylus::model::flash::{Contents, Moment};
use virtual_stylus::{Options, PowerCut};

use crate::device::{Device, is_drawn};
use crate::library;
use crate::requests::announced;

/// The active slot and its library's checksum.
pub fn state_of(device: &mut Device) -> Option<(SlotId, u32)> {
    let slots = device.slots();
    let active = slots.active?;
    match &slots.slots[active.index()] {
        SlotState::Valid(info) => Some((active, info.crc32)),
        _ => None,
    }
}

/// The content of the flash after cuts of an upload of `library` onto `flash`, each at another moment: at the first
/// operations and the last ones, and at sixty between. Of these a run draws some; it always takes the first and the
/// last operation, and a header that is torn.
fn cuts(flash: &Contents, library: &[u8]) -> Vec<PowerCut> {
    const BETWEEN: u64 = 60;
    let mut counted = Device::started(library::of(flash.clone()));
    counted.upload(library);
    let operations = counted.stylus.flash_operations().len() as u64;
    assert!(operations > 100, "{operations} operations");

    let spread = |n: u64| 1 + n * (operations - 1) / (BETWEEN - 1);
    let ends = (1..=5).chain(operations - 4..=operations);
    let numbers = (0..BETWEEN).map(spread).chain(ends).zip(0..);
    let drawn = numbers
        .filter(|&(_, case)| is_drawn(case))
        .map(|(number, _)| {
            let moment = match number % 3 {
                0 => Moment::Before,
                1 => Moment::During { seed: number },
                _ => Moment::After,
            };
            (number, moment)
        });
    let torn_header = (operations - 1..=operations).map(|n| (n, Moment::During { seed: 1 }));
    let always = [(1, Moment::Before), (operations, Moment::After)];
    let mut device = Device::started(library::of(flash.clone()));
    let wanted = drawn.chain(torn_header).chain(always).collect();
    device.stylus.capture_power_cuts(wanted);
    device.upload(library);
    device.stylus.take_power_cuts()
}

#[test]
fn after_a_power_cut_at_any_flash_operation_the_old_or_the_new_library_is_active() {
    let old = library::small();
    let new = library::other();
    let [old_crc, new_crc] = [&old, &new].map(|library| announced(library).crc32);
    let cuts = cuts(&library::flash_with(&[&old]), &new);
    let count = cuts.len();
    let (mut old_ones, mut new_ones, mut torn) = (0, 0, 0);
    for cut in cuts {
        torn += usize::from(!cut.contents.unreadable.is_empty());
        let mut device = Device::started(Options {
            keep_flash: true,
            watch_ticks: false,
            ..library::of(cut.contents)
        });
        match state_of(&mut device) {
            Some((_, crc32)) if crc32 == old_crc => old_ones += 1,
            Some((_, crc32)) if crc32 == new_crc => new_ones += 1,
            other => panic!(
                "{other:?} after {:?} of {:?}",
                cut.moment, cut.operation.number
            ),
        }
    }
    println!(
        "{count} cuts: {old_ones} times the old library, {new_ones} times the new one, {torn} torn"
    );
    assert!(old_ones > 0 && new_ones > 0 && torn > 0);
}
