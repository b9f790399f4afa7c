//! Settings in flash, with power lost at any operation, and with words that are lost afterwards.

use std::iter;
use std::ops::Range;
use std::sync::LazyLock;

use embassy_futures::block_on;
use model_format::link::{FlashOperation, Setting, SettingChange, SettingSet, Settings, SettingsError, SettingsState};
use stylus_app::flash::WORD_BYTES;
use stylus_app::settings::SettingsStore;

use fake_stylus::device::{COIL, change};
use fake_stylus::flash::{Cut, Memory, Mishap, Operation, SECTOR_BYTES, SimulatedFlash};

mod formats;
mod histories;

const RANGE: Range<u32> = 0..2 * SECTOR_BYTES as u32;

/// Flash words of a record.
const RECORD_WORDS: usize = 16;

/// Changes that fill a copy.
const CHANGES_PER_COPY: u32 = (SECTOR_BYTES / WORD_BYTES / RECORD_WORDS) as u32;

fn blank() -> Memory {
    Memory::blank(RANGE.end as usize)
}

fn open(memory: Memory) -> SettingsStore<SimulatedFlash<'static>> {
    block_on(SettingsStore::open(SimulatedFlash::new(memory), RANGE))
}

/// Opens the settings in `memory`, and replaces it by what the flash holds afterwards.
fn opened(memory: &mut Memory) -> (Settings, SettingsState) {
    let mut flash = SimulatedFlash::new(memory.clone());
    let store = store_in(&mut flash);
    let found = (store.settings(), store.state());
    *memory = flash.memory;
    found
}

/// Flash after `changes`.
fn set(memory: Memory, changes: &[SettingChange]) -> Memory {
    let mut flash = SimulatedFlash::new(memory);
    let mut store = store_in(&mut flash);
    for &change in changes {
        block_on(store.set(change)).expect("it is in range");
    }
    flash.memory
}

type Store<'a, 'b> = SettingsStore<&'a mut SimulatedFlash<'b>>;

fn store_in<'a, 'b>(flash: &'a mut SimulatedFlash<'b>) -> Store<'a, 'b> {
    block_on(SettingsStore::open(flash, RANGE))
}

