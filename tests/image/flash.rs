//! What the image keeps in flash. Nothing plays with guessed settings, and no setting is lost if a word of the flash
//! fails. Uploads do not disturb playing, and the flash may refuse an erasure.

use model_format::link::{PlayEndpoint, PlayError, Setting, SlotId, SlotState, UPLOAD_WINDOW, UploadBeginEndpoint};
use stylus_app::settings::SETTINGS_RANGE;
use stylus_boot::map::{FLASH, SECTOR_BYTES, WORD_BYTES};
use virtual_stylus::Options;
use virtual_stylus::model::flash::{BASE, BYTES, Contents, Kind, Operation, Stalls};

use crate::device::{Device, long};
use crate::library;
use crate::requests::{announced, play_request};
use crate::ticks::{MOST_GAP_US, check_bounds};

/// The sectors of the settings, one per copy.
const COPIES: [u32; 2] = [
    FLASH + SETTINGS_RANGE.start,
    FLASH + SETTINGS_RANGE.end - SECTOR_BYTES as u32,
];

fn options(flash: Contents) -> Options {
    Options {
        flash,
        watch_ticks: false,
        ..Options::default()
    }
}

fn play(device: &mut Device) -> Result<(), Box<PlayError>> {
    device.keep_alive(true);
    let request = play_request("lattice", 1);
    let played = device.request::<PlayEndpoint>(&request);
    // While the bank with the settings is erased, the serial line would lose what is sent.
    device.keep_alive(played.is_ok());
    played.map(|_| ()).map_err(Box::new)
}

/// Addresses of the last programmed word in each copy.
fn last_words(flash: &Contents) -> [u32; 2] {
    COPIES.map(|start| {
        let offset = (start - FLASH) as usize;
        let sector = &flash.bytes[offset..offset + SECTOR_BYTES];
        let (words, _) = sector.as_chunks::<WORD_BYTES>();
        let last = words.iter().rposition(|word| *word != [0xff; WORD_BYTES]);
        start + (last.expect("something was written") * WORD_BYTES) as u32
    })
}

#[test]
fn an_unreadable_word_of_a_copy_loses_no_setting_and_of_both_copies_silences() {
    let mut device = Device::with_library();
    device.set(Setting::HardLimit, 0.05);
    let expected = device.set(Setting::AmplifierGain, 10.0);
    let flash = device.stylus.flash();
    let words = last_words(&flash);
    for word in words {
        let mut damaged = flash.clone();
        damaged.unreadable.insert(word);
        let mut device = Device::started(options(damaged));
        assert_eq!(device.settings(), expected);
        let state = device.status().settings;
        assert!(state.mended && state.check_playable().is_ok(), "{state:?}");
        // Both copies are intact again.
        let mended = device.stylus.flash();
        let state = Device::started(options(mended)).status().settings;
        assert!(!state.mended && state.check_playable().is_ok(), "{state:?}");
    }
    let mut damaged = flash;
    damaged.unreadable.extend(words);
    let mut device = Device::started(options(damaged));
    let refused = play(&mut device).expect_err("the limits are lost");
    assert!(matches!(*refused, PlayError::SettingsLost { lost } if lost.contains(Setting::HardLimit)));
    device.reset_settings().expect("the flash can be erased");
    device.set_coil();
    assert_eq!(play(&mut device), Ok(()));
}

#[test]
fn settings_are_written_and_erased_while_ticks_go_on_and_nothing_waits_for_the_bank() {
    let mut device = Device::with_library();
    device.set(Setting::SoftStart, 100.0);
    device.reset_settings().expect("they are erased");
    let operations = device.stylus.flash_operations();
    assert!(operations.len() > 3, "{operations:?}");
    let stalls = device.stylus.flash_stalls();
    assert_eq!(stalls, Stalls::default(), "nothing waits for a bank");
    device.assert_undisturbed();
    let marks = device.status().marks;
    assert!(marks.longest_watchdog_gap_us <= MOST_GAP_US, "{marks:?}");
}

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
