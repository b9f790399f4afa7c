//! Starts after histories of uploads, activations, self tests, losses of power at any operation of the flash, refusals
//! of the flash, and damage of words: some unreadable, some that read differently from read to read.
//!
//! Checked after each step and each start:
//!
//! - If a slot held an intact library, and no upload was allowed to replace the last one, an intact library remains.
//! - The library in RAM was uploaded, is whole, and has the checksum that `status` reports.
//! - The library of the newest answered commit is active after a start, unless its slot was damaged.
//! - An upload is refused because of the last library only if the other slot holds no intact one.
//! - At the end an upload succeeds, by the remedies that the refusals name, and its library is active after the next
//!   start.
//!
//! A library is intact (`sound`) if it can be read and decoded, none of its words is damaged, and a word with its
//! header is not.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embassy_futures::block_on;
use fake_stylus::BoardOf;
use fake_stylus::device::{SharedControl, SteppedStylus, Stores};
use fake_stylus::flash::{Cut, Damage, Fate, Memory, Mishap, SimulatedFlash};
use fake_stylus::library::{announcement, chunks, put, small};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{LIBRARY_CRC, SelfTestRequest, SlotId, SlotState, UploadBegin, UploadError};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use stylus_app::flash::WORD_BYTES;
use stylus_app::slots::SlotStore;

use crate::budget;

/// Chunk of an upload, bytes.
const CHUNK: usize = 2 * WORD_BYTES;

/// Polls of a job between two milliseconds of the device.
const POLLS_PER_MS: u32 = 8;

/// Largest number of polls of a job; a job with more is stuck.
const MOST_POLLS: u32 = 2_000_000;

/// A request or event.
#[derive(Clone, Copy, Debug)]
enum Action {
    /// Sends this number of a library's chunks, and the commit after the last chunk. It may replace the last library.
    Upload {
        library: usize,
        chunks: usize,
        replaces_last: bool,
    },
    Abort,
    Activate(SlotId),
    SelfTest(SlotId),
    List(SlotId),
    Restart,
    Damage(SlotId, Place, Damage),
}

impl Action {
    /// True if the action may replace the last library.
    fn replaces_last(self) -> bool {
        matches!(
            self,
            Self::Upload {
                replaces_last: true,
                ..
            }
        )
    }
}

/// Place of a word in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Header,
    First,
    Last,
}

impl Place {
    const ALL: [Self; 3] = [Self::Header, Self::First, Self::Last];

    fn offset(self, slot: SlotId) -> usize {
        let within = match self {
            Self::Header => MAX_LIBRARY_BYTES,
            Self::First => 0,
            // All libraries here have the same length.
            Self::Last => libraries()[0].len() - 1,
        };
        slot.index() * SLOT_BYTES + within
    }
}

/// An action, and a mishap at one of its flash operations.
#[derive(Clone, Copy, Debug)]
struct Step {
    action: Action,
    mishap: Option<(usize, Mishap)>,
}

fn libraries() -> [Vec<u8>; 3] {
    ["denim", "paper", "linen"].map(small)
}

/// Number of operations of a whole upload: two erasures, each word, the header and its copy.
fn upload_operations() -> usize {
    2 + libraries()[0].len().div_ceil(WORD_BYTES) + 2
}

/// Checksums of the intact libraries in the flash itself, after a start, which renews what a cut has left.
fn sound_checksums(memory: &Memory) -> [Option<u32>; 2] {
    let mut flash = SimulatedFlash::new(memory.clone());
    let store = block_on(SlotStore::open(&mut flash));
    let libraries = SlotId::ALL.map(|slot| store.library(slot));
    let memory = flash.memory;
    SlotId::ALL.map(|slot| {
        let begin = slot.index() * SLOT_BYTES;
        let info = libraries[slot.index()]?;
        let mut headers = (begin + MAX_LIBRARY_BYTES..begin + SLOT_BYTES).step_by(WORD_BYTES);
        let has_header = headers.any(|at| {
            // A flipped bit is in the first byte.
            memory.bytes()[at..].starts_with(b"HTXS") && !memory.is_damaged(at..at + WORD_BYTES)
        });
        let is_sound = has_header && !memory.is_damaged(begin..begin + info.length as usize);
        is_sound.then_some(info.crc32)
    })
}

/// Whether the library of each slot is intact in the flash itself.
fn sound(memory: &Memory) -> [bool; 2] {
    sound_checksums(memory).map(|checksum| checksum.is_some())
}

