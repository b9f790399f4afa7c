//! Settings in flash, with power lost at any operation.

use embassy_futures::block_on;
use model_format::link::{FlashOperation, Setting, SettingChange, Settings, SettingsError};
use stylus_app::settings::{SETTINGS_RANGE, SettingsStore};

use fake_stylus::flash::{Cut, Fault, Memory, Operation, SECTOR_BYTES, SimulatedFlash};

const RANGE: core::ops::Range<u32> = 0..2 * SECTOR_BYTES as u32;

fn blank() -> Memory {
    Memory::blank(RANGE.end as usize)
}

fn open(memory: Memory) -> SettingsStore<SimulatedFlash<'static>> {
    block_on(SettingsStore::open(SimulatedFlash::new(memory), RANGE))
}

fn change(setting: Setting, value: f32) -> SettingChange {
    SettingChange { setting, value }
}

#[test]
fn the_range_is_the_last_two_sectors_of_bank_1() {
    assert_eq!(SETTINGS_RANGE.len(), 2 * SECTOR_BYTES);
    assert_eq!(SETTINGS_RANGE.end, 1 << 20);
}

#[test]
fn a_device_that_was_never_set_has_the_defaults() {
    let store = open(blank());
    assert_eq!(
        (store.settings(), store.is_faulty()),
        (Settings::default(), false)
    );
}

/// Settings have their keys in flash, so that a firmware finds those of an older one, and its own at their defaults.
#[test]
fn a_setting_that_the_firmware_before_did_not_have_has_its_default() {
    let mut flash = SimulatedFlash::new(blank());
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    let (&newest, before) = Setting::ALL.split_last().expect("there are some");
    let mut expected = Settings::default();
    for &setting in before {
        let set = change(setting, setting.spec().lowest);
        expected = expected.with(set).expect("in range");
        block_on(store.set(set)).expect("in range");
    }
    let store = open(flash.memory);
    assert_eq!((store.settings(), store.is_faulty()), (expected, false));
    let default = newest.spec().default;
    assert_eq!(store.settings().get(newest), default);
}

#[test]
fn garbage_gives_the_defaults_and_can_be_set_afterwards() {
    let mut flash = SimulatedFlash::new(Memory::garbage(RANGE.end as usize));
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    assert_eq!(store.settings(), Settings::default());
    let set = block_on(store.set(change(Setting::HardLimit, 0.25))).expect("it is in range");
    assert_eq!(open(flash.memory).settings(), set);
}

#[test]
fn what_is_set_is_there_after_a_restart_whatever_went_before() {
    let mut flash = SimulatedFlash::new(blank());
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    let mut expected = Settings::default();
    // More changes than two sectors hold, so that sectors are erased and their settings moved.
    for round in 0..6_000u32 {
        let setting = Setting::ALL[round as usize % (Setting::ALL.len() - 1)];
        let spec = setting.spec();
        let share = f32::from((round % 1009) as u16) / 1009.0;
        let value = spec.lowest + (spec.highest - spec.lowest) * share;
        let value = if spec.whole {
            value as u16 as f32
        } else {
            value
        };
        expected = expected
            .with(change(setting, value))
            .expect("it is in range");
        assert_eq!(block_on(store.set(change(setting, value))), Ok(expected));
    }
    let erases = flash.operations;
    assert!(erases > 12_000);
    let store = open(flash.memory);
    assert_eq!((store.settings(), store.is_faulty()), (expected, false));
}

#[test]
fn a_value_out_of_range_is_refused_and_the_one_before_holds() {
    let mut flash = SimulatedFlash::new(blank());
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    for setting in Setting::ALL {
        for value in [f32::NAN, f32::INFINITY, setting.spec().highest * 2.0 + 1.0] {
            let error = block_on(store.set(change(setting, value)));
            assert!(
                matches!(error, Err(SettingsError::OutOfRange { .. })),
                "{error:?}"
            );
        }
    }
    assert_eq!(store.settings(), Settings::default());
    assert_eq!(flash.operations, 0);
}

#[test]
fn a_reset_brings_the_defaults_back_for_good() {
    let mut flash = SimulatedFlash::new(blank());
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    for setting in [Setting::HardLimit, Setting::ForceZero, Setting::MuteRamp] {
        block_on(store.set(change(setting, 1.0))).expect("it is in range");
    }
    assert_eq!(block_on(store.reset()), Ok(Settings::default()));
    assert_eq!(open(flash.memory).settings(), Settings::default());
}

#[test]
fn a_cut_at_any_operation_of_a_change_leaves_the_value_before_or_the_new() {
    // So many changes that among the last ones a sector is closed and the next one erased.
    let mut flash = SimulatedFlash::new(blank());
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    block_on(store.set(change(Setting::PowerLimit, 7.0))).expect("in range");
    let mut filled = 0;
    for round in 0..4_070u16 {
        block_on(store.set(change(Setting::ForceZero, f32::from(round)))).expect("in range");
        filled = round;
    }
    let mut memory = flash.memory;
    let (mut cuts, mut kept, mut taken, mut erases) = (0, 0, 0, 0);
    for round in filled + 1..filled + 60 {
        let mut observe = |memory: &Memory, operation: Operation| {
            erases += usize::from(matches!(operation, Operation::Erase { .. }));
            for cut in Cut::ALL {
                let mut memory = memory.clone();
                memory.perform(operation, cut);
                let mut flash = SimulatedFlash::new(memory);
                let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
                let settings = store.settings();
                let found = settings.get(Setting::ForceZero);
                assert!(
                    found == f32::from(round - 1) || found == f32::from(round),
                    "round {round}, {cut:?} {operation:?}: {found}"
                );
                assert_eq!(
                    settings.get(Setting::PowerLimit),
                    7.0,
                    "{cut:?} {operation:?}"
                );
                kept += usize::from(found == f32::from(round - 1));
                taken += usize::from(found == f32::from(round));
                cuts += 1;
                // The next change is stored.
                let next = block_on(store.set(change(Setting::ForceZero, 65_000.0)));
                assert!(
                    next.is_ok(),
                    "round {round}, {cut:?} {operation:?}: {next:?}"
                );
                assert_eq!(
                    open(flash.memory).settings().get(Setting::ForceZero),
                    65_000.0
                );
            }
        };
        let mut flash = SimulatedFlash::observed(memory, &mut observe);
        let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
        block_on(store.set(change(Setting::ForceZero, f32::from(round)))).expect("in range");
        memory = flash.memory;
    }
    assert!(
        cuts > 4 * 100 && kept > 0 && taken > 0 && erases > 0,
        "{cuts} {kept} {taken} {erases}"
    );
}

#[test]
fn a_fault_of_the_flash_is_told_and_the_value_before_holds() {
    let mut flash = SimulatedFlash::new(blank());
    flash.fault = Fault::Refuse(0);
    let mut store = block_on(SettingsStore::open(&mut flash, RANGE));
    let error = block_on(store.set(change(Setting::HardLimit, 0.25)));
    assert_eq!(
        error,
        Err(SettingsError::Flash {
            operation: FlashOperation::Write
        })
    );
    assert_eq!(store.settings(), Settings::default());
}
