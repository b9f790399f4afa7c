//! Settings on the image: nothing plays with guessed settings, and no setting is lost if a word of the flash fails or
//! the power is cut.

use model_format::link::{PlayEndpoint, PlayError, Setting};
use stylus_app::settings::SETTINGS_RANGE;
use stylus_boot::map::{FLASH, SECTOR_BYTES, WORD_BYTES};
use virtual_stylus::Options;
use virtual_stylus::model::flash::{Contents, Moment};

use crate::device::{Device, is_drawn};
use crate::library;
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
fn a_power_cut_at_any_operation_of_a_change_leaves_the_setting_before_or_the_new() {
    let mut device = Device::started(library::options());
    let before = device.set(Setting::HardLimit, 0.25);
    let flash = device.stylus.flash();
    // A record is 16 words, in two copies. Every run cuts the first and the last of these 32 operations.
    let cases = (0..24).filter(|&case| is_drawn(case) || case == 0 || case == 23);
    let wanted: Vec<(u64, Moment)> = cases
        .map(|case| {
            let number = 1 + case / 3 * 31 / 7;
            let moments = [Moment::Before, Moment::During { seed: number }, Moment::After];
            (number, moments[case as usize % 3])
        })
        .collect();
    let count = wanted.len();
    let mut device = Device::started(options(flash));
    device.stylus.capture_power_cuts(wanted);
    let after = device.set(Setting::HardLimit, 0.05);
    let cuts = device.stylus.take_power_cuts();
    assert_eq!(cuts.len(), count);
    let mut found = [0; 2];
    for cut in cuts {
        let mut device = Device::started(library::after(cut.contents));
        let now = device.settings();
        assert!(now == before || now == after, "{now:?}");
        found[usize::from(now == after)] += 1;
        assert_eq!(device.status().settings.check_playable(), Ok(()));
        let next = device.set(Setting::HardLimit, 0.125);
        assert!((next.hard_limit().0 - 0.125).abs() < f32::EPSILON);
    }
    assert!(found.iter().all(|&count| count > 0), "{found:?}");
}
