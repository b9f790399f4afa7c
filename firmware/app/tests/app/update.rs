//! Updates: what the device refuses before anything is erased, and the bootloader on flash that loses power.

use std::cell::Cell;
use std::iter;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embassy_futures::block_on;
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use embedded_storage_async::nor_flash::{NorFlash as AsyncNorFlash, ReadNorFlash as AsyncReadNorFlash};
use fake_stylus::device::{SteppedStylus, play_request};
use fake_stylus::flash::{Cut, Memory, Mishap, Operation, SECTOR_BYTES, SimulatedError, SimulatedFlash};
use fake_stylus::library;
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{
    BoardName, DEVELOPMENT_SEED, ImageVersion, MAX_CHUNK_BYTES, MAX_IMAGE_BYTES, ResetReason, SelfTestError, SlotId,
    TRIAL_MS, UNSIGNED, UpdateBegin, UpdateError, UpdatePhase, UpdateReport, UploadError,
};
use proptest::prelude::*;
use stylus_app::update::{DEVELOPMENT_KEY, Running, Updates, sign};
use stylus_boot::loader;
use stylus_boot::map::{ACTIVE, BANK_BYTES, FLASH, RECORDS, SLOTS, WORD_BYTES};
use stylus_boot::record::{EXCHANGED, FLASH_FAILED, Record, Store, mark};

use crate::self_test::{flash, measure};

const FLASH_BYTES: usize = 2 * BANK_BYTES;
const VERSION: ImageVersion = ImageVersion::new([2, 3, 4]);

/// A blocking driver of the simulated flash, until power is lost.
struct Blocking<'a>(SimulatedFlash<'a>);

impl Blocking<'_> {
    /// After a loss of power nothing is done any more.
    fn operate<R>(
        &mut self,
        operation: impl AsyncFnOnce(&mut SimulatedFlash<'_>) -> Result<R, SimulatedError>,
    ) -> Result<R, NorFlashErrorKind> {
        if self.0.fate.is_off() {
            return Err(NorFlashErrorKind::Other);
        }
        polled(operation(&mut self.0))
            .and_then(Result::ok)
            .ok_or(NorFlashErrorKind::Other)
    }
}

/// Returns the result of `work`; none if power is lost, after which `work` waits forever.
pub fn polled<R>(work: impl Future<Output = R>) -> Option<R> {
    // Many more than the operations of one call.
    const POLLS: usize = 10_000;
    let mut work = pin!(work);
    let mut poll = || {
        let mut context = Context::from_waker(Waker::noop());
        work.as_mut().poll(&mut context)
    };
    (0..POLLS).find_map(|_| match poll() {
        Poll::Ready(done) => Some(done),
        Poll::Pending => None,
    })
}

impl ErrorType for Blocking<'_> {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Blocking<'_> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.operate(async |flash| AsyncReadNorFlash::read(flash, offset, bytes).await)
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for Blocking<'_> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.operate(async |flash| AsyncNorFlash::erase(flash, from, to).await)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.operate(async |flash| AsyncNorFlash::write(flash, offset, bytes).await)
    }
}

/// Bytes that are different for each `seed`, for an image or other content.
fn pattern(seed: u32, length: usize) -> Vec<u8> {
    let byte = |at: usize| (at as u32 ^ seed).wrapping_mul(0x9E37_79B9) >> 24;
    (0..length).map(|at| byte(at) as u8).collect()
}

/// An image of `length` bytes: the [`pattern`] of `seed` with two vectors, stack and reset, at its beginning.
fn image(seed: u32, length: usize) -> Vec<u8> {
    let mut bytes = pattern(seed, length);
    bytes[..4].copy_from_slice(&0x2000_D400_u32.to_le_bytes());
    bytes[4..8].copy_from_slice(&(FLASH + ACTIVE.start + 0x401).to_le_bytes());
    bytes
}

/// A device with an image, a library in the first slot, settings, and a committed update in the second slot.
struct Committed {
    memory: Memory,
    old: Vec<u8>,
    new: Vec<u8>,
}

fn committed() -> Committed {
    let images = received();
    let memory = recorded(images.memory, COMMIT);
    Committed { memory, ..images }
}

