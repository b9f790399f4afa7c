//! Uploads, and the playing that they leave undisturbed.

use host_tools::link::budget::Budget;
use model_format::link::{MotionSource, UPLOAD_WINDOW, UploadCommitEndpoint, UploadTimes};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Stalls;

use crate::device::{Device, MS, long};
use crate::library;
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