/// A commit that was answered.
#[derive(Clone, Copy, Debug)]
struct Commit {
    slot: SlotId,
    crc32: u32,
}

/// A stylus, and what its answers have promised.
struct Life {
    stylus: Option<SteppedStylus>,
    fate: Fate,
    /// Slots that hold an intact library, as far as answers and damage show.
    sound: [bool; 2],
    newest: Option<Commit>,
    /// True if a later commit was cut by a loss of power: it may have been completed.
    may_be_newer: bool,
    /// Words with a flipped bit, which a second flip would repair.
    flipped: Vec<(SlotId, Place)>,
    libraries: [Vec<u8>; 3],
}

type Checked = Result<(), String>;

impl Life {
    fn new(memory: Memory) -> Result<Self, String> {
        let mut life = Self {
            stylus: None,
            fate: Fate::default(),
            sound: [false; 2],
            newest: None,
            may_be_newer: false,
            flipped: Vec::new(),
            libraries: libraries(),
        };
        life.boot(memory)?;
        Ok(life)
    }

    fn stylus(&mut self) -> &mut SteppedStylus {
        self.stylus.as_mut().expect("it is on")
    }

    fn state(&mut self, slot: SlotId) -> SlotState {
        self.stylus().storage.slots().slots[slot.index()].clone()
    }

    fn boot(&mut self, memory: Memory) -> Checked {
        self.sound = sound(&memory);
        let flash = SimulatedFlash::new(memory);
        self.fate = flash.fate.clone();
        self.stylus = Some(SteppedStylus::boot_from(flash));
        self.check_ram()?;
        let active = self.stylus().storage.slots().active;
        if self.sound != [false; 2] && active.is_none() {
            return Err(format!("{:?} are sound and nothing is active", self.sound));
        }
        if let Some(Commit { slot, crc32 }) = self.newest
            && self.sound[slot.index()]
        {
            let status = self.stylus().control.borrow().status();
            let is_newest = (active, status.library_crc32) == (Some(slot), crc32);
            let is_later = self.may_be_newer && active == Some(slot.other());
            if !is_newest && !is_later {
                return Err(format!("slot {slot} was committed last and {active:?} is active"));
            }
        }
        Ok(())
    }

    /// Turns the device off and returns the memory of its flash.
    fn power_off(&mut self) -> Memory {
        self.stylus.take().expect("it is on").storage.into_flash().0.memory
    }

    /// Runs `job` until it is done; none if power is lost before.
    fn run<R>(&mut self, job: impl AsyncFnOnce(&mut Stores, &mut SharedControl) -> R) -> Result<Option<R>, String> {
        let fate = self.fate.clone();
        let SteppedStylus { control, storage } = self.stylus();
        let mut stage = control.clone();
        let mut job = pin!(job(storage, &mut stage));
        let mut context = Context::from_waker(Waker::noop());
        for polls in 1..MOST_POLLS {
            if let Poll::Ready(result) = job.as_mut().poll(&mut context) {
                return Ok(Some(result));
            }
            if fate.is_off() {
                return Ok(None);
            }
            if polls % POLLS_PER_MS == 0 {
                control.millisecond_with_motion();
            }
        }
        Err("a job does not end".to_owned())
    }

    fn step(&mut self, step: Step) -> Checked {
        if let Some((operations, mishap)) = step.mishap {
            self.fate.strike(operations, mishap);
        }
        self.act(step.action)?;
        self.fate.spare();
        if self.fate.is_off() {
            return self.restart_after_cut(step.action);
        }
        self.check_ram()?;
        self.note_lost(step.action.replaces_last())
    }

    /// Updates the intact slots by the store's view, in which only an erasure makes one invalid.
    fn note_lost(&mut self, may_end_last: bool) -> Checked {
        let before = self.sound;
        for slot in SlotId::ALL {
            let is_valid = matches!(self.state(slot), SlotState::Valid(_));
            self.sound[slot.index()] &= is_valid;
            if !is_valid && self.newest.is_some_and(|newest| newest.slot == slot) {
                self.newest = None;
            }
        }
        if before != [false; 2] && self.sound == [false; 2] && !may_end_last {
            return Err(format!("of {before:?} nothing is left"));
        }
        Ok(())
    }