/// Record of the commit.
const COMMIT: Record = Record::marked(mark::SWAP, 1, [2, 3, 5]);

/// The device of [`committed`] before the word of the commit is written.
fn received() -> Committed {
    let [mut code, mut slots] = [Memory::blank(BANK_BYTES), Memory::blank(BANK_BYTES)];
    let (old, mut new) = (image(1, ACTIVE.len()), image(2, 290_000));
    code.program(ACTIVE.start as usize, &old);
    code.program(RECORDS.end as usize, &pattern(3, 2 * SECTOR_BYTES));
    // The rest of the slot is not blank either, so that a change anywhere in it shows.
    let library = library::library(1, 4, 1);
    library::put(&mut slots, SlotId::A, &library, 1);
    let rest = library.len().next_multiple_of(WORD_BYTES);
    slots.program(rest, &pattern(4, MAX_LIBRARY_BYTES - rest));
    slots.program(SLOT_BYTES, &new);
    let memory = code.joined(slots);
    new.resize(ACTIVE.len(), 0xFF);
    Committed { memory, old, new }
}

/// `memory` with this record.
pub fn recorded(memory: Memory, record: Record) -> Memory {
    block_on(async {
        let mut store = Store::open(SimulatedFlash::new(memory), RECORDS).await;
        store.replace(record).await.expect("it is kept");
        store.into_flash().memory
    })
}

fn record(memory: &Memory) -> Record {
    block_on(Store::open(SimulatedFlash::new(memory.clone()), RECORDS)).record()
}

fn part(memory: &Memory, range: std::ops::Range<u32>) -> &[u8] {
    &memory.bytes()[range.start as usize..range.end as usize]
}

/// Causes of a reset, as bits 28:21 of `RCC_RSR`.
const POWER_ON: u8 = 1 << 2;
const SOFTWARE: u8 = 1 << 3;
const WATCHDOG: u8 = 1 << 5;

/// Runs the bootloader after power-on, with a mishap; returns the flash afterwards, and true if power was not lost.
fn boot(memory: Memory, mishap: Option<(usize, Cut)>) -> (Memory, bool) {
    boot_after(POWER_ON, memory, mishap)
}

/// As [`boot`], after a reset by `cause`.
fn boot_after(cause: u8, memory: Memory, mishap: Option<(usize, Cut)>) -> (Memory, bool) {
    let (memory, is_ready, holds) = booted(cause, memory, mishap);
    assert!(is_ready || !holds);
    (memory, holds)
}

/// As [`boot_after`]; also returns true if the bootloader finds an image to start.
fn booted(cause: u8, memory: Memory, mishap: Option<(usize, Cut)>) -> (Memory, bool, bool) {
    let flash = SimulatedFlash::new(memory);
    if let Some((operations, cut)) = mishap {
        flash.fate.strike(operations, Mishap::Cut(cut));
    }
    let mut flash = Blocking(flash);
    let prepared = loader::prepare(&mut flash, cause, || {});
    let holds = !flash.0.fate.is_off();
    (flash.0.memory, prepared.is_ok(), holds)
}

/// All operations of the bootloader on `memory`.
fn operations(memory: &Memory) -> Vec<Operation> {
    let mut seen = Vec::new();
    let observed = SimulatedFlash::observed(memory.clone(), |_, operation| seen.push(operation));
    loader::prepare(Blocking(observed), 0, || {}).expect("the flash works");
    seen
}

/// Numbers of operations at which losses of power may differ: all except the words within a copied sector, of which the
/// first and last count.
fn edges(operations: &[Operation]) -> Vec<usize> {
    let is_inner = |operation: &Operation| match operation {
        Operation::Erase { .. } => false,
        Operation::Write { word, .. } => {
            let offset = (word * WORD_BYTES) as u32;
            let at = word * WORD_BYTES % SECTOR_BYTES;
            !RECORDS.contains(&offset) && (WORD_BYTES..SECTOR_BYTES - WORD_BYTES).contains(&at)
        }
    };
    operations
        .iter()
        .enumerate()
        .filter(|(_, operation)| !is_inner(operation))
        .map(|(number, _)| number)
        .collect()
}

