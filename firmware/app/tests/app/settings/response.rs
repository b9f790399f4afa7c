//! The actuator's response beside the settings: with all that belongs to it or not at all, wherever the power is cut,
//! and records of firmware that had none.

use crc::{CRC_32_ISO_HDLC, Crc};
use embassy_futures::block_on;
use fake_stylus::device::{COIL, change, response_for};
use fake_stylus::flash::{Cut, Memory, Operation, SECTOR_BYTES, SimulatedFlash};
use model_format::link::{Response, Setting, SettingSet, Settings};
use stylus_app::flash::WORD_BYTES;
use stylus_app::settings::SettingsStore;

use super::{RANGE, blank, open, opened, set};

type Store<'a, 'b> = SettingsStore<&'a mut SimulatedFlash<'b>>;

/// Settings and response in force after a start on a copy of `memory`.
fn found(memory: &Memory) -> (Settings, Option<Response>) {
    let store = open(memory.clone());
    assert!(
        store.state().check_playable().is_ok(),
        "{:?}",
        store.state()
    );
    (store.settings(), store.response())
}

/// The flash before each operation of `work` on the store in `memory`, cut in every manner, and after the last one.
fn cuts(memory: &Memory, work: &impl AsyncFn(&mut Store<'_, '_>)) -> Vec<Memory> {
    let mut left = Vec::new();
    let mut observe = |memory: &Memory, operation: Operation| {
        for how in Cut::WITH_UNSTABLE {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            left.push(memory);
        }
    };
    let mut flash = SimulatedFlash::observed(memory.clone(), &mut observe);
    block_on(async {
        let mut store = SettingsStore::open(&mut flash, RANGE).await;
        work(&mut store).await;
    });
    let done = flash.memory.clone();
    drop(flash);
    left.push(done);
    left
}

/// A response that is stored, or replaced, changes with the gain that belongs to it, and with the last operation alone
/// that its acknowledgement needs: a start after a cut, and one after a cut in the mending of that, finds one of both.
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
            store
                .set_response(Some(&response))
                .await
                .expect("the flash works");
        };
        let left = cuts(&memory, &store);
        let new = found(&left[left.len() - 1]);
        assert_eq!(new.1, Some(response));
        assert_eq!(new.0.get(Setting::OutputGain), response.output_gain);
        let (mut olds, mut news) = (0, 0);
        for (number, cut) in left.iter().enumerate() {
            let now = found(cut);
            assert!(now == old || now == new, "cut {number}: {now:?}");
            (olds, news) = (olds + u32::from(now == old), news + u32::from(now == new));
            if number % 7 == 0 {
                for mended in cuts(cut, &async |_: &mut _| ()) {
                    let then = found(&mended);
                    assert!(
                        then == old || then == new,
                        "mended after cut {number}: {then:?}"
                    );
                }
            }
        }
        assert!(olds > news && news > 0, "{olds} old, {news} new");
        memory = left[left.len() - 1].clone();
    }
    let mut flash = SimulatedFlash::new(memory);
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    // A change of another setting keeps the response, its removal keeps the settings, and a reset removes all.
    block_on(store.set(change(Setting::ForceZero, 5_000.0))).expect("in range");
    assert_eq!(store.response(), Some(second));
    block_on(store.set_response(None)).expect("the flash works");
    assert_eq!(store.response(), None);
    assert_eq!(store.settings().get(Setting::OutputGain), 0.0025);
    block_on(store.set_response(Some(&first))).expect("the flash works");
    block_on(store.reset()).expect("the flash works");
    assert_eq!(open(flash.memory).response(), None);
}

/// A record as firmware before the response wrote it: four words, with its own magic number.
fn old_record(sequence: u32, settings: &Settings, set: SettingSet) -> [u8; 128] {
    let mut bytes = [0; 128];
    bytes[..4].copy_from_slice(b"HTXC");
    let head = [sequence, set.bits(), 0, Setting::ALL.len() as u32];
    let values = settings.iter().map(|change| change.value.to_bits());
    for (word, value) in bytes[4..124]
        .chunks_exact_mut(4)
        .zip(head.into_iter().chain(values))
    {
        word.copy_from_slice(&value.to_le_bytes());
    }
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes[..124]);
    bytes[124..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// Flash as older firmware left it after `count` changes, the last of which is that of the coil.
fn old_flash(count: usize) -> (Memory, Settings) {
    let settings = COIL
        .into_iter()
        .fold(Settings::default(), |settings, change| {
            settings.with(change).expect("in range")
        });
    let set = SettingSet::REQUIRED;
    let mut memory = blank();
    for copy in 0..2 {
        for number in 0..count {
            let is_last = number + 1 == count;
            let settings = if is_last {
                settings
            } else {
                Settings::default()
            };
            let bytes = old_record(number as u32 + 1, &settings, set);
            let first = (copy * SECTOR_BYTES + 128 * number) / WORD_BYTES;
            for (word, &data) in (first..).zip(bytes.as_chunks().0) {
                memory.perform(Operation::Write { word, data }, Cut::After);
            }
        }
    }
    (memory, settings)
}

#[test]
fn records_of_older_firmware_stay_in_force_and_their_first_change_survives_every_cut() {
    for count in [1, 3, 4, 5, SECTOR_BYTES / 128] {
        let (memory, settings) = old_flash(count);
        let (read, state) = opened(&mut memory.clone());
        assert_eq!((read, state.mended), (settings, false), "{count} records");
        let response = response_for(&settings);
        let store = async |store: &mut Store<'_, '_>| {
            store
                .set_response(Some(&response))
                .await
                .expect("the flash works");
        };
        let old = (settings, None);
        let left = cuts(&memory, &store);
        let new = found(&left[left.len() - 1]);
        assert_eq!(new.1, Some(response));
        for cut in &left {
            let now = found(cut);
            assert!(now == old || now == new, "{count} records: {now:?}");
        }
    }
}