    fn restart_after_cut(&mut self, action: Action) -> Checked {
        let before = self.sound;
        self.may_be_newer |= matches!(action, Action::Upload { .. });
        let memory = self.power_off();
        let left = sound(&memory);
        if before != [false; 2] && left == [false; 2] && !action.replaces_last() {
            return Err(format!("a cut leaves nothing of {before:?}"));
        }
        // The slot of the newest commit may have been claimed by another upload.
        let checksums = sound_checksums(&memory);
        self.newest = self
            .newest
            .filter(|newest| checksums[newest.slot.index()] == Some(newest.crc32));
        self.boot(memory)
    }

    fn act(&mut self, action: Action) -> Checked {
        match action {
            Action::Upload {
                library,
                chunks,
                replaces_last,
            } => {
                let answer = self.upload(library, chunks, replaces_last)?;
                if let Some(Err(UploadError::LastLibrary { slot })) = answer {
                    return self.check_refusal(slot);
                }
            }
            Action::Abort => {
                self.run(async |storage, stage| storage.upload_abort(stage))?;
            }
            Action::Activate(slot) => {
                self.run(async |storage, stage| storage.activate(stage, slot).await)?;
            }
            Action::List(slot) => {
                let request = model_format::link::ListRequest { slot, index: 0 };
                self.run(async |storage, _| storage.list(request).await)?;
            }
            Action::SelfTest(slot) => {
                let request = SelfTestRequest::Flash {
                    slot,
                    erases_library: true,
                };
                self.run(async |storage, stage| {
                    let mut board = BoardOf::new(stage.clone());
                    storage.self_test(stage, &mut board, request).await
                })?;
            }
            Action::Restart => {
                let memory = self.power_off();
                let left = sound(&memory);
                // Damage of words that were erased meanwhile is gone, so more slots may be intact.
                if SlotId::ALL
                    .iter()
                    .any(|slot| self.sound[slot.index()] && !left[slot.index()])
                {
                    return Err(format!("{:?} should be sound, {left:?} are", self.sound));
                }
                return self.boot(memory);
            }
            Action::Damage(slot, place, damage) => {
                if damage == Damage::Flipped {
                    if self.flipped.contains(&(slot, place)) {
                        return Ok(());
                    }
                    self.flipped.push((slot, place));
                }
                self.fate.damage(place.offset(slot), damage);
                // The header has a copy.
                self.sound[slot.index()] &= place == Place::Header;
                // The next read or operation applies the damage.
                let listed = Action::List(slot);
                return self.act(listed);
            }
        }
        Ok(())
    }

    fn check_refusal(&self, slot: SlotId) -> Checked {
        if self.sound[slot.other().index()] {
            return Err(format!(
                "slot {slot} is kept for the last one and {} is sound",
                slot.other()
            ));
        }
        Ok(())
    }

    /// Uploads `chunks` chunks, and commits after the last one. None if power is lost.
    fn upload(
        &mut self,
        library: usize,
        count: usize,
        replaces_last: bool,
    ) -> Result<Option<Result<(), UploadError>>, String> {
        let bytes = self.libraries[library].clone();
        let begin = UploadBegin {
            replaces_last,
            ..announcement(&bytes)
        };
        let done = self.run(async |storage, stage| {
            let begun = storage.upload_begin(stage, begin).await?;
            let mut rest = chunks(&bytes, begun.next_offset as usize, CHUNK);
            for chunk in rest.by_ref().take(count) {
                storage.upload_chunk(stage, chunk).await?;
            }
            if rest.next().is_some() {
                return Ok(None);
            }
            storage.upload_commit(stage).await.map(Some)
        })?;
        Ok(match done {
            Some(Ok(Some(committed))) => {
                self.note_lost(replaces_last)?;
                self.sound[committed.slot.index()] = true;
                self.flipped.retain(|&(slot, _)| slot != committed.slot);
                self.newest = Some(Commit {
                    slot: committed.slot,
                    crc32: begin.crc32,
                });
                self.may_be_newer = false;
                Some(Ok(()))
            }
            Some(Ok(None)) => Some(Ok(())),
            Some(Err(error)) => Some(Err(error)),
            None => None,
        })
    }

    fn check_ram(&mut self) -> Checked {
        let mut control = self.stylus().control.borrow_mut();
        let status = control.status();
        let ram = control.device().library().to_vec();
        drop(control);
        if status.active.is_none() {
            return Ok(());
        }
        if LIBRARY_CRC.checksum(&ram) != status.library_crc32 || !self.libraries.contains(&ram) {
            return Err("what is active is no library that was uploaded".to_owned());
        }
        Ok(())
    }

