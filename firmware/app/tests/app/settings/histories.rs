//! Random histories of changes, losses of power and lost words.

use embassy_futures::block_on;
use fake_stylus::device::{COIL, response_for};
use fake_stylus::flash::{Cut, Memory, Operation, SECTOR_BYTES, SimulatedFlash};
use model_format::link::{Response, Setting, SettingChange, Settings, Tighter};
use proptest::prelude::*;
use stylus_app::flash::WORD_BYTES;

use super::{NEARLY_FULL, RECORD_WORDS, Store, blank, change, cuts, open, opened, store_in};
use crate::budget::{self, Chance};

/// One step of a stylus's life.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// A setting is set to a fraction of its range.
    Set { setting: usize, share: u16 },
    /// A setting is set to a fraction of its range, and power is lost at an operation of the flash.
    CutSet {
        setting: usize,
        share: u16,
        at: usize,
        how: usize,
    },
    /// A response is stored, with a gain at a fraction of the gain's range.
    Respond { share: u16 },
    /// A response is stored, with a gain at a fraction of the gain's range, and power is lost at an operation of the
    /// flash.
    CutRespond { share: u16, at: usize, how: usize },
    /// Power is lost at an operation by which a start mends the copies.
    CutStart { at: usize, how: usize },
    /// A word of a copy's last record, or a word shortly before that record, faults, flips a bit, or becomes unstable.
    Damage { copy: usize, word: usize, how: usize },
    /// A restart.
    Restart,
    /// A reset, and the coil's settings.
    Reset,
}

fn step() -> impl Strategy<Value = Step> {
    let limits = Setting::ALL.len();
    let (at, how) = (0..34_usize, 0..Cut::EVERY.len());
    prop_oneof![
        4 => (0..limits, any::<u16>()).prop_map(|(setting, share)| Step::Set { setting, share }),
        4 => (0..limits, any::<u16>(), at.clone(), how.clone())
            .prop_map(|(setting, share, at, how)| Step::CutSet { setting, share, at, how }),
        2 => any::<u16>().prop_map(|share| Step::Respond { share }),
        2 => (any::<u16>(), at.clone(), how.clone())
            .prop_map(|(share, at, how)| Step::CutRespond { share, at, how }),
        2 => (at, how).prop_map(|(at, how)| Step::CutStart { at, how }),
        3 => (0..2usize, 0..40usize, 0..3usize)
            .prop_map(|(copy, word, how)| Step::Damage { copy, word, how }),
        2 => Just(Step::Restart),
        1 => Just(Step::Reset),
    ]
}

/// Index of one of [`NEARLY_FULL`], or none for blank flash.
fn beginning() -> impl Strategy<Value = Option<usize>> {
    prop::option::of(0..NEARLY_FULL.len())
}

/// Returns true if `value` protects less than `than`.
fn is_weaker(setting: Setting, value: f32, than: f32) -> bool {
    match setting.tighter() {
        Some(Tighter::Lower) => value > than,
        Some(Tighter::Higher) => value < than,
        None => false,
    }
}

/// Runs `work` on the store in `memory`, and loses power at operation `at` in the manner `how`. `memory` is then the
/// flash as the loss left it, or as `work` left it if there are fewer operations.
fn cut(memory: &mut Memory, at: usize, how: usize, work: impl AsyncFnOnce(&mut Store<'_, '_>)) {
    let kinds = |number| how..how + usize::from(number == at);
    *memory = cuts(memory, kinds, work).swap_remove(0);
}

/// A stylus, and what it has acknowledged.
#[derive(Clone)]
struct Life {
    memory: Memory,
    /// For each setting the values that a restart may find: the last one acknowledged, and those whose storing was cut.
    known: Vec<Vec<f32>>,
    /// Responses that a restart may find.
    responses: Vec<Option<Response>>,
}

impl Life {
    fn new(beginning: Option<usize>, seed: u64) -> Self {
        let mut memory = beginning.map_or_else(blank, |number| NEARLY_FULL[number].clone());
        memory.seed(seed);
        let defaults = Settings::default();
        let known = Setting::ALL.map(|setting| vec![defaults.get(setting)]).to_vec();
        let mut life = Self {
            memory,
            known,
            responses: vec![None],
        };
        for change in COIL {
            life.set(change);
        }
        life
    }

    fn acknowledge(&mut self, change: SettingChange) {
        self.known[change.setting as usize] = vec![change.value];
    }

    fn set(&mut self, change: SettingChange) {
        let set = self.with_store(async |store| store.set(change).await);
        assert!(set.is_ok(), "{change:?} {set:?}");
        self.acknowledge(change);
    }

    /// Returns the result of `work` on the store, whose flash stays as `work` leaves it.
    fn with_store<T>(&mut self, work: impl AsyncFnOnce(&mut Store<'_, '_>) -> T) -> T {
        let mut flash = SimulatedFlash::new(self.memory.clone());
        let mut store = store_in(&mut flash);
        let done = block_on(work(&mut store));
        self.memory = flash.memory;
        done
    }