/// Boots `before` after a bite of the watchdog, with a loss of power at each of `cuts`, then to the end. Asserts that a
/// whole image is active and everything else is unchanged. Returns the flash, and true if the active image is the new
/// one.
fn survives(before: &Memory, cuts: &[(usize, Cut)], images: &Committed) -> (Memory, bool) {
    let after = iter::once(WATCHDOG)
        .chain(iter::repeat(POWER_ON))
        .zip(cuts)
        .fold(before.clone(), |memory, (cause, cut)| {
            boot_after(cause, memory, Some(*cut)).0
        });
    let (after, holds) = boot(after, None);
    let active = part(&after, ACTIVE);
    let is_new = active == images.new;
    assert!(holds && (is_new || active == images.old), "{cuts:?}");
    assert!(kept(&after) == kept(before), "{cuts:?}");
    (after, is_new)
}

#[test]
fn a_cut_at_any_operation_of_an_exchange_or_of_the_way_back_ends_with_a_whole_image() {
    let images = committed();
    let (trial, _) = boot(images.memory.clone(), None);
    assert!(part(&trial, ACTIVE) == images.new);
    for (before, goes_back) in [(&images.memory, false), (&trial, true)] {
        let operations = operations(before);
        let mut counts = [0; 2];
        for (case, number) in edges(&operations).into_iter().enumerate() {
            for cut in Cut::WITH_UNSTABLE {
                let (after, is_new) = survives(before, &[(number, cut)], &images);
                counts[usize::from(is_new)] += 1;
                if goes_back {
                    let Record { cause, version, .. } = record(&after);
                    assert_eq!((is_new, version), (false, [2, 3, 5]));
                    // The first operation writes the cause.
                    let is_kept = cause == WATCHDOG || number == 0 && cause == POWER_ON;
                    assert!(is_kept, "{cut:?} at {number}: {cause:#b}");
                    continue;
                }
                // A loss of power at the end is a reset on the trial, which restores the old image.
                assert!(is_new || number + 1 == operations.len(), "{cut:?} at {number}");
                if is_new && case.is_multiple_of(8) {
                    let (after, _) = boot_after(SOFTWARE, after, None);
                    assert!(part(&after, ACTIVE) == images.old, "{cut:?} at {number}");
                    let Record { marks, cause, .. } = record(&after);
                    assert_eq!((marks[0], cause), (mark::REVERT, SOFTWARE));
                }
            }
        }
        println!("{counts:?} times the old and the new image");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn two_cuts_of_an_exchange_end_with_a_whole_image(
        first in 0..24_600_usize, second in 0..24_600_usize, cuts in (0..5_usize, 0..5_usize),
    ) {
        let [one, other] = [cuts.0, cuts.1].map(|cut| Cut::WITH_UNSTABLE[cut]);
        let images = committed();
        survives(&images.memory, &[(first, one), (second, other)], &images);
    }

    #[test]
    fn a_record_is_the_old_one_or_the_new_one_after_a_cut_and_stays_so_once_it_is_settled(
        records in 0..600_usize, at in 0..4_usize, cut in 0..5_usize, seed: u64,
    ) {
        let numbered = |number: usize| Record::marked(mark::BOOT, 0, [number as u16; 3]);
        let mut memory = Memory::blank(RECORDS.end as usize);
        memory.seed(seed);
        let mut store = block_on(Store::open(SimulatedFlash::new(memory), RECORDS));
        for number in 0..=records {
            block_on(store.replace(numbered(number))).expect("it is kept");
        }
        let flash = store.into_flash();
        flash.fate.strike(at, Mishap::Cut(Cut::WITH_UNSTABLE[cut]));
        let mut store = block_on(Store::open(flash, RECORDS));
        let has_power = polled(store.replace(numbered(records + 1))).is_some();
        let memory = store.into_flash().memory;
        let mut store = block_on(Store::open(SimulatedFlash::new(memory), RECORDS));
        block_on(store.settle()).expect("the flash works");
        let settled = store.record();
        prop_assert!(settled == numbered(records + 1) || !has_power && settled == numbered(records));
        let mut flash = store.into_flash();
        for _ in 0..10 {
            let store = block_on(Store::open(flash, RECORDS));
            prop_assert_eq!(store.record(), settled);
            flash = store.into_flash();
        }
        let mut store = block_on(Store::open(flash, RECORDS));
        block_on(store.replace(numbered(9999))).expect("the flash works");
        let store = block_on(Store::open(store.into_flash(), RECORDS));
        prop_assert_eq!(store.record(), numbered(9999));
    }
}

#[test]
fn a_settled_record_is_renewed_without_an_erasure_even_if_the_flash_fails() {
    let mut memory = Memory::blank(RECORDS.end as usize);
    for records in 0..600 {
        for fails in [false, true] {
            let erasures = Cell::new(0);
            let flash = SimulatedFlash::observed(memory.clone(), |_, operation| {
                let is_erasure = matches!(operation, Operation::Erase { .. });
                erasures.set(erasures.get() + usize::from(is_erasure));
            });
            let fate = flash.fate.clone();
            let mut store = block_on(Store::open(flash, RECORDS));
            block_on(store.settle()).expect("the flash works");
            erasures.set(0);
            if fails {
                fate.strike(0, Mishap::RefuseFrom);
            }
            for _ in 0..3 {
                let renewed = block_on(store.renew());
                assert!(renewed.is_ok() || fails, "{records} records");
            }
            assert_eq!(erasures.get(), 0, "{records} records");
        }
        memory = recorded(memory, Record::NONE);
    }
}

#[test]
fn a_slot_without_the_image_that_a_record_asks_for_is_left_alone_until_a_step_has_been_done() {
    let images = committed();
    let (trial, _) = boot(images.memory.clone(), None);
    let slot = |sector: usize| SLOTS[1].start as usize + sector * SECTOR_BYTES;
    let erase = |memory: &mut Memory, sector: usize| {
        let sector = slot(sector) / SECTOR_BYTES;
        memory.perform(Operation::Erase { sector }, Cut::After);
    };
    let library = library::library(1, 20, 1);
    // The first upload into a slot erases the header's sector, then the first sector.
    for (before, erased, after) in [
        (&images.memory, 0, (&images.old, mark::REVERT)),
        (&trial, 3, (&images.new, mark::BOOT)),
        (&trial, 1, (&images.new, mark::BOOT)),
        // The way back does not read the first sector.
        (&trial, 0, (&images.old, mark::REVERT)),
    ] {
        let mut memory = before.clone();
        erase(&mut memory, erased);
        memory.program(slot(erased), &library);
        for _ in 0..2 {
            memory = boot(memory, None).0;
            let (active, mark) = after;
            assert!(part(&memory, ACTIVE) == *active, "{erased}");
            assert_eq!(record(&memory).marks[0], mark);
        }
    }
}

/// Sector of the flash with this number in `range`.
fn sector_in(range: &std::ops::Range<u32>, number: usize) -> usize {
    range.start as usize / SECTOR_BYTES + number
}

/// Everything that no exchange may change.
fn kept(memory: &Memory) -> [&[u8]; 3] {
    [RECORDS.end..SLOTS[0].start, SLOTS[0].clone(), 0..ACTIVE.start].map(|range| part(memory, range))
}

/// Kinds of wear.
const WEAR: [Mishap; 3] = [Mishap::Protect, Mishap::Refuse, Mishap::Corrupt];

#[test]
fn with_a_worn_sector_the_old_image_or_the_new_one_starts_unless_both_need_the_sector() {
    let images = committed();
    let (trial, _) = boot(images.memory.clone(), None);
    for (before, is_back) in [(&images.memory, false), (&trial, true)] {
        for (sector, wear) in (0..7).flat_map(|sector| WEAR.map(|wear| (sector, wear))) {
            let of_active = sector < 3;
            let worn = if of_active {
                sector_in(&ACTIVE, sector)
            } else {
                sector_in(&SLOTS[1], sector - 3)
            };
            let mut memory = before.clone();
            memory.wear(Some((worn, wear)));
            let (mut memory, is_ready, _) = booted(WATCHDOG, memory, None);
            let told = format!("{sector} {wear:?} {is_back}");
            // A sector that still holds the old image needs no writing.
            assert_eq!(is_ready, !of_active || wear == Mishap::Protect && !is_back, "{told}");
            if !is_ready {
                // It stays so until the sector can be written.
                let (still, is_ready, _) = booted(POWER_ON, memory, None);
                assert!(!is_ready, "{told}");
                memory = still;
                memory.wear(None);
                memory = boot(memory, None).0;
            }
            assert!(kept(&memory) == kept(before), "{told}");
            let Record {
                marks, cause, version, ..
            } = record(&memory);
            if !is_back && sector == 3 {
                // The slot's first sector is only read on the way to the new image.
                assert!(part(&memory, ACTIVE) == images.new && marks[0] == mark::SWAP, "{told}");
                continue;
            }
            assert!(part(&memory, ACTIVE) == images.old, "{told}");
            let expected = if is_back { WATCHDOG } else { FLASH_FAILED };
            assert_eq!(
                (marks[0], cause, version),
                (mark::REVERT, expected, [2, 3, 5]),
                "{told}"
            );
        }
    }
}

#[test]
fn a_cut_at_any_operation_of_an_exchange_that_is_given_up_ends_with_the_old_image() {
    let images = committed();
    for (sector, wear) in (1..4).flat_map(|sector| WEAR.map(|wear| (sector, wear))) {
        let mut before = images.memory.clone();
        before.wear(Some((sector_in(&SLOTS[1], sector), wear)));
        for (case, number) in edges(&operations(&before)).into_iter().enumerate() {
            let cut = Cut::WITH_UNSTABLE[case % 5];
            let (after, _) = boot(before.clone(), Some((number, cut)));
            let (after, _) = boot(after, None);
            let told = format!("{sector} {wear:?} {cut:?} at {number}");
            assert!(
                part(&after, ACTIVE) == images.old && kept(&after) == kept(&before),
                "{told}"
            );
            let after = record(&after);
            assert!(!after.asks() && after.cause == FLASH_FAILED, "{told}: {after:?}");
        }
    }
}

#[test]
fn a_record_that_cannot_be_written_leaves_the_old_image_until_it_can_be_if_no_step_was_done() {
    let images = committed();
    let (trial, _) = boot(images.memory.clone(), None);
    for (before, is_ready, after) in [(&images.memory, true, &images.new), (&trial, false, &images.old)] {
        let mut memory = before.clone();
        memory.wear(Some((sector_in(&RECORDS, 0), Mishap::Protect)));
        for _ in 0..2 {
            let booted = booted(POWER_ON, memory, None);
            memory = booted.0;
            assert!(booted.1 == is_ready && memory.bytes() == before.bytes());
        }
        memory.wear(None);
        assert!(part(&boot(memory, None).0, ACTIVE) == *after);
    }
}

/// A device on trial with its second image, in two banks.
fn on_trial(images: &Committed) -> [Memory; 2] {
    let (mut code, _) = boot(images.memory.clone(), None);
    let slots = code.split_off(BANK_BYTES);
    [code, slots]
}

/// Confirms the image; the confirmation's word then fails in `per_mille` of a thousand reads. Gives the other slot to a
/// library if the device allows it, and starts many times. Returns false if the active image is not an image.
fn lives(banks: [Memory; 2], per_mille: u64, seed: u64, images: &Committed) -> bool {
    let [mut code, mut slots] = banks;
    let library = library::library(1, 20, 1);
    let mut confirmation = 0;
    for start in 0..40 {
        code.seed(seed * 1000 + start);
        let mut memory = code.joined(slots);
        // At the first start the device is on trial already.
        if start > 0 {
            memory = boot(memory, None).0;
        }
        let active = part(&memory, ACTIVE);
        if active != images.new && active != images.old {
            return false;
        }
        slots = memory.split_off(BANK_BYTES);
        let mut stylus = SteppedStylus::boot_from(SimulatedFlash::new(slots));
        stylus.storage.set_updates(updates(memory, RUNNING));
        if start == 0 {
            stylus
                .request(async |storage, stage| storage.update_confirm(stage).await)
                .expect("it is on trial");
        }
        // While the record reads as on trial, the slot cannot be given to the library.
        let is_given_up = start == 1 && stylus.upload(&library).is_ok();
        let (slots_flash, _, records) = stylus.storage.into_flash();
        (code, slots) = (records.expect("they are set").memory, slots_flash.memory);
        if start == 0 {
            let last = code.last_programmed(RECORDS.start as usize..RECORDS.end as usize);
            confirmation = last.expect("there is a record");
            code.set_marginal(confirmation, per_mille);
        }
        if is_given_up {
            let mut without = code.clone();
            without.set_faulty(confirmation * WORD_BYTES);
            assert_ne!(record(&without).marks[0], mark::SWAP, "it needs that word");
        }
    }
    true
}

#[test]
fn a_confirmation_that_was_cut_at_its_very_end_costs_no_image() {
    let images = committed();
    let trial = on_trial(&images);
    for per_mille in [5, 10, 30, 100] {
        assert_eq!(
            (1..=55)
                .filter(|&seed| !lives(trial.clone(), per_mille, seed, &images))
                .count(),
            0,
            "of 55, at {per_mille} per mille"
        );
    }
}

/// The board.
pub const BOARD: BoardName = BoardName::new("NUCLEO-H743ZI2");

/// The running image.
pub const RUNNING: Running = Running {
    board: BOARD,
    image: VERSION,
    bootloader: VERSION,
    key: DEVELOPMENT_KEY,
    takes_unsigned: false,
};

/// A device with a bootloader that has left `record`.
fn stylus(running: Running, record: Record) -> SteppedStylus {
    let mut stylus = SteppedStylus::ready(&library::library(1, 4, 1));
    let memory = recorded(Memory::blank(RECORDS.end as usize), record);
    stylus.storage.set_updates(updates(memory, running));
    stylus
}

/// Updates of the image `running`, with the record in `memory`.
pub fn updates(memory: Memory, running: Running) -> Updates<SimulatedFlash<'static>> {
    let store = block_on(Store::open(SimulatedFlash::new(memory), RECORDS));
    Updates::new(store, running)
}