    /// Uploads by the remedies that the refusals name, and finds the library active after a start.
    fn end(&mut self) -> Checked {
        let memory = self.power_off();
        self.boot(memory)?;
        let mut answer = self.upload(0, usize::MAX, false)?;
        for replaces_last in [false, true] {
            if let Some(Err(UploadError::LastLibrary { slot })) = answer {
                self.check_refusal(slot)?;
                self.act(Action::Activate(slot))?;
                answer = self.upload(0, usize::MAX, replaces_last)?;
            }
        }
        if answer != Some(Ok(())) {
            return Err(format!("the store cannot be used any more: {answer:?}"));
        }
        let memory = self.power_off();
        self.boot(memory)
    }
}

/// Flash at the beginning of a history: libraries in the slots, with these sequence numbers.
fn beginning(numbers: [Option<u32>; 2]) -> Memory {
    let mut memory = Memory::blank(2 * SLOT_BYTES);
    let libraries = libraries();
    for slot in SlotId::ALL {
        if let Some(number) = numbers[slot.index()] {
            put(&mut memory, slot, &libraries[slot.index()], number);
        }
    }
    memory
}

fn live(numbers: [Option<u32>; 2], seed: u64, steps: &[Step]) -> Checked {
    let mut memory = beginning(numbers);
    memory.seed(seed);
    let mut life = Life::new(memory)?;
    for (index, &step) in steps.iter().enumerate() {
        life.step(step)
            .map_err(|problem| format!("step {index}, {step:?}: {problem}"))?;
    }
    life.end().map_err(|problem| format!("at the end: {problem}"))
}

fn slot() -> impl Strategy<Value = SlotId> {
    prop::sample::select(SlotId::ALL.to_vec())
}

fn action() -> impl Strategy<Value = Action> {
    let chunks = prop_oneof![3 => Just(usize::MAX), 1 => 0..8usize];
    prop_oneof![
        6 => (0..3usize, chunks, prop::bool::weighted(0.15)).prop_map(
            |(library, chunks, replaces_last)| Action::Upload { library, chunks, replaces_last }
        ),
        1 => Just(Action::Abort),
        3 => slot().prop_map(Action::Activate),
        1 => slot().prop_map(Action::SelfTest),
        1 => slot().prop_map(Action::List),
        2 => Just(Action::Restart),
        3 => (
            slot(),
            prop::sample::select(Place::ALL.to_vec()),
            prop::sample::select(Damage::ALL.to_vec()),
        ).prop_map(|(slot, place, damage)| Action::Damage(slot, place, damage)),
    ]
}

fn mishap() -> impl Strategy<Value = Option<(usize, Mishap)>> {
    let how = prop_oneof![
        4 => prop::sample::select(Cut::WITH_UNSTABLE.to_vec()).prop_map(Mishap::Cut),
        1 => Just(Mishap::Refuse),
    ];
    prop::option::weighted(0.4, (0..upload_operations() + 1, how))
}

fn numbers() -> impl Strategy<Value = [Option<u32>; 2]> {
    let number = prop_oneof![
        1 => Just(None),
        2 => (1..4u32).prop_map(Some),
        1 => (u32::MAX - 2..=u32::MAX).prop_map(Some),
    ];
    // If both slots have numbers, these are adjacent, as uploads leave them, or equal.
    (number, 0..3u32, any::<bool>()).prop_map(|(first, ahead, both)| {
        let second = first.map(|first: u32| first.wrapping_add(ahead).wrapping_sub(1));
        [first, second.filter(|_| both)]
    })
}

#[test]
fn no_history_of_cuts_damage_and_requests_loses_a_sound_library_or_the_use_of_the_store() {
    let steps = (action(), mishap()).prop_map(|(action, mishap)| Step { action, mishap });
    let histories = (numbers(), any::<u64>(), prop::collection::vec(steps, 1..14));
    let config = ProptestConfig {
        failure_persistence: None,
        ..budget::config(1_500)
    };
    let lived = TestRunner::new(config).run(&histories, |(numbers, seed, steps)| {
        live(numbers, seed, &steps).map_err(TestCaseError::fail)
    });
    if let Err(failure) = lived {
        panic!("with STYLUS_ATTACK_SEED={}: {failure}", budget::seed());
    }
}
