//! Losses of power at the operations of an upload, in four ways: each leaves the old library or the new one, and a
//! device that accepts the next upload. Also two faults in succession that leave one library, which nothing erases
//! unasked.

use embassy_futures::block_on;
use fake_stylus::device::SteppedStylus;
use fake_stylus::flash::{Cut, Fate, Memory, Mishap, Operation, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, library, put, small, upload};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES, SLOT_HEADER_BYTES};
use model_format::link::{
    LIBRARY_CRC, MAX_CHUNK_BYTES, SlotFault, SlotId, SlotState, UploadBegin, UploadError, UploadProgress,
};
use stylus_app::slots::{SlotStore, WORD_BYTES};
use stylus_app::upload::Uploader;

use crate::budget::{self, Chance};
use crate::update::polled;

/// Uploads `bytes` like a device after its boot, and returns the slot that takes them.
fn uploaded(flash: &mut SimulatedFlash<'_>, bytes: &[u8]) -> SlotId {
    block_on(async {
        let mut store = SlotStore::open(flash).await;
        store.set_active(store.newest());
        upload(&mut Uploader::new(), &mut store, bytes, MAX_CHUNK_BYTES).await
    })
    .expect("it is valid")
    .slot
}

/// Flash after uploads of `libraries`, the first of them into slot A.
fn after_uploads(libraries: &[&[u8]]) -> Memory {
    let mut flash = SimulatedFlash::two_slots();
    for (bytes, slot) in libraries.iter().zip(SlotId::ALL.into_iter().cycle()) {
        assert_eq!(uploaded(&mut flash, bytes), slot);
    }
    flash.memory
}

/// Checksum of the library that a device with `memory` boots with.
fn booted(memory: Memory) -> Option<u32> {
    block_on(async {
        let mut store = SlotStore::open(SimulatedFlash::new(memory)).await;
        let slot = store.newest()?;
        let bytes = store.library_bytes(slot).await.ok()?;
        Some(LIBRARY_CRC.checksum(bytes))
    })
}

/// Loses power at every erasure, at the header, and at one in 500 of the other writes, and uploads again after some of
/// these.
#[test]
fn a_cut_of_a_full_upload_leaves_the_old_library_or_the_new() {
    const SHARE: usize = 500;
    let (old, new, slot) = (library(1, 4, 1), library(5, 400, 2), SlotId::B);
    // The library reaches into the header's sector.
    assert!(new.len() > 3 * SECTOR_BYTES, "{}", new.len());
    let [old_crc, new_crc] = [&old, &new].map(|bytes| Some(announcement(bytes).crc32));
    // The header follows the last word of a slot's library area, and its write makes the library valid. The header's
    // copy comes last.
    let header = ((slot.index() + 1) * SLOT_BYTES - SLOT_HEADER_BYTES) / WORD_BYTES;
    let mut chance = Chance::new(budget::seed(), 0);
    let (mut cuts, mut sealed) = (0, 0);
    let mut cut = |memory: &Memory, operation: Operation| {
        let is_header = matches!(operation, Operation::Write { word, .. } if word == header);
        let is_copy = matches!(operation, Operation::Write { word, .. } if word > header);
        let is_erasure = matches!(operation, Operation::Erase { .. });
        if !is_header && !is_copy && !is_erasure && chance.below(SHARE) >= budget::cases(1) as usize {
            return;
        }
        for how in Cut::ALL {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            let found = booted(memory.clone());
            let is_sealed = is_copy || is_header && how == Cut::After;
            let expected = if is_sealed { new_crc } else { old_crc };
            assert_eq!(found, expected, "cut {cuts}, {how:?} {operation:?}");
            sealed += usize::from(is_sealed);
            if cuts % 97 == 0 {
                let mut flash = SimulatedFlash::new(memory);
                uploaded(&mut flash, &new);
                assert_eq!(booted(flash.memory), new_crc);
            }
            cuts += 1;
        }
    };
    let mut flash = SimulatedFlash::observed(after_uploads(&[&old]), &mut cut);
    assert_eq!(uploaded(&mut flash, &new), slot);
    assert_eq!(booted(flash.memory.clone()), new_crc);
    drop(flash);
    assert!(sealed == 1 + Cut::ALL.len() && cuts > 40, "{sealed} {cuts}");
}

/// Offset of the header in a slot.
const HEADER: usize = MAX_LIBRARY_BYTES;