fn update(stylus: &mut SteppedStylus, image: &[u8], begin: &UpdateBegin) -> Result<UpdateReport, UpdateError> {
    stylus.request(async |storage, stage| {
        storage.update_begin(stage, begin).await?;
        for chunk in library::chunks(image, 0, MAX_CHUNK_BYTES) {
            storage.upload_chunk(stage, chunk).await?;
        }
        storage.update_commit(stage).await
    })
}

fn state(stylus: &mut SteppedStylus) -> UpdateReport {
    stylus
        .request(async |storage, stage| storage.update_state(stage))
        .expect("it has a bootloader")
}

#[test]
fn an_image_is_refused_before_anything_is_erased_unless_it_is_signed_and_newer_or_allowed() {
    let image = pattern(5, 3_000);
    let signed = |image: &[u8], version| sign(BOARD, image, version, &DEVELOPMENT_SEED);
    let good = signed(&image, VERSION);
    let offered = ImageVersion::new([2, 3, 3]);
    let long = vec![0; MAX_IMAGE_BYTES as usize + 1];
    let changed = |at: usize| {
        let mut signed = good;
        signed[at] ^= 1;
        signed
    };
    let mut unsigned = good;
    unsigned[100..].copy_from_slice(&UNSIGNED);
    let length = long.len() as u32;
    let running = VERSION;
    let refused = [
        (changed(0), UpdateError::NotAnImage),
        (changed(9), UpdateError::Board),
        (signed(&[], VERSION), UpdateError::Length { length: 0 }),
        (signed(&long, VERSION), UpdateError::Length { length }),
        (changed(40), UpdateError::Signature),
        (changed(120), UpdateError::Signature),
        (sign(BOARD, &image, VERSION, &[7; 32]), UpdateError::Signature),
        (unsigned, UpdateError::Signature),
        (signed(&image, offered), UpdateError::Downgrade { running, offered }),
    ];
    let mut stylus = stylus(RUNNING, Record::NONE);
    let slots = stylus.storage.slots();
    for (signed, expected) in refused {
        let refused = update(&mut stylus, &image, &UpdateBegin::new(&image, &signed));
        assert_eq!(refused, Err(expected));
        assert_eq!(stylus.storage.slots(), slots);
    }
    let mut short = UpdateBegin::new(&image, &good);
    short.signed.pop();
    let refused = update(&mut stylus, &image, &short);
    assert_eq!(refused, Err(UpdateError::NotAnImage));
    stylus.play(play_request("texture 0")).expect("it is there");
    let played = update(&mut stylus, &image, &UpdateBegin::new(&image, &good));
    assert_eq!(played, Err(UpdateError::Playing));
    assert_eq!(stylus.storage.slots(), slots);
    assert_eq!(state(&mut stylus).phase, UpdatePhase::Confirmed);
    let mut downgrade = UpdateBegin::new(&image, &signed(&image, offered));
    downgrade.allow_downgrade = true;
    let held = Running {
        takes_unsigned: true,
        ..RUNNING
    };
    let unsigned = UpdateBegin::new(&image, &unsigned);
    for (running, begin) in [(RUNNING, downgrade), (held, unsigned)] {
        let mut stylus = self::stylus(running, Record::NONE);
        update(&mut stylus, &image, &begin).expect("it is allowed");
    }
}

