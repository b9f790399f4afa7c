//! Every form in which a firmware has kept settings in flash, and what of it is in force after an update.

use crc::{CRC_32_ISO_HDLC, Crc};
use fake_stylus::device::{COIL, change, response_for};
use fake_stylus::flash::{Memory, SECTOR_BYTES};
use model_format::link::{RESPONSE_BYTES, Response, Setting, SettingSet, Settings};
use stylus_app::flash::WORD_BYTES;

use super::response::found;
use super::{Store, blank, cuts, open, opened, set};

/// The first changes in a map of single values, as `sequential-storage` 8.0.2 wrote them: a word with a header, and one
/// with key and value. A word of zeros is before them.
const MAP: [([u8; 8], Setting, f32); 4] = [
    (
        *b"\xb8\x2c\xda\xcb\x05\0\xdc\xe5",
        Setting::AmplifierGain,
        2.0,
    ),
    (*b"\xc7\x52\xe8\xd5\x05\0\xdc\xe5", Setting::HardLimit, 0.25),
    (
        *b"\x05\xd8\x6f\x98\x05\0\xdc\xe5",
        Setting::CoilResistance,
        4.0,
    ),
    (*b"\xde\x71\x0f\xa1\x05\0\xdc\xe5", Setting::PowerLimit, 0.2),
];