    fn step(&mut self, step: Step) {
        match step {
            Step::Set { setting, share } => self.set(value(setting, share)),
            Step::Respond { share } => {
                let response = response(share);
                let set = self.with_store(async |store| store.set_response(Some(&response)).await);
                assert_eq!(set, Ok(()));
                self.acknowledge(response.change());
                self.responses = vec![Some(response)];
            }
            Step::CutRespond { share, at, how } => {
                let response = response(share);
                self.known[Setting::OutputGain as usize].push(response.output_gain);
                self.responses.push(Some(response));
                cut(&mut self.memory, at, how, async |store| {
                    let _ = store.set_response(Some(&response)).await;
                });
            }
            Step::CutSet {
                setting,
                share,
                at,
                how,
            } => {
                let change = value(setting, share);
                self.known[change.setting as usize].push(change.value);
                cut(&mut self.memory, at, how, async |store| {
                    let _ = store.set(change).await;
                });
            }
            Step::CutStart { at, how } => {
                cut(&mut self.memory, at, how, async |_| ());
            }
            Step::Damage { copy, word, how } => {
                let sector = copy * SECTOR_BYTES..(copy + 1) * SECTOR_BYTES;
                let Some(last) = self.memory.last_programmed(sector) else {
                    return;
                };
                let first = copy * SECTOR_BYTES / WORD_BYTES;
                let damaged = last.saturating_sub(word).max(first);
                let damage = [Memory::set_faulty, Memory::flip_bit, Memory::set_unstable][how];
                damage(&mut self.memory, damaged * WORD_BYTES);
            }
            Step::Restart => {
                opened(&mut self.memory);
            }
            Step::Reset => {
                let reset = self.with_store(async |store| store.reset().await);
                assert_eq!(reset, Ok(Settings::default()));
                for change in Settings::default().iter() {
                    self.acknowledge(change);
                }
                self.responses = vec![None];
                for change in COIL {
                    self.set(change);
                }
            }
        }
    }

    /// Starts on a copy of the flash; returns true if something may be played.
    fn check(&self, step: Step) -> bool {
        let store = open(self.memory.clone());
        if store.state().check_playable().is_err() {
            return false;
        }
        for setting in Setting::ALL {
            let value = store.settings().get(setting);
            let known = &self.known[setting as usize];
            assert!(
                known.iter().any(|&known| !is_weaker(setting, value, known)),
                "{setting}: {value} is weaker than all of {known:?} after {step:?}: {:?}",
                store.state()
            );
        }
        assert!(self.responses.contains(&store.response()), "after {step:?}");
        true
    }
}

fn response(share: u16) -> Response {
    let gain = value(Setting::OutputGain as usize, share);
    Response {
        output_gain: gain.value,
        ..response_for(&Settings::default())
    }
}

fn value(setting: usize, share: u16) -> SettingChange {
    let setting = Setting::ALL[setting];
    let spec = setting.spec();
    let value = spec.lowest + (spec.highest - spec.lowest) * (f32::from(share) / 65_535.0);
    let value = if spec.whole { value.trunc() } else { value };
    change(setting, value)
}

/// Numbers of those operations of the next change that erase.
fn erasures(memory: &Memory) -> Vec<usize> {
    let (mut erasures, mut number) = (Vec::new(), 0);
    let mut flash = SimulatedFlash::observed(memory.clone(), |_, operation| {
        if matches!(operation, Operation::Erase { .. }) {
            erasures.push(number);
        }
        number += 1;
    });
    let mut store = store_in(&mut flash);
    block_on(store.set(value(0, 0))).expect("it is in range");
    drop(flash);
    erasures
}

proptest! {
    #![proptest_config(budget::config(1_500))]

    /// While something may be played, no limit is weaker than the last value that was acknowledged or whose storing was
    /// cut, whenever power is lost and whichever words are lost. Loss of power by itself never keeps the stylus from
    /// playing. The store can always be written again.
    #[test]
    fn no_limit_becomes_weaker_while_something_may_be_played_and_cuts_alone_never_silence(
        beginning in beginning(), seed: u64, has_damage: bool, steps in prop::collection::vec(step(), 1..12),
    ) {
        let mut life = Life::new(beginning, seed);
        let damages = |step: &Step| matches!(step, Step::Damage { .. });
        let mut is_damaged = false;
        for step in steps.into_iter().filter(|step| has_damage || !damages(step)) {
            is_damaged |= damages(&step);
            life.step(step);
            let may_play = life.check(step);
            prop_assert!(may_play || is_damaged, "after {:?}: {:?}", step, open(life.memory.clone()).state());
        }
        life.step(Step::Reset);
        prop_assert!(life.check(Step::Reset), "a reset and the coil's settings mend everything");
    }
}

/// An interrupted erasure may leave any mixture of whole, erased and unreadable words, so that a copy may end with any
/// of its older records. No limit becomes weaker by this.
#[test]
fn no_limit_becomes_weaker_by_what_a_cut_erasure_leaves() {
    let mut chance = Chance::new(budget::seed(), 0);
    let mut lives = Vec::new();
    for number in 0..8 {
        let mut life = Life::new(Some(5 * (number % 5)), 1);
        while erasures(&life.memory).is_empty() {
            let (setting, share) = (chance.below(Setting::ALL.len()), chance.below(2_000) as u16);
            life.step(Step::Set { setting, share });
            let share = chance.below(2_000) as u16;
            if erasures(&life.memory).is_empty() {
                life.step(Step::Respond { share });
            }
        }
        lives.push(life);
    }
    let (cases, mut silenced) = (budget::cases(10_000), 0);
    for seed in 0..cases {
        let mut life = lives[seed as usize % lives.len()].clone();
        life.memory.seed(chance.below(usize::MAX) as u64);
        let how = Cut::EVERY.len() - 1;
        let at = erasures(&life.memory)[0];
        let (setting, share) = (chance.below(Setting::ALL.len()), chance.below(65_536) as u16);
        let mut step = match seed / 8 % 2 {
            0 => Step::CutSet {
                setting,
                share,
                at,
                how,
            },
            _ => Step::CutRespond { share, at, how },
        };
        for _ in 0..3 {
            life.step(step);
            silenced += u32::from(!life.check(step));
            let at = [0, 1, RECORD_WORDS, RECORD_WORDS + 1][chance.below(4)];
            step = Step::CutStart { at, how };
        }
    }
    assert_eq!(silenced, 0, "of {cases}");
}