#[test]
fn an_update_asks_for_the_exchange_and_a_restart_and_leaves_the_active_library() {
    let image = pattern(5, 140_001);
    let mut stylus = stylus(RUNNING, Record::NONE);
    let active = stylus.storage.slots().active.expect("it is ready");
    let begin = UpdateBegin::new(&image, &sign(BOARD, &image, VERSION, &DEVELOPMENT_SEED));
    let report = update(&mut stylus, &image, &begin).expect("it is signed");
    assert_eq!(report.phase, UpdatePhase::Committed { version: VERSION });
    assert!(stylus.storage.wants_restart());
    assert!(stylus.play(play_request("texture 0")).is_err());
    let uploaded = stylus.upload(&library::library(1, 4, 2));
    assert_eq!(uploaded.map(drop), Err(UploadError::Busy));
    assert!(stylus.storage.slots().active == Some(active));
}

#[test]
fn bytes_other_than_the_signed_ones_are_not_committed() {
    let image = pattern(5, 3_000);
    let mut stylus = stylus(RUNNING, Record::NONE);
    let begin = UpdateBegin::new(&image, &sign(BOARD, &image, VERSION, &DEVELOPMENT_SEED));
    let refused = update(&mut stylus, &pattern(6, 3_000), &begin);
    assert_eq!(refused, Err(UpdateError::Digest));
    assert!(!stylus.storage.wants_restart());
    assert_eq!(state(&mut stylus).phase, UpdatePhase::Confirmed);
    stylus.play(play_request("texture 0")).expect("it plays on");
}

