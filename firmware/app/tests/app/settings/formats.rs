//! The format in which settings are kept in flash. Records of images with other settings or ranges are refused.

use crc::{CRC_32_ISO_HDLC, Crc};
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::ReadNorFlash;
use fake_stylus::device::{change, response_for};
use fake_stylus::flash::{Memory, SECTOR_BYTES};
use model_format::link::{RESPONSE_BYTES, Response, Setting, SettingSet, Settings, SettingsState};

use super::{blank, open, opened, set};

/// Settings that a start finds, those of them that are set, those that are lost, and the response.
type Known = (Settings, SettingSet, SettingSet, Option<Response>);

/// Bytes of a stored record that states `count` settings; `besides` replaces values of `known`. The fields are magic,
/// number of the change, set and lost settings, the number of settings, values, whether there is a response, the
/// response, and a checksum.
fn record(count: usize, known: &Known, besides: &[(Setting, f32)]) -> Vec<u8> {
    let (settings, set, lost, response) = known;
    let head = [7, set.bits(), lost.bits(), count as u32];
    let mut words = head.to_vec();
    words.extend(settings.iter().map(|change| change.value.to_bits()));
    for &(setting, value) in besides {
        words[head.len() + setting as usize] = value.to_bits();
    }
    let mut bytes = b"HTXD".to_vec();
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    bytes.resize(512 - 4, 0);
    if let Some(response) = response {
        let at = bytes.len() - RESPONSE_BYTES;
        bytes[at - 4] = 1;
        bytes[at..].copy_from_slice(&response.bytes());
    }
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// Flash with these bytes in both copies.
fn twice(bytes: &[u8]) -> Memory {
    let mut memory = blank();
    for copy in 0..2 {
        memory.program(copy * SECTOR_BYTES, bytes);
    }
    memory
}

fn with(known: &Known, setting: Setting, value: f32) -> Known {
    let &(settings, set, lost, response) = known;
    let settings = settings.with(change(setting, value)).expect("in range");
    (settings, set.with(setting, true), lost.with(setting, false), response)
}

/// Settings of a coil, all of them in range.
fn coil() -> Known {
    let nothing = (Settings::default(), SettingSet::NONE, SettingSet::NONE, None);
    fake_stylus::device::COIL
        .into_iter()
        .fold(nothing, |known, change| with(&known, change.setting, change.value))
}

#[test]
fn a_record_in_the_format_is_read_as_it_stands_also_after_a_change() {
    let all = Setting::ALL.len();
    let coil = coil();
    let response = response_for(&coil.0);
    let mut calibrated = with(&coil, Setting::OutputGain, response.output_gain);
    calibrated.3 = Some(response);
    for known in [coil, calibrated] {
        let mut memory = twice(&record(all, &known, &[]));
        for expected in [known, with(&known, Setting::MuteRamp, 10.0)] {
            let (settings, state) = opened(&mut memory);
            let response = open(memory.clone()).response();
            assert_eq!((settings, state.set, state.lost, response), expected);
            assert_eq!(state.check_playable(), Ok(()));
            memory = set(memory, &[change(Setting::MuteRamp, 10.0)]);
        }
    }
}

#[test]
fn a_record_with_other_settings_or_ranges_is_lost_and_told_and_stays_for_the_image_that_wrote_it() {
    let all = Setting::ALL.len();
    let coil = coil();
    let mut other_format = record(all, &coil, &[]);
    other_format[3] += 1;
    let end = other_format.len() - 4;
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&other_format[..end]);
    other_format[end..].copy_from_slice(&crc.to_le_bytes());
    for (form, bytes) in [
        ("fewer", record(all - 1, &coil, &[])),
        ("more", record(all + 1, &coil, &[])),
        ("above", record(all, &coil, &[(Setting::HardLimit, 1.6)])),
        ("below", record(all, &coil, &[(Setting::OutputGain, 0.0)])),
        ("format", other_format),
    ] {
        let mut memory = twice(&bytes);
        let (settings, state) = opened(&mut memory);
        assert_eq!(settings, Settings::default(), "{form}");
        let lost = SettingsState {
            lost: SettingSet::ALL,
            ..SettingsState::default()
        };
        assert_eq!(state, lost, "{form}");
        assert!(state.check_playable().is_err(), "{form}");
        let store = open(memory);
        assert_eq!(store.response(), None, "{form}");
        let mut flash = store.into_flash();
        for copy in 0..2 {
            let mut kept = vec![0; bytes.len()];
            let at = (copy * SECTOR_BYTES) as u32;
            block_on(flash.read(at, &mut kept)).expect("no word is lost");
            assert_eq!(kept, bytes, "{form}");
        }
    }
}
