//! Power cuts at the operations of an upload, in four ways: each leaves the old library or the new one, and a device
//! that accepts the next upload.

use embassy_futures::block_on;
use fake_stylus::flash::{Cut, Memory, Operation, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::library::{announcement, library, upload};
use model_format::limits::{SLOT_BYTES, SLOT_HEADER_BYTES};
use model_format::link::{LIBRARY_CRC, MAX_CHUNK_BYTES, SlotId};
use stylus_app::slots::{SlotStore, WORD_BYTES};
use stylus_app::upload::Uploader;

use crate::budget::{self, Chance};

/// Uploads `bytes` as a device does that has booted; the slot that takes them.
fn uploaded(flash: &mut SimulatedFlash<'_>, bytes: &[u8]) -> SlotId {
    let committed = block_on(async {
        let mut store = SlotStore::open(flash).await;
        store.set_active(store.newest());
        upload(&mut Uploader::new(), &mut store, bytes, MAX_CHUNK_BYTES).await
    });
    committed.expect("it is valid").slot
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

/// Cuts an upload of `new` into `slot` over `before` at every erasure, at the header, and at one in `share` of the
/// other
/// writes, and uploads again after some cuts. A device with `before` boots with the checksum `old`.
fn cut(before: &Memory, old: Option<u32>, new: &[u8], slot: SlotId, share: usize) {
    let new_crc = announcement(new).crc32;
    // The last word of a slot's library area is followed by its header, which ends the upload.
    let header = ((slot.index() + 1) * SLOT_BYTES - SLOT_HEADER_BYTES) / WORD_BYTES;
    let mut chance = Chance::new(budget::seed(), share as u64);
    let (mut cuts, mut sealed) = (0, 0);
    let mut cut = |memory: &Memory, operation: Operation| {
        let is_header = matches!(operation, Operation::Write { word, .. } if word == header);
        let is_erasure = matches!(operation, Operation::Erase { .. });
        if !is_header && !is_erasure && chance.below(share) >= budget::cases(1) as usize {
            return;
        }
        for how in Cut::ALL {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            let found = booted(memory.clone());
            let is_sealed = is_header && how == Cut::After;
            let expected = if is_sealed { Some(new_crc) } else { old };
            assert_eq!(found, expected, "cut {cuts}, {how:?} {operation:?}");
            sealed += usize::from(is_sealed);
            if cuts % 97 == 0 {
                let mut flash = SimulatedFlash::new(memory);
                uploaded(&mut flash, new);
                assert_eq!(booted(flash.memory), Some(new_crc));
            }
            cuts += 1;
        }
    };
    let mut flash = SimulatedFlash::observed(before.clone(), &mut cut);
    assert_eq!(uploaded(&mut flash, new), slot);
    assert_eq!(booted(flash.memory.clone()), Some(new_crc));
    drop(flash);
    assert!(sealed == 1 && cuts > 40, "{sealed} {cuts}");
}

#[test]
fn a_cut_of_a_full_upload_leaves_the_old_library_or_the_new() {
    let (old, new) = (library(1, 4, 1), library(5, 400, 2));
    // The library reaches into the header's sector.
    assert!(new.len() > 3 * SECTOR_BYTES, "{}", new.len());
    cut(
        &after_uploads(&[&old]),
        Some(announcement(&old).crc32),
        &new,
        SlotId::B,
        500,
    );
}

/// Slot B holds an older library, whose header must not become valid again.
#[test]
fn a_cut_at_any_operation_over_a_slot_that_was_full_leaves_the_old_library_or_the_new() {
    let (older, old, new) = (library(2, 30, 3), library(1, 4, 1), library(1, 40, 2));
    let before = after_uploads(&[&old, &older, &old]);
    cut(&before, Some(announcement(&old).crc32), &new, SlotId::B, 1);
}

#[test]
fn a_device_that_never_had_a_library_has_none_or_the_first() {
    let blank = Memory::blank(2 * SLOT_BYTES);
    cut(&blank, None, &library(1, 4, 2), SlotId::A, 1);
}
