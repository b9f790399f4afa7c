//! Settings on the image: nothing plays with guessed settings, and no setting is lost if a word of the flash fails.

use model_format::link::{PlayEndpoint, PlayError, Setting};
use stylus_app::settings::SETTINGS_RANGE;
use stylus_boot::map::{FLASH, SECTOR_BYTES, WORD_BYTES};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;

use crate::device::Device;
use crate::requests::play_request;

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
