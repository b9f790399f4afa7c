//! What is kept in flash: the format of settings, of which records of images with other settings or ranges are refused,
//! and the actuator's response with them: all that belongs to it changes or nothing, wherever power is lost.

use crc::{CRC_32_ISO_HDLC, Crc};
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::ReadNorFlash;
use fake_stylus::device::{COIL, change, response_for};
use fake_stylus::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use model_format::link::{RESPONSE_BYTES, Response, Setting, SettingSet, Settings, SettingsState};

use super::{Store, blank, cuts, open, opened, set, store_in};

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

/// Settings and response in force after a start on a copy of `memory`.
pub fn found(memory: &Memory) -> (Settings, Option<Response>) {
    let store = open(memory.clone());
    assert!(store.state().check_playable().is_ok(), "{:?}", store.state());
    (store.settings(), store.response())
}

/// A response is stored or replaced together with its gain, and only by the last operation that its acknowledgement
/// needs. A start after a loss of power, or after another loss while that start mends the copies, finds the old state
/// or the new one.
#[test]
fn a_cut_while_a_response_is_stored_leaves_all_of_the_old_or_all_of_the_new() {
    let blank = set(blank(), &COIL);
    let first = response_for(&found(&blank).0);
    let second = Response {
        worst_db: 1.25,
        output_gain: 0.0025,
        ..first
    };
    let mut memory = blank;
    for response in [first, second] {
        let old = found(&memory);
        let store = async |store: &mut Store<'_, '_>| {
            store.set_response(Some(&response)).await.expect("the flash works");
        };
        let left = cuts(&memory, |_| 0..5, store);
        let new = found(&left[left.len() - 1]);
        assert_eq!(new.1, Some(response));
        assert_eq!(new.0.get(Setting::OutputGain), response.output_gain);
        let (mut olds, mut news) = (0, 0);
        for (number, cut) in left.iter().enumerate() {
            let now = found(cut);
            assert!(now == old || now == new, "cut {number}: {now:?}");
            (olds, news) = (olds + u32::from(now == old), news + u32::from(now == new));
            if number % 7 == 0 {
                for mended in cuts(cut, |_| 0..5, async |_: &mut _| ()) {
                    let then = found(&mended);
                    assert!(then == old || then == new, "mended after cut {number}: {then:?}");
                }
            }
        }
        assert!(olds > news && news > 0, "{olds} old, {news} new");
        memory = left[left.len() - 1].clone();
    }
    let mut flash = SimulatedFlash::new(memory);
    let mut store = store_in(&mut flash);
    // A change of another setting keeps the response, a removal of the response keeps the settings, and a reset removes
    // all.
    block_on(store.set(change(Setting::ForceZero, 5_000.0))).expect("in range");
    assert_eq!(store.response(), Some(second));
    block_on(store.set_response(None)).expect("the flash works");
    assert_eq!(store.response(), None);
    assert_eq!(store.settings().get(Setting::OutputGain), 0.0025);
    block_on(store.set_response(Some(&first))).expect("the flash works");
    block_on(store.reset()).expect("the flash works");
    assert_eq!(open(flash.memory).response(), None);
}