/// Settings that a start finds, those of them that are set, those that are lost, and the response.
type Known = (Settings, SettingSet, SettingSet, Option<Response>);
/// A form of records: magic number, length in bytes, and number of settings.
type Form = (&'static [u8; 4], usize, usize);
/// Before `enable-wired`.
const FIRST: Form = (b"HTXC", 128, 19);
/// Before the response.
const SECOND: Form = (b"HTXC", 128, 20);
/// The present one.
const PRESENT: Form = (b"HTXD", 512, 20);

/// A record in `form`, with these values besides.
fn record(
    (magic, length, count): Form,
    sequence: u32,
    known: &Known,
    besides: &[(Setting, f32)],
) -> Vec<u8> {
    let (settings, set, lost, response) = known;
    let head = [sequence, set.bits(), lost.bits(), count as u32];
    let mut words = head.to_vec();
    words.extend(settings.iter().map(|change| change.value.to_bits()));
    for &(setting, value) in besides {
        words[head.len() + setting as usize] = value.to_bits();
    }
    let mut bytes = magic.to_vec();
    bytes.extend(
        words
            .iter()
            .take(head.len() + count)
            .flat_map(|word| word.to_le_bytes()),
    );
    bytes.resize(length - 4, 0);
    if let Some(response) = response {
        let at = bytes.len() - RESPONSE_BYTES;
        bytes[at - 4] = 1;
        bytes[at..].copy_from_slice(&response.bytes());
    }
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&bytes);
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// Flash with these bytes in the first copy, and in the second one.
fn flash(copies: [&[u8]; 2]) -> Memory {
    let mut memory = blank();
    for (copy, bytes) in copies.into_iter().enumerate() {
        memory.program(copy * SECTOR_BYTES, bytes);
    }
    memory
}

/// The changes of [`MAP`], so many times.
fn map(times: usize) -> Vec<u8> {
    let mut bytes = vec![0; WORD_BYTES];
    for (header, setting, value) in MAP.repeat(times) {
        bytes.extend(header);
        bytes.resize(bytes.len() + WORD_BYTES - header.len(), 0xff);
        bytes.push(setting as u8);
        bytes.extend(value.to_le_bytes());
        bytes.resize(bytes.len().next_multiple_of(WORD_BYTES), 0);
    }
    bytes
}

fn with(known: &Known, setting: Setting, value: f32) -> Known {
    let &(settings, set, lost, response) = known;
    let settings = settings.with(change(setting, value)).expect("in range");
    (
        settings,
        set.with(setting, true),
        lost.with(setting, false),
        response,
    )
}

#[test]
fn settings_of_every_form_that_was_ever_written_are_read_or_told_as_lost() {
    let nothing = (
        Settings::default(),
        SettingSet::NONE,
        SettingSet::NONE,
        None,
    );
    let lost = (Settings::default(), SettingSet::NONE, SettingSet::ALL, None);
    let mapped = MAP.into_iter().fold(nothing, |known, (_, setting, value)| {
        with(&known, setting, value)
    });
    let old = with(&mapped, Setting::ContactThreshold, 0.5);
    let newer = with(&old, Setting::EnableWired, 1.0);
    let response = response_for(&newer.0);
    let mut calibrated = with(&newer, Setting::OutputGain, response.output_gain);
    calibrated.3 = Some(response);
    // Once these were in range.
    let wider = [(Setting::HardLimit, 1.6), (Setting::OutputGain, 0.0)];
    let narrowed = wider.into_iter().fold(old, |known, (setting, _)| {
        let (settings, set, lost, _) = with(&known, setting, setting.spec().default);
        (
            settings,
            set.with(setting, false),
            lost.with(setting, true),
            None,
        )
    });
    let limits = Setting::ALL
        .into_iter()
        .filter(|setting| setting.tighter().is_some());
    let limits = limits.fold(SettingSet::NONE, |set, setting| set.with(setting, true));
    let limitless = (newer.0, newer.1.without(limits), limits, None);
    let [before, torn] = [&newer, &nothing].map(|known| record(SECOND, 7, known, &[]));
    let followed = [&before[..], &torn[..124], &[0; 4]].concat();
    let twice = |bytes: Vec<u8>| flash([&bytes, &bytes]);
    let rows = [
        ("nothing", blank(), nothing),
        ("a map of few changes", flash([&map(1), &[]]), nothing),
        ("a map of many", flash([&map(20), &[]]), lost),
        ("a map in both sectors", twice(map(1)), lost),
        ("19 settings", twice(record(FIRST, 7, &old, &[])), old),
        (
            "wider ranges",
            twice(record(FIRST, 7, &old, &wider)),
            narrowed,
        ),
        ("20 settings", twice(record(SECOND, 7, &newer, &[])), newer),
        ("one torn", flash([&followed, &before]), newer),
        ("both torn", twice(followed), limitless),
        ("512 bytes", twice(record(PRESENT, 7, &newer, &[])), newer),
        (
            "a response",
            twice(record(PRESENT, 7, &calibrated, &[])),
            calibrated,
        ),
    ];
    for (form, mut memory, known) in rows {
        for expected in [known, with(&known, Setting::MuteRamp, 10.0)] {
            let (settings, state) = opened(&mut memory);
            let response = open(memory.clone()).response();
            assert_eq!(
                (settings, state.set, state.lost, response),
                expected,
                "{form}"
            );
            let is_whole =
                SettingSet::REQUIRED.without(state.set).is_empty() && state.lost.is_empty();
            assert_eq!(state.check_playable().is_ok(), is_whole, "{form}");
            memory = set(memory, &[change(Setting::MuteRamp, 10.0)]);
        }
    }
}

#[test]
fn records_of_older_firmware_stay_in_force_and_their_first_change_survives_every_cut() {
    let defaults = (
        Settings::default(),
        SettingSet::REQUIRED,
        SettingSet::NONE,
        None,
    );
    let last = COIL.into_iter().fold(defaults, |known, change| {
        with(&known, change.setting, change.value)
    });
    for count in [1, 3, 4, 5, SECTOR_BYTES / 128] {
        let records = (1..=count).flat_map(|number| {
            let known = if number == count { last } else { defaults };
            record(SECOND, number as u32, &known, &[])
        });
        let records: Vec<u8> = records.collect();
        let memory = flash([&records, &records]);
        let (settings, state) = opened(&mut memory.clone());
        assert_eq!((settings, state.mended), (last.0, false), "{count} records");
        let response = response_for(&settings);
        let store = async |store: &mut Store<'_, '_>| {
            let stored = store.set_response(Some(&response)).await;
            stored.expect("the flash works");
        };
        let left = cuts(&memory, |_| 0..5, store);
        let new = found(&left[left.len() - 1]);
        assert_eq!(new.1, Some(response));
        for cut in &left {
            let now = found(cut);
            assert!(
                now == (settings, None) || now == new,
                "{count} records: {now:?}"
            );
        }
    }
}
