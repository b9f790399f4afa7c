//! Uploads: the playing that they leave undisturbed, and power cuts, after which there is the old library or the new.

use host_tools::link::budget::Budget;
use model_format::link::{MotionSource, SlotId, SlotState, UPLOAD_WINDOW, UploadCommitEndpoint, UploadTimes};
use virtual_stylus::{Options, PowerCut};
use virtual_stylus::model::flash::{Contents, Moment, Stalls};

use crate::library;
use crate::device::{Device, MS, is_drawn, long};
use crate::requests::announced;

#[test]
fn a_full_upload_while_playing_and_streaming_moves_nothing_and_is_active_afterwards() {
    let mut device = Device::started(library::options());
    device.move_at(120.0);
    device.play_until_heard("lattice", MotionSource::Sensors, 5);
    device.record();
    let before = device.status();
    let large = if long() {
        library::large()
    } else {
        library::middling()
    };
    let committed = device.upload(&large);
    let after = device.status();
    let stopped = device.stop_recording();

    assert_eq!(
        after.output.mute, before.output.mute,
        "it is heard all the time"
    );
    assert_eq!(after.output.mute_counts, before.output.mute_counts);
    assert_eq!(stopped.lost_blocks, 0);
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
    device.assert_undisturbed();

    let activated = device.activate(committed.slot);
    assert_eq!(activated.library.crc32, announced(&large).crc32);
    let slots = device.slots();
    assert_eq!(slots.active, Some(committed.slot));
    let last = committed.textures as u8 - 1;
    let name = device.texture(committed.slot, last).name;
    device.play_until_heard(&name, MotionSource::Sensors, 6);
}

/// Most of an upload's time beyond the data sheets' least, as a share of that.
const NOT_PHYSICAL: f64 = 0.06;

/// Times of an upload of `library` by the device's clock, which counts virtual time.
fn timed(device: &mut Device, library: &[u8], window: usize) -> UploadTimes {
    let times = device.upload_ahead(library, window).times;
    println!("{window} at once, {} bytes: {times:?}", library.len());
    times
}

/// Checks that an upload took little more than erasing, programming and the link of `address` take by their data
/// sheets.
fn assert_physical(times: &UploadTimes, bytes: usize, address: &str) {
    let seconds = |us: u32| f64::from(us) / 1e6;
    let budget = Budget::of(bytes, &address.parse().expect("an address"));
    println!("{address}: {budget:?}");
    let near = |found: f64, expected: f64| (found / expected - 1.0).abs() < 0.1;
    assert!(near(seconds(times.erase_us), budget.erase_s), "{times:?}");
    assert!(
        near(seconds(times.program_us), budget.program_s),
        "{times:?}"
    );
    let beyond = times.total_us() as f64 / 1e6 / budget.least_s() - 1.0;
    assert!(
        (0.0..NOT_PHYSICAL).contains(&beyond),
        "{:.1} % beyond {budget:?}: {times:?}",
        100.0 * beyond
    );
}

#[test]
fn an_upload_takes_what_flash_and_link_take_and_little_more() {
    let middling = library::middling();
    assert!((45_000..70_000).contains(&middling.len()));
    let mut device = Device::started(Options::default());
    let serial = timed(&mut device, &middling, UPLOAD_WINDOW);
    assert_physical(&serial, middling.len(), "serial:/dev/ttyACM0");

    // The same with a turn of the line between any two chunks waits longer.
    let mut device = Device::started(Options::default());
    let one_by_one = timed(&mut device, &middling, 1);
    assert!(one_by_one.wait_us > serial.wait_us + serial.program_us / 2);

    let mut device = Device::on_usb(Options::default());
    let usb = timed(&mut device, &middling, UPLOAD_WINDOW);
    assert_physical(&usb, middling.len(), "usb");
    assert!(usb.wait_us < usb.program_us / 10, "{usb:?}");
}

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