/// Returns the flash after losses of power during `work` on the store in `memory`, in the manners that `kinds` gives
/// for each of its operations, and last the flash as `work` leaves it.
fn cuts(
    memory: &Memory,
    kinds: impl Fn(usize) -> Range<usize>,
    work: impl AsyncFnOnce(&mut Store<'_, '_>),
) -> Vec<Memory> {
    let (mut left, mut number) = (Vec::new(), 0);
    let mut observe = |memory: &Memory, operation: Operation| {
        for &how in &Cut::EVERY[kinds(number)] {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            left.push(memory);
        }
        number += 1;
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

/// Number of changes from the first to the last of the flashes that [`NEARLY_FULL`] holds for each number of lost
/// places.
const LAST_CHANGES: usize = 6;

/// Flashes with the coil's settings, shortly before the change that erases a copy, with and without lost places in a
/// copy.
static NEARLY_FULL: LazyLock<Vec<Memory>> = LazyLock::new(|| {
    [[0, 0], [1, 0], [0, 1], [3, 0], [0, 3]]
        .into_iter()
        .flat_map(nearly_full)
        .collect()
});

/// The flashes of [`NEARLY_FULL`] whose copies have lost so many places (`lost_places`) by refused writes.
fn nearly_full(lost_places: [usize; 2]) -> Vec<Memory> {
    let again = change(Setting::ForceZero, Setting::ForceZero.spec().default);
    let mut memory = set(blank(), &COIL);
    for (copy, lost) in lost_places.into_iter().enumerate() {
        for _ in 0..lost {
            let mut flash = SimulatedFlash::new(memory);
            flash.fate.strike(copy * RECORD_WORDS, Mishap::Refuse);
            let mut store = store_in(&mut flash);
            block_on(store.set(again)).expect("the next place takes it");
            memory = flash.memory;
        }
    }
    let lost: usize = lost_places.iter().sum();
    // A change that would take one of the last three places of a copy erases the copy first.
    let last = CHANGES_PER_COPY as usize - 3 - COIL.len() - 2 * lost;
    memory = set(memory, &vec![again; last - LAST_CHANGES]);
    let next = |memory: &Memory| Some(set(memory.clone(), &[again]));
    iter::successors(Some(memory), next).take(LAST_CHANGES + 1).collect()
}

/// Offsets of the words of the last record of the copy with number `copy`.
fn last_record(memory: &Memory, copy: usize) -> impl Iterator<Item = usize> + use<> {
    let sector = copy * SECTOR_BYTES..(copy + 1) * SECTOR_BYTES;
    let last = memory.last_programmed(sector).expect("something was written");
    (last + 1 - RECORD_WORDS..=last).map(|word| word * WORD_BYTES)
}

#[test]
fn what_cannot_be_read_at_all_is_lost_and_told_and_a_reset_begins_anew() {
    let mut flash = SimulatedFlash::new(Memory::garbage(RANGE.end as usize));
    let mut store = store_in(&mut flash);
    assert_eq!(store.settings(), Settings::default());
    assert_eq!(store.state().lost, SettingSet::ALL);
    assert_eq!(store.state().set, SettingSet::NONE);
    // A change is stored although a copy has no room, and the other settings stay lost.
    let changed = block_on(store.set(change(Setting::HardLimit, 0.25))).expect("it is in range");
    let lost = SettingSet::ALL.with(Setting::HardLimit, false);
    assert_eq!(store.state().lost, lost);
    let (settings, state) = opened(&mut flash.memory);
    assert_eq!((settings, state.lost), (changed, lost));
    let mut store = store_in(&mut flash);
    assert_eq!(block_on(store.reset()), Ok(Settings::default()));
    assert_eq!(
        opened(&mut flash.memory),
        (Settings::default(), SettingsState::default())
    );
}

#[test]
fn what_is_set_is_there_after_a_restart_whatever_went_before() {
    let mut flash = SimulatedFlash::new(blank());
    let mut store = store_in(&mut flash);
    let mut expected = Settings::default();
    let mut set = SettingSet::NONE;
    // More changes than a copy holds, so that each copy is erased several times.
    for round in 0..6 * CHANGES_PER_COPY {
        let setting = Setting::ALL[round as usize % (Setting::ALL.len() - 1)];
        let spec = setting.spec();
        let share = f32::from((round % 1009) as u16) / 1009.0;
        let value = spec.lowest + (spec.highest - spec.lowest) * share;
        let value = if spec.whole { value.trunc() } else { value };
        expected = expected.with(change(setting, value)).expect("it is in range");
        set = set.with(setting, true);
        assert_eq!(block_on(store.set(change(setting, value))), Ok(expected));
    }
    let writes = (6 * CHANGES_PER_COPY) as usize * 2 * RECORD_WORDS;
    assert!(flash.operations > writes + 10, "{} operations", flash.operations);
    let state = SettingsState {
        set,
        ..SettingsState::default()
    };
    assert_eq!(opened(&mut flash.memory), (expected, state));
}

/// A limit whose last value is lost must not take its previous value, as it would in a map of single values.
#[test]
fn any_lost_word_of_one_copy_leaves_every_setting_as_it_was() {
    let tight = [
        change(Setting::HardLimit, 0.05),
        change(Setting::AmplifierGain, 10.0),
        change(Setting::ForceZero, 5_000.0),
    ];
    let memory = set(set(blank(), &COIL), &tight);
    let expected = opened(&mut memory.clone());
    for copy in 0..2 {
        for offset in last_record(&memory, copy) {
            for damage in [Memory::set_faulty, Memory::flip_bit, Memory::set_unstable] {
                let mut memory = memory.clone();
                damage(&mut memory, offset);
                // An unstable word may read right at one start and wrongly at the next.
                for _ in 0..3 {
                    let (settings, state) = opened(&mut memory);
                    assert_eq!(settings, expected.0, "copy {copy}, byte {offset}");
                    let known = (state.set, state.lost, state.differing);
                    assert_eq!(known, (expected.1.set, SettingSet::NONE, SettingSet::NONE));
                }
                // The copy was mended, so the other copy may be lost now.
                let offsets: Vec<_> = last_record(&memory, 1 - copy).collect();
                memory.set_faulty(offsets[1]);
                assert_eq!(opened(&mut memory).0, expected.0, "copy {copy}, byte {offset}");
            }
        }
    }
}

#[test]
fn a_limit_that_both_copies_lost_is_lost_until_it_is_set_again_and_sensors_are_carried_over() {
    let mut memory = set(blank(), &[change(Setting::ForceZero, 5_000.0)]);
    memory = set(memory, &COIL);
    memory = set(memory, &[change(Setting::HardLimit, 0.05)]);
    for copy in 0..2 {
        let offset = last_record(&memory, copy).next().expect("it has words");
        memory.set_faulty(offset);
    }
    for _ in 0..3 {
        let (settings, state) = opened(&mut memory);
        assert_eq!(settings.get(Setting::ForceZero), 5_000.0);
        assert!(state.set.contains(Setting::ForceZero));
        assert!(SettingSet::REQUIRED.without(state.lost).is_empty());
        assert!(state.lost.contains(Setting::HardLimit) && !state.lost.contains(Setting::ForceZero));
        assert!(state.check_playable().is_err());
    }
    for setting in opened(&mut memory).1.lost.iter() {
        assert!(opened(&mut memory).1.check_playable().is_err());
        memory = set(memory, &[change(setting, setting.spec().default)]);
    }
    assert_eq!(opened(&mut memory).1.check_playable(), Ok(()));
}

#[test]
fn copies_that_differ_give_the_tighter_limit_and_say_so() {
    for (setting, loose, tight) in [
        (Setting::HardLimit, 0.5, 0.05),
        (Setting::AmplifierGain, 1.0, 10.0),
        (Setting::PowerLimit, 1.0, 0.1),
        (Setting::CoilResistance, 16.0, 4.0),
    ] {
        for (before, after) in [(loose, tight), (tight, loose)] {
            let memory = set(set(blank(), &COIL), &[change(setting, before)]);
            // Power is lost between the writes of the first copy and the second.
            let kinds = |number| 0..usize::from(number == RECORD_WORDS);
            let mut memory = cuts(&memory, kinds, async |store| {
                store.set(change(setting, after)).await.expect("in range");
            })
            .swap_remove(0);
            let (settings, state) = opened(&mut memory);
            assert_eq!(settings.get(setting), tight, "{setting} from {before} to {after}");
            assert_eq!(state.differing, SettingSet::NONE.with(setting, true));
            assert!(state.mended && state.check_playable().is_ok());
            // From then on both copies hold the value.
            let (settings, state) = opened(&mut memory);
            assert_eq!((settings.get(setting), state.mended), (tight, false));
        }
    }
}

#[test]
fn one_refusal_of_the_flash_is_worked_round_and_a_flash_that_refuses_all_is_told() {
    let mut flash = SimulatedFlash::new(blank());
    flash.fate.strike(0, Mishap::Refuse);
    let mut store = store_in(&mut flash);
    assert!(block_on(store.set(change(Setting::HardLimit, 0.25))).is_ok());
    for refused in 0..2 * RECORD_WORDS {
        let mut flash = SimulatedFlash::new(set(blank(), &COIL));
        flash.fate.strike(refused, Mishap::RefuseFrom);
        let mut store = store_in(&mut flash);
        let error = block_on(store.set(change(Setting::HardLimit, 0.25)));
        let operation = FlashOperation::Write;
        assert_eq!(error, Err(SettingsError::Flash { operation }), "from {refused} on");
        assert_eq!(store.settings().hard_limit().0, 0.5);
        assert!(store.state().unwritable);
        assert_eq!(block_on(store.reset()), Err(SettingsError::Flash { operation }));
        assert_eq!(
            store.state().set,
            SettingSet::NONE,
            "what could not be erased does not play"
        );
        // When the flash works again, the store works again.
        flash.fate.spare();
        let mut store = store_in(&mut flash);
        assert_eq!(block_on(store.reset()), Ok(Settings::default()));
        assert!(block_on(store.set(change(Setting::HardLimit, 0.25))).is_ok());
    }
}

#[test]
fn an_erasure_that_is_refused_is_tried_again_by_the_next_change() {
    for refused in [0, 1 + RECORD_WORDS] {
        let full = NEARLY_FULL[LAST_CHANGES].clone();
        let mut flash = SimulatedFlash::new(full);
        flash.fate.strike(refused, Mishap::Refuse);
        let mut store = store_in(&mut flash);
        let change = change(Setting::HardLimit, 0.25);
        let operation = FlashOperation::Write;
        let refusal = SettingsError::Flash { operation };
        assert_eq!(block_on(store.set(change)), Err(refusal), "{refused}");
        assert!(block_on(store.set(change)).is_ok(), "{refused}");
        assert!(!store.state().unwritable);
        let (settings, state) = opened(&mut flash.memory);
        assert_eq!((settings.hard_limit().0, state.mended), (0.25, false));
    }
}

#[test]
fn a_write_that_puts_a_wrong_bit_is_found_by_reading_back() {
    for wrong in 0..2 * RECORD_WORDS {
        let mut flash = SimulatedFlash::new(set(blank(), &COIL));
        flash.fate.strike(wrong, Mishap::Corrupt);
        let mut store = store_in(&mut flash);
        let set = block_on(store.set(change(Setting::HardLimit, 0.05))).expect("in range");
        flash.fate.spare();
        assert_eq!(opened(&mut flash.memory).0, set, "write {wrong}");
    }
}
