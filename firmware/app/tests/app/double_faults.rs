//! Two faults in a row, after which one library is left: nothing erases it unasked.

use embassy_futures::block_on;
use fake_stylus::BoardOf;
use fake_stylus::device::SteppedStylus;
use fake_stylus::flash::{Damage, Fate, Memory, Mishap, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, put, small, upload};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{
    SelfTestError, SelfTestRequest, SlotFault, SlotId, SlotState, UploadBegin, UploadError,
    UploadProgress,
};
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
fn the_last_library_is_kept_when_the_active_slot_cannot_be_read_any_more_and_the_remedy_works() {
    let new = small("new");
    for place in [0, 32, HEADER] {
        for damage in Damage::ALL {
            let (mut stylus, fate) = boot(&two([2, 1]));
            assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
            fate.damage(place, damage);
            let refused = begin(&mut stylus, &new, false);
            let slot = SlotId::B;
            assert_eq!(
                refused,
                Err(UploadError::LastLibrary { slot }),
                "{place} {damage:?}"
            );
            // What is in RAM goes on, and the remedy of the refusal leaves the good one alone.
            assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
            assert_eq!(stylus.activate(slot).map(drop), Ok(()));
            let committed = stylus.upload(&new).expect("slot A is free");
            assert_eq!(committed.slot, SlotId::A);
            assert!(is_valid(&stylus, slot));
        }
    }
}

#[test]
fn the_last_library_is_replaced_by_an_upload_that_asks_for_it() {
    let new = small("new");
    let (mut stylus, fate) = boot(&two([2, 1]));
    fate.damage(0, Damage::Faulting);
    let begun = begin(&mut stylus, &new, true).expect("it asks for it");
    assert_eq!(begun.slot, SlotId::B);
    assert_eq!(stylus.upload(&new).map(|done| done.sequence), Ok(3));
    let (stylus, _) = boot(&memory_of(stylus));
    assert_eq!(stylus.storage.slots().active, Some(SlotId::B));
}

#[test]
fn a_self_test_never_erases_the_last_library() {
    let flash = |slot| SelfTestRequest::Flash {
        slot,
        erases_library: true,
    };
    let test = |stylus: &mut SteppedStylus, slot| {
        stylus.request(async |storage, stage| {
            let mut board = BoardOf::new(stage.clone());
            let tested = storage.self_test(stage, &mut board, flash(slot)).await;
            tested.map(drop)
        })
    };
    let (mut stylus, fate) = boot(&two([2, 1]));
    fate.damage(32, Damage::Unstable);
    let slot = SlotId::B;
    assert_eq!(
        test(&mut stylus, slot),
        Err(SelfTestError::LastLibrary { slot })
    );
    assert!(is_valid(&stylus, slot));
    assert_eq!(stylus.activate(slot).map(drop), Ok(()));
    assert_eq!(test(&mut stylus, SlotId::A), Ok(()));
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

/// A header whose programming was cut may be right at one start and unreadable at the next.
#[test]
fn a_library_that_only_seems_to_be_there_is_no_reason_to_erase_the_good_one() {
    let new = small("new");
    let mut seen = 0;
    for (place, seed) in [0, HEADER]
        .into_iter()
        .flat_map(|place| (0..40).map(move |s| (place, s)))
    {
        let mut memory = two([1, 2]);
        memory.seed(seed * 977 + 5);
        memory.set_unstable(SLOT_BYTES + place);
        let (mut stylus, _) = boot(&memory);
        seen += usize::from(is_valid(&stylus, SlotId::B));
        match begin(&mut stylus, &new, false) {
            Ok(progress) => assert_eq!(progress.slot, SlotId::B, "seed {seed}"),
            Err(error) => assert_eq!(error, UploadError::LastLibrary { slot: SlotId::A }),
        }
        let (stylus, _) = boot(&memory_of(stylus));
        assert!(is_valid(&stylus, SlotId::A), "seed {seed}");
    }
    assert!(seen > 10, "{seen}");
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
fn numbers_that_wrap_or_are_the_same_leave_the_library_that_was_uploaded_last() {
    for sequences in [
        [u32::MAX, u32::MAX - 1],
        [u32::MAX - 1, u32::MAX],
        [u32::MAX, u32::MAX],
        [0, u32::MAX],
        [7, 7],
    ] {
        let mut memory = two(sequences);
        for round in 0..4 {
            let (mut stylus, _) = boot(&memory);
            let new = small(&format!("new {round}"));
            let committed = stylus.upload(&new).expect("both slots are good");
            memory = memory_of(stylus);
            let (stylus, _) = boot(&memory);
            let active = stylus.storage.slots().active;
            assert_eq!(active, Some(committed.slot), "{sequences:?}, {round}");
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
