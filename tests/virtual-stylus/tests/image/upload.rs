//! Uploads, and the playing that they leave undisturbed.

use model_format::link::{MotionSource, UPLOAD_WINDOW, UploadCommitEndpoint};
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

#[test]
fn a_host_that_goes_in_the_middle_of_an_upload_can_go_on_or_begin_another() {
    let mut device = Device::started(library::options());
    let large = library::middling();
    let progress = device.begin_upload(&large);
    device.send_chunks(&large, progress, 20_000);
    // The host goes in the middle of a frame, and another one comes.
    device.send_bytes(&[7, 1, 2, 3]);
    device.run_for(300 * MS);
    device.send_bytes(&[0]);
    let resumed = device.begin_upload(&large);
    assert!(resumed.next_offset >= 20_000, "{resumed:?}");

    let other = library::other();
    let begun = device.begin_upload(&other);
    assert_eq!(begun.next_offset, 0);
    device.send_chunks(&other, begun, other.len());
    let committed = device
        .request::<UploadCommitEndpoint>(&())
        .expect("a valid library");
    assert_eq!(
        device.activate(committed.slot).library.crc32,
        announced(&other).crc32
    );
}

/// The next chunk crosses the link while one is programmed.
#[test]
fn an_upload_with_chunks_ahead_takes_less_time_than_one_with_a_turn_of_the_line_between_them() {
    let library = library::middling();
    let [ahead, one_by_one] = [UPLOAD_WINDOW, 1].map(|window| {
        let mut device = Device::started(Options::default());
        let begin_ms = device.status().uptime_ms;
        device.upload_ahead(&library, window);
        device.status().uptime_ms - begin_ms
    });
    println!("{ahead} ms, one by one {one_by_one} ms");
    // Programming takes 0.1 ms per word of 32 bytes, about 190 ms in all; most of it is saved.
    assert!(ahead + 80 < one_by_one, "{ahead} ms of {one_by_one} ms");
}