#[test]
fn an_update_that_is_refused_on_trial_leaves_a_device_that_plays_and_can_be_confirmed() {
    let image = pattern(5, 3_000);
    let mut stylus = stylus(RUNNING, trial());
    let begin = UpdateBegin::new(&image, &sign(BOARD, &image, VERSION, &DEVELOPMENT_SEED));
    let refused = update(&mut stylus, &image, &begin);
    assert_eq!(refused, Err(UpdateError::Unconfirmed));
    let confirmed = stylus.request(async |storage, stage| storage.update_confirm(stage).await);
    let phase = confirmed.map(|report| report.phase);
    assert_eq!(phase, Ok(UpdatePhase::Confirmed));
    stylus.play(play_request("texture 0")).expect("it is there");
}

/// Record of a device on trial.
pub fn trial() -> Record {
    Record::marked(mark::SWAP, 1, VERSION.numbers()).with_steps(EXCHANGED)
}

#[test]
fn a_trial_ends_by_the_host_or_after_a_minute_of_health_and_an_unhealthy_one_restarts() {
    let trial = trial();
    let end = async |storage: &mut fake_stylus::device::Stores, stage: &mut _| {
        storage.end_trial(stage).await;
    };
    for by_host in [true, false] {
        let mut stylus = stylus(RUNNING, trial);
        assert!(matches!(
            state(&mut stylus).phase,
            UpdatePhase::Trial { slot: SlotId::B, .. }
        ));
        assert_eq!(
            stylus.upload(&library::library(1, 4, 2)).map(drop),
            Err(UploadError::Busy)
        );
        let erasing = measure(&mut stylus, flash(SlotId::B, true));
        assert_eq!(erasing, Err(SelfTestError::Uploading));
        if by_host {
            stylus
                .request(async |storage, stage| storage.update_confirm(stage).await)
                .expect("it is on trial");
        } else {
            stylus.request(end);
            assert!(matches!(state(&mut stylus).phase, UpdatePhase::Trial { .. }));
            stylus.run(TRIAL_MS as u32);
            stylus.request(end);
        }
        assert_eq!(state(&mut stylus).phase, UpdatePhase::Confirmed);
        let again = stylus.request(async |storage, stage| storage.update_confirm(stage).await);
        assert_eq!(again, Err(UpdateError::NotOnTrial));
        stylus.upload(&library::library(1, 4, 2)).expect("the slot is free");
    }
    let mut stylus = stylus(RUNNING, trial);
    stylus.hardware().start.safe_mode = true;
    stylus.run(TRIAL_MS as u32);
    stylus.request(end);
    assert!(stylus.storage.wants_restart());
    assert!(matches!(state(&mut stylus).phase, UpdatePhase::Trial { .. }));
}

