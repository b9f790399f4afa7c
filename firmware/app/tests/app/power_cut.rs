//! Power cuts at every operation of an upload, in four ways: each leaves the old library or the new one, and a device
//! that accepts the next upload.

use embassy_futures::block_on;
use model_format::limits::SLOT_BYTES;
use model_format::link::{LIBRARY_CRC, MAX_CHUNK_BYTES, SlotId};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;

use crate::flash::{Cut, Memory, Operation, SECTOR_BYTES, SimulatedFlash};
use crate::library::{announcement, library, upload};

/// Flash with `bytes` in slot A, as an upload leaves it.
fn with_library(bytes: &[u8]) -> Memory {
    let mut flash = SimulatedFlash::two_slots();
    let uploaded = block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        upload(&mut Uploader::new(), &mut store, bytes, MAX_CHUNK_BYTES).await
    });
    assert_eq!(uploaded.map(|library| library.slot), Ok(SlotId::A));
    flash.memory
}

/// Checksum of the library that a device with `memory` boots with.
fn booted(memory: Memory) -> Option<u32> {
    let mut flash = SimulatedFlash::new(memory);
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        let slot = store.newest()?;
        let bytes = store.library_bytes(slot).await.ok()?;
        Some(LIBRARY_CRC.checksum(bytes))
    })
}

/// Uploads once more after the cut, whatever the spare slot holds.
fn next_upload_works(memory: Memory, bytes: &[u8]) {
    let mut flash = SimulatedFlash::new(memory);
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        store.set_active(store.newest());
        let committed = upload(&mut Uploader::new(), &mut store, bytes, MAX_CHUNK_BYTES).await;
        assert_eq!(
            committed.map(|library| library.slot),
            Ok(store.newest().expect("it was committed"))
        );
    });
    assert_eq!(booted(flash.memory), Some(announcement(bytes).crc32));
}

/// Cuts an upload of `new` over `before` at every operation, and returns the number of cuts.
fn cut_everywhere(before: &Memory, old: &[u8], new: &[u8], upload_again_every: usize) -> usize {
    let (old_crc, new_crc) = (announcement(old).crc32, announcement(new).crc32);
    let (mut cuts, mut sealed) = (0, 0);
    let mut cut = |memory: &Memory, operation: Operation| {
        // The last word of a slot's library area is followed by its header; the header ends the upload.
        let is_header = matches!(operation, Operation::Write { word, .. }
            if word == (2 * SLOT_BYTES - model_format::limits::SLOT_HEADER_BYTES) / 32);
        // A cut before an operation is the cut after the previous one.
        let first = usize::from(cuts > 0);
        for &how in &Cut::ALL[first..] {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            let found = booted(memory.clone());
            let expected = if is_header && how == Cut::After {
                new_crc
            } else {
                old_crc
            };
            assert_eq!(found, Some(expected), "cut {cuts}, {how:?} {operation:?}");
            sealed += usize::from(found == Some(new_crc));
            if cuts % upload_again_every == 0 {
                next_upload_works(memory, new);
            }
            cuts += 1;
        }
    };
    let mut flash = SimulatedFlash::observed(before.clone(), &mut cut);
    let committed = block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        store.set_active(store.newest());
        upload(&mut Uploader::new(), &mut store, new, MAX_CHUNK_BYTES).await
    });
    assert_eq!(committed.map(|library| library.slot), Ok(SlotId::B));
    assert_eq!(booted(flash.memory.clone()), Some(new_crc));
    let operations = flash.operations;
    drop(flash);
    assert_eq!(cuts, operations * (Cut::ALL.len() - 1) + 1);
    assert_eq!(
        sealed, 1,
        "one cut alone, after the header, leaves the new library"
    );
    cuts
}

#[test]
fn a_cut_at_any_operation_of_a_full_upload_leaves_the_old_library_or_the_new() {
    let (old, new) = (library(1, 4, 1), library(5, 400, 2));
    // The library reaches into the header's sector.
    assert!(new.len() > 3 * SECTOR_BYTES, "{}", new.len());
    let cuts = cut_everywhere(&with_library(&old), &old, &new, 4_999);
    assert!(cuts > 3 * 15_000, "{cuts}");
}

#[test]
fn a_cut_at_any_operation_over_a_slot_that_was_full_leaves_the_old_library_or_the_new() {
    // Slot B holds an older library, whose header must not become valid again.
    let (older, old, new) = (library(2, 30, 3), library(1, 4, 1), library(1, 40, 2));
    let mut flash = SimulatedFlash::new(with_library(&older));
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        upload(&mut Uploader::new(), &mut store, &older, 512)
            .await
            .expect("slot B is taken");
        upload(&mut Uploader::new(), &mut store, &old, 512)
            .await
            .expect("slot A is taken");
        assert_eq!(store.newest(), Some(SlotId::A));
    });
    let cuts = cut_everywhere(&flash.memory, &old, &new, 97);
    assert!(cuts > 3 * 300, "{cuts}");
}

#[test]
fn a_device_that_never_had_a_library_has_none_or_the_first() {
    let new = library(1, 4, 2);
    let new_crc = announcement(&new).crc32;
    let mut found = [0, 0];
    let mut cut = |memory: &Memory, operation: Operation| {
        for how in Cut::ALL {
            let mut memory = memory.clone();
            memory.perform(operation, how);
            match booted(memory) {
                None => found[0] += 1,
                Some(crc) => {
                    assert_eq!(crc, new_crc);
                    found[1] += 1;
                }
            }
        }
    };
    let mut flash = SimulatedFlash::observed(Memory::blank(2 * SLOT_BYTES), &mut cut);
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        upload(&mut Uploader::new(), &mut store, &new, 32)
            .await
            .expect("it is taken");
    });
    drop(flash);
    assert!(found[0] > 100 && found[1] == 1, "{found:?}");
}