/// Flash with a library in each slot, with these numbers.
fn two(sequences: [u32; 2]) -> Memory {
    let mut memory = Memory::blank(2 * SLOT_BYTES);
    put(&mut memory, SlotId::A, &small("a"), sequences[0]);
    put(&mut memory, SlotId::B, &small("b"), sequences[1]);
    memory
}

fn boot(memory: &Memory) -> (SteppedStylus, Fate) {
    let flash = SimulatedFlash::new(memory.clone());
    let fate = flash.fate.clone();
    (SteppedStylus::boot_from(flash), fate)
}

fn memory_of(stylus: SteppedStylus) -> Memory {
    stylus.storage.into_flash().0.memory
}

fn begin(stylus: &mut SteppedStylus, bytes: &[u8], replaces_last: bool) -> Result<UploadProgress, UploadError> {
    let begin = UploadBegin {
        replaces_last,
        ..announcement(bytes)
    };
    stylus.request(async |storage, stage| storage.upload_begin(stage, begin).await)
}

fn is_valid(stylus: &SteppedStylus, slot: SlotId) -> bool {
    matches!(stylus.storage.slots().slots[slot.index()], SlotState::Valid(_))
}

#[test]
fn a_library_whose_copy_fails_leaves_the_other_one_active_at_a_start() {
    let mut hardware = Hardware::new();
    hardware.bad_loads = 1;
    let flash = SimulatedFlash::new(two([1, 2]));
    let mut stylus = SteppedStylus::boot_from_on(flash, hardware);
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
    // Both libraries can be read, so the newer one may be replaced.
    let begun = begin(&mut stylus, &small("new"), false);
    assert_eq!(begun.map(|progress| progress.slot), Ok(SlotId::B));
}

#[test]
fn without_an_active_library_an_upload_goes_to_the_older_one() {
    for (sequences, older) in [([1, 2], SlotId::A), ([2, 1], SlotId::B)] {
        let mut hardware = Hardware::new();
        hardware.bad_loads = u32::MAX;
        let mut stylus = SteppedStylus::boot_from_on(SimulatedFlash::new(two(sequences)), hardware);
        assert_eq!(stylus.storage.slots().active, None);
        let begun = begin(&mut stylus, &small("new"), false);
        assert_eq!(begun.map(|progress| progress.slot), Ok(older));
    }
}

#[test]
fn a_slot_that_could_not_be_read_at_the_start_and_can_be_now_is_not_erased_for_one_that_cannot() {
    let new = small("new");
    for good in SlotId::ALL {
        // The good slot reads wrongly while the device starts, and right from then on.
        for broken in [0, 32, HEADER] {
            let mut memory = two([1, 2]);
            // Of the header, the copy too.
            for word in [broken, broken + WORD_BYTES] {
                memory.set_faulty(good.other().index() * SLOT_BYTES + word);
            }
            let mut flash = SimulatedFlash::new(memory);
            flash.recovers = Some((good.index() * SLOT_BYTES + 32, 1));
            let mut stylus = SteppedStylus::boot_from(flash);
            assert_eq!(stylus.storage.slots().active, None);
            assert!(!is_valid(&stylus, good));
            let begun = begin(&mut stylus, &new, false).expect("the broken slot is free");
            assert_eq!(begun.slot, good.other());
            assert!(is_valid(&stylus, good));
        }
    }
}

#[test]
fn an_upload_is_numbered_above_a_library_that_cannot_be_read_now() {
    let new = small("new");
    let mut flash = SimulatedFlash::new(two([9, 3]));
    flash.recovers = Some((0, 8));
    flash.memory.set_faulty(SLOT_BYTES);
    let mut store = block_on(SlotStore::open(&mut flash));
    assert_eq!(store.newest(), None);
    let committed = block_on(upload(&mut Uploader::new(), &mut store, &new, 512)).expect("slot B is free");
    assert_eq!((committed.slot, committed.sequence), (SlotId::B, 10));
}

/// Flash after an upload of `new` beside `old`, with power lost in the word of the header.
fn cut_at_header(old: &[u8], new: &[u8], cut: Cut) -> Memory {
    let mut flash = SimulatedFlash::new(after_uploads(&[old]));
    // Two sectors are erased and the words are written before.
    let header = 2 + new.len().div_ceil(WORD_BYTES);
    flash.fate.strike(header, Mishap::Cut(cut));
    let uploaded = polled(async {
        let mut store = SlotStore::open(&mut flash).await;
        store.set_active(store.newest());
        upload(&mut Uploader::new(), &mut store, new, MAX_CHUNK_BYTES).await
    });
    assert!(uploaded.is_none());
    flash.memory
}

