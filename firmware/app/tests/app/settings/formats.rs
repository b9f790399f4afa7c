//! The format in which settings are kept in flash, which images with other settings and ranges must read.

use crc::{CRC_32_ISO_HDLC, Crc};
use fake_stylus::device::{change, response_for};
use fake_stylus::flash::{Memory, SECTOR_BYTES};
use model_format::link::{RESPONSE_BYTES, Response, Setting, SettingSet, Settings};

use super::{blank, open, opened, set};

/// Settings that a start finds, those of them that are set, those that are lost, and the response.
type Known = (Settings, SettingSet, SettingSet, Option<Response>);

/// A record of the first `count` settings, with the values `besides` in place of theirs: magic, number of the change,
/// set and lost settings, the number of settings, values, whether there is a response, the response, checksum.
fn record(count: usize, known: &Known, besides: &[(Setting, f32)]) -> Vec<u8> {
    let (settings, set, lost, response) = known;
    let head = [7, set.bits(), lost.bits(), count as u32];
    let mut words = head.to_vec();
    words.extend(settings.iter().map(|change| change.value.to_bits()));
    for &(setting, value) in besides {
        words[head.len() + setting as usize] = value.to_bits();
    }
    let mut bytes = b"HTXD".to_vec();
    let words = words.iter().take(head.len() + count);
    bytes.extend(words.flat_map(|word| word.to_le_bytes()));
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
    (
        settings,
        set.with(setting, true),
        lost.with(setting, false),
        response,
    )
}

#[test]
fn records_of_images_with_fewer_settings_or_wider_ranges_are_read_and_what_is_out_of_range_is_lost()
{
    let nothing = (
        Settings::default(),
        SettingSet::NONE,
        SettingSet::NONE,
        None,
    );
    let coil = fake_stylus::device::COIL
        .into_iter()
        .fold(nothing, |known, change| {
            with(&known, change.setting, change.value)
        });
    let all = Setting::ALL.len();
    let response = response_for(&coil.0);
    let mut calibrated = with(&coil, Setting::OutputGain, response.output_gain);
    calibrated.3 = Some(response);
    let wider = [(Setting::HardLimit, 1.6), (Setting::OutputGain, 0.0)];
    let narrowed = wider.into_iter().fold(coil, |known, (setting, _)| {
        let (settings, set, lost, _) = with(&known, setting, setting.spec().default);
        (
            settings,
            set.with(setting, false),
            lost.with(setting, true),
            None,
        )
    });
    let rows = [
        ("nothing", blank(), nothing),
        ("fewer", twice(&record(all - 1, &coil, &[])), coil),
        ("all", twice(&record(all, &coil, &[])), coil),
        ("wider", twice(&record(all, &coil, &wider)), narrowed),
        (
            "response",
            twice(&record(all, &calibrated, &[])),
            calibrated,
        ),
    ];
    for (form, mut memory, known) in rows {
        for expected in [known, with(&known, Setting::MuteRamp, 10.0)] {
            let (settings, state) = opened(&mut memory);
            let response = open(memory.clone()).response();
            let found = (settings, state.set, state.lost, response);
            assert_eq!(found, expected, "{form}");
            let is_whole =
                SettingSet::REQUIRED.without(state.set).is_empty() && state.lost.is_empty();
            assert_eq!(state.check_playable().is_ok(), is_whole, "{form}");
            memory = set(memory, &[change(Setting::MuteRamp, 10.0)]);
        }
    }
}
