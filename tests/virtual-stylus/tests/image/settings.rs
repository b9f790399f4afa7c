//! Settings on the image: nothing plays with guessed ones, and none is lost with a word of the flash.

use model_format::link::{MotionSource, PlayEndpoint, PlayError, Setting};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;

use crate::device::Device;
use crate::library;
use crate::requests::play_request;

/// The last two sectors of bank 1, one per copy.
const COPIES: [u32; 2] = [0x080c_0000, 0x080e_0000];
const SECTOR_BYTES: u32 = 128 * 1024;
const WORD_BYTES: usize = 32;

fn options(flash: Contents) -> Options {
    Options {
        flash,
        watch_ticks: false,
        ..Options::default()
    }
}

fn play(device: &mut Device) -> Result<(), Box<PlayError>> {
    device.keep_alive(true);
    let request = play_request("lattice", MotionSource::Sensors, 1);
    let played = device.request::<PlayEndpoint>(&request);
    // While the settings' bank is erased, the serial line would lose what is sent.
    device.keep_alive(played.is_ok());
    played.map(|_| ()).map_err(Box::new)
}

/// Addresses of the last word that is programmed in each copy.
fn last_words(flash: &Contents) -> [u32; 2] {
    COPIES.map(|start| {
        let offset = (start - 0x0800_0000) as usize;
        let sector = &flash.bytes[offset..offset + SECTOR_BYTES as usize];
        let (words, _) = sector.as_chunks::<WORD_BYTES>();
        let last = words.iter().rposition(|word| *word != [0xff; WORD_BYTES]);
        start + (last.expect("something was written") * WORD_BYTES) as u32
    })
}

#[test]
fn an_unreadable_word_of_a_copy_loses_no_setting_and_of_both_copies_silences() {
    let mut device = Device::started(library::options());
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
        // Both copies are whole again.
        let mended = device.stylus.flash();
        let state = Device::started(options(mended)).status().settings;
        assert!(!state.mended && state.check_playable().is_ok(), "{state:?}");
    }
    let mut damaged = flash;
    damaged.unreadable.extend(words);
    let mut device = Device::started(options(damaged));
    let refused = play(&mut device).expect_err("the limits are lost");
    assert!(
        matches!(*refused, PlayError::SettingsLost { lost } if lost.contains(Setting::HardLimit))
    );
    device.reset_settings().expect("the flash can be erased");
    device.set_coil();
    assert_eq!(play(&mut device), Ok(()));
}
