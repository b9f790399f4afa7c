//! Two faults in a row, after which one library is left: nothing erases it unasked.

use embassy_futures::block_on;
use fake_stylus::device::SteppedStylus;
use fake_stylus::flash::{Fate, Memory, Mishap, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, put, small, upload};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{SlotFault, SlotId, SlotState, UploadBegin, UploadError, UploadProgress};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;

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

fn begin(
    stylus: &mut SteppedStylus,
    bytes: &[u8],
    replaces_last: bool,
) -> Result<UploadProgress, UploadError> {
    let begin = UploadBegin {
        replaces_last,
        ..announcement(bytes)
    };
    stylus.request(async |storage, stage| storage.upload_begin(stage, begin).await)
}

fn is_valid(stylus: &SteppedStylus, slot: SlotId) -> bool {
    matches!(
        stylus.storage.slots().slots[slot.index()],
        SlotState::Valid(_)
    )
}

#[test]
fn a_library_whose_copy_fails_leaves_the_other_one_active_at_a_start() {
    let mut hardware = Hardware::new();
    hardware.bad_loads = 1;
    let flash = SimulatedFlash::new(two([1, 2]));
    let mut stylus = SteppedStylus::boot_from_on(flash, hardware);
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
    // Both can be read, so the newer one may go.
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
            memory.set_faulty(good.other().index() * SLOT_BYTES + broken);
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
    for place in [0, HEADER] {
        let mut flash = SimulatedFlash::new(two([9, 3]));
        flash.recovers = Some((place, 8));
        flash.memory.set_faulty(SLOT_BYTES);
        let mut store = block_on(SlotStore::open(&mut flash));
        assert_eq!(store.newest(), None);
        let committed = block_on(upload(&mut Uploader::new(), &mut store, &new, 512));
        let committed = committed.expect("slot B is free");
        assert_eq!((committed.slot, committed.sequence), (SlotId::B, 10));
    }
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
    assert!(
        matches!(failed, Err(UploadError::Flash { .. })),
        "{failed:?}"
    );
    let memory = memory_of(stylus);
    assert!(!memory.is_damaged(SLOT_BYTES + HEADER..SLOT_BYTES + HEADER + 32));
    let (stylus, _) = boot(&memory);
    let unfinished = SlotState::Faulty(SlotFault::Unfinished);
    assert_eq!(stylus.storage.slots().slots[1], unfinished);
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
}

#[test]
fn in_safe_mode_the_slots_are_not_read_until_a_request_needs_them() {
    let mut hardware = Hardware::new();
    hardware.start.safe_mode = true;
    hardware.start.quick_faults = 3;
    let stylus = SteppedStylus::boot_from_on(SimulatedFlash::new(two([1, 2])), hardware);
    assert_eq!(stylus.control.borrow().status().active, None);
    assert_eq!(stylus.storage.into_flash().0.reads, 0);

    let mut hardware = Hardware::new();
    hardware.start.safe_mode = true;
    let mut stylus = SteppedStylus::boot_from_on(SimulatedFlash::new(two([1, 2])), hardware);
    let slots = stylus.request(async |storage, _| storage.read_slots().await);
    assert!(
        slots
            .slots
            .iter()
            .all(|state| matches!(state, SlotState::Valid(_)))
    );
    // Nothing is active, so the older one goes.
    let begun = begin(&mut stylus, &small("new"), false);
    assert_eq!(begun.map(|progress| progress.slot), Ok(SlotId::A));
}
