//! Uploads: they do not disturb playing, and the flash may refuse an erasure.

use model_format::link::{SlotId, SlotState, UPLOAD_WINDOW, UploadBeginEndpoint};
use virtual_stylus::Options;
use virtual_stylus::model::flash::{BASE, BYTES, Kind, Operation, Stalls};

use crate::device::{Device, long};
use crate::library;
use crate::marks::check_bounds;
use crate::requests::announced;

#[test]
fn a_full_upload_while_playing_and_streaming_moves_nothing_and_is_active_afterwards() {
    // The upload must erase the older library.
    let both = library::flash_with(&[&library::other(), &library::small()]);
    let mut device = Device::started(library::of(both));
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.record();
    let before = device.status();
    let large = if long() { library::large() } else { library::middling() };
    let committed = device.upload(&large);
    let after = device.status();
    let stopped = device.stop_recording();

    assert_eq!(after.output.mute, before.output.mute, "it is heard all the time");
    assert_eq!(after.output.mute_counts, before.output.mute_counts);
    assert_eq!(stopped.lost_blocks, 0);
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
    let operations = device.stylus.flash_operations();
    let is_erasure = |operation: &Operation| match &operation.kind {
        Kind::Erase(sector) => sector.start >= BASE + BYTES as u32 / 2,
        Kind::Program { .. } => false,
    };
    assert!(operations.iter().any(is_erasure), "{operations:?}");
    device.assert_undisturbed();
    check_bounds(device.status().marks);

    let activated = device.activate(committed.slot);
    assert_eq!(activated.library.crc32, announced(&large).crc32);
    let slots = device.slots();
    assert_eq!(slots.active, Some(committed.slot));
    let last = committed.textures as u8 - 1;
    let name = device.texture(committed.slot, last).name;
    device.play_until_heard(&name);
}

#[test]
fn an_erasure_that_the_flash_does_not_begin_is_no_success() {
    let mut device = Device::with_library();
    let refuse = |device: &mut Device, refuses| {
        (device.stylus).board(move |board| board.part.flash.around.refuses_erasures = refuses);
    };
    // The slot holds a library, so that there is something to erase.
    device.upload(&library::other());
    refuse(&mut device, true);
    let begun = device.request::<UploadBeginEndpoint>(&announced(&library::middling()));
    assert!(begun.is_err(), "{begun:?}");
    refuse(&mut device, false);
    device.upload(&library::middling());
}

/// Checks that the next chunk crosses the link while another one is programmed.
#[test]
fn an_upload_with_chunks_ahead_takes_less_time_than_one_with_a_turn_of_the_line_between_them() {
    let library = library::middling();
    let [ahead, one_by_one] = [UPLOAD_WINDOW, 1].map(|window| {
        let mut device = Device::started(Options::default());
        let begin_ms = device.status().uptime_ms;
        device.upload_ahead(&library, window);
        device.status().uptime_ms - begin_ms
    });
    // Programming takes 0.1 ms per word of 32 bytes, about 160 ms in all. Sending ahead saves most of it.
    assert!(ahead + 80 < one_by_one, "{ahead} ms of {one_by_one} ms");
}

/// The active slot and the checksum of its library.
pub fn state_of(device: &mut Device) -> Option<(SlotId, u32)> {
    let slots = device.slots();
    let active = slots.active?;
    match &slots.slots[active.index()] {
        SlotState::Valid(info) => Some((active, info.crc32)),
        _ => None,
    }
}