#[test]
fn after_a_cut_in_the_word_of_a_commit_the_phase_is_that_of_the_running_image_and_stays() {
    let images = received();
    let mut told = [0; 3];
    for (seed, cut) in (0..60).zip(Cut::WITH_UNSTABLE.into_iter().cycle()) {
        let mut memory = images.memory.clone();
        memory.seed(seed * 1000);
        let flash = SimulatedFlash::new(memory);
        flash.fate.strike(0, Mishap::Cut(cut));
        let mut store = block_on(Store::open(flash, RECORDS));
        let _ = polled(store.replace(COMMIT));
        let mut memory = store.into_flash().memory;
        let mut is_asked = None;
        for _ in 0..3 {
            memory = boot(memory, None).0;
            let mut store = block_on(Store::open(SimulatedFlash::new(memory), RECORDS));
            block_on(store.settle()).expect("the flash works");
            memory = store.into_flash().memory;
            let mut stylus = SteppedStylus::ready(&library::library(1, 4, 1));
            stylus.storage.set_updates(updates(memory.clone(), RUNNING));
            let is_new = part(&memory, ACTIVE) == images.new;
            // A start does what the previous start has reported.
            assert!(is_asked.is_none_or(|is_asked| is_asked == is_new), "{cut:?}");
            match state(&mut stylus).phase {
                UpdatePhase::Trial { .. } => {
                    assert!(is_new, "{cut:?}, seed {seed}: the old image runs");
                    told[0] += 1;
                    break;
                }
                UpdatePhase::Committed { .. } => {
                    (told[1], is_asked) = (told[1] + 1, Some(true));
                    assert!(!is_new, "{cut:?}, seed {seed}");
                }
                phase => {
                    assert_eq!((phase, is_new), (UpdatePhase::Confirmed, false), "{cut:?}");
                    (told[2], is_asked) = (told[2] + 1, Some(false));
                }
            }
        }
    }
    assert!(!told.contains(&0), "{told:?}");
}

#[test]
fn a_device_that_was_rolled_back_tells_the_version_and_the_cause() {
    let mut record = Record::marked(mark::REVERT, 1, [2, 3, 5]);
    record.cause = 1 << 5 | 1 << 1;
    let phase = state(&mut stylus(RUNNING, record)).phase;
    let version = ImageVersion::new([2, 3, 5]);
    let cause = ResetReason::Watchdog;
    assert_eq!(phase, UpdatePhase::RolledBack { version, cause });
    record.cause = FLASH_FAILED;
    let phase = state(&mut stylus(RUNNING, record)).phase;
    assert_eq!(phase, UpdatePhase::GivenUp { version });
}