/// Starts on `memory`, with power lost in the first operation if there is a `cut`. Returns the slot of the newest
/// library; none after a loss of power.
fn start(memory: &mut Memory, cut: Option<Cut>) -> Option<SlotId> {
    let mut flash = SimulatedFlash::new(std::mem::replace(memory, Memory::blank(0)));
    if let Some(cut) = cut {
        flash.fate.strike(0, Mishap::Cut(cut));
    }
    let newest = polled(async { SlotStore::open(&mut flash).await.newest() });
    *memory = flash.memory;
    newest.flatten()
}

#[test]
fn a_library_whose_commit_was_cut_stays_the_newest_once_a_start_has_found_it() {
    let (old, new) = (small("old"), small("new"));
    let header = (SLOT_BYTES + HEADER) / WORD_BYTES;
    let shares = [5, 10, 30, 100, 300, 500].map(Some);
    let again = Cut::WITH_UNSTABLE.map(Some);
    for (share, seed) in shares
        .into_iter()
        .chain([None])
        .flat_map(|share| (1..=10).map(move |seed| (share, seed)))
    {
        for cut in again.into_iter().chain([None]) {
            let how = if share.is_some() { Cut::After } else { Cut::Unstable };
            let mut memory = cut_at_header(&old, &new, how);
            memory.seed(seed * 1000);
            if let Some(per_mille) = share {
                memory.set_marginal(header, per_mille);
            }
            // Power may be lost again while the header is written once more.
            let _ = start(&mut memory, cut);
            let found: Vec<_> = (0..20).map(|_| start(&mut memory, None)).collect();
            let is_new = |newest: &Option<SlotId>| *newest == Some(SlotId::B);
            let first = found.iter().position(is_new).expect("a start finds it");
            assert!(share.is_none() || first == 0, "{share:?} {seed} {cut:?}");
            assert!(found[first..].iter().all(is_new), "{share:?} {seed} {cut:?}: {found:?}");
            memory.set_faulty(header * WORD_BYTES);
            assert_eq!(
                start(&mut memory, None),
                Some(SlotId::B),
                "it needs the word that was cut"
            );
        }
    }
}

#[test]
fn a_start_after_commits_that_were_not_cut_writes_nothing() {
    let mut flash = SimulatedFlash::new(after_uploads(&[&small("old"), &small("new")]));
    block_on(SlotStore::open(&mut flash));
    assert_eq!(flash.operations, 0);
}

#[test]
fn a_header_that_could_not_be_written_is_erased_so_that_it_is_not_right_another_time() {
    let new = small("new");
    let words = new.len().div_ceil(32);
    let mut memory = Memory::blank(2 * SLOT_BYTES);
    put(&mut memory, SlotId::A, &small("a"), 1);
    let (mut stylus, fate) = boot(&memory);
    // Two sectors are erased, the words are written, then the header.
    fate.strike(2 + words, Mishap::Refuse);
    let failed = stylus.upload(&new);
    assert!(matches!(failed, Err(UploadError::Flash { .. })), "{failed:?}");
    let memory = memory_of(stylus);
    assert!(!memory.is_damaged(SLOT_BYTES + HEADER..SLOT_BYTES + HEADER + 32));
    let (stylus, _) = boot(&memory);
    let unfinished = SlotState::Faulty(SlotFault::Unfinished);
    assert_eq!(stylus.storage.slots().slots[1], unfinished);
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
}

#[test]
fn in_safe_mode_the_slots_are_not_read_until_a_request_needs_them() {
    let boot = || {
        let mut hardware = Hardware::new();
        hardware.start.safe_mode = true;
        SteppedStylus::boot_from_on(SimulatedFlash::new(two([1, 2])), hardware)
    };
    let stylus = boot();
    assert_eq!(stylus.status().active, None);
    assert_eq!(stylus.storage.into_flash().0.reads, 0);
    let mut stylus = boot();
    stylus.request(async |storage, _| storage.read_slots().await);
    assert!(SlotId::ALL.iter().all(|&slot| is_valid(&stylus, slot)));
    // No slot is active, so the older library is replaced.
    let begun = begin(&mut stylus, &small("new"), false);
    assert_eq!(begun.map(|progress| progress.slot), Ok(SlotId::A));
}
