//! Uploads that fail for other reasons than a loss of power.

use embassy_futures::block_on;
use embassy_futures::poll_once;
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{
    FlashOperation, MAX_CHUNK_BYTES, SlotFault, SlotId, SlotState, UploadBegin, UploadChunk, UploadError, UploadState,
};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;

use fake_stylus::flash::{Memory, Mishap, SimulatedFlash};
use fake_stylus::library::{announcement, chunks, library, upload};

type Store = SlotStore<SimulatedFlash<'static>>;

/// Flash with a library in slot A.
fn flash_with_library() -> (Memory, Vec<u8>) {
    let bytes = library(1, 4, 1);
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        upload(&mut Uploader::new(), &mut store, &bytes, 512)
            .await
            .expect("slot A");
    });
    (flash.memory, bytes)
}

/// A device with a library in slot A that is active.
fn device() -> (Uploader, Store, Vec<u8>) {
    let (memory, bytes) = flash_with_library();
    let mut store = block_on(SlotStore::open(SimulatedFlash::new(memory)));
    store.set_active(store.newest());
    (Uploader::new(), store, bytes)
}

/// Begins the upload of `bytes` and sends its first chunks.
fn begun(uploader: &mut Uploader, store: &mut Store, bytes: &[u8], count: usize) {
    block_on(async {
        let begun = uploader.begin(store, announcement(bytes)).await;
        assert_eq!(begun.map(|progress| progress.next_offset), Ok(0));
        for chunk in chunks(bytes, 0, MAX_CHUNK_BYTES).take(count) {
            let sent = uploader.chunk(store, chunk).await;
            assert!(sent.is_ok(), "{sent:?}");
        }
    });
}

fn assert_library_is_left(store: &mut Store, bytes: &[u8]) {
    assert_eq!(store.active(), Some(SlotId::A));
    assert_eq!(block_on(store.library_bytes(SlotId::A)), Ok(bytes));
}

#[test]
fn a_library_as_large_as_a_slot_and_one_byte_more() {
    let (mut uploader, mut store, _) = device();
    let mut begin = |length: u32| {
        let begin = UploadBegin {
            length,
            crc32: 0,
            replaces_last: false,
        };
        let begun = block_on(uploader.begin(&mut store, begin));
        uploader.abort(&mut store);
        begun.map(drop)
    };
    assert_eq!(begin(MAX_LIBRARY_BYTES as u32), Ok(()));
    for length in [0, MAX_LIBRARY_BYTES as u32 + 1, u32::MAX] {
        assert_eq!(begin(length), Err(UploadError::Length { length }));
    }
}

#[test]
fn chunks_out_of_turn_are_refused_and_change_nothing() {
    let (mut uploader, mut store, old) = device();
    let data = &[0x33; 4096];
    let offset = 0;
    let early = block_on(uploader.chunk(&mut store, UploadChunk { offset, data }));
    assert_eq!(early, Err(UploadError::NotBegun));
    let new = library(1, 30, 2);
    let total = new.len() as u32;
    begun(&mut uploader, &mut store, &new, 1);
    let state = uploader.state();
    let expected = 512;
    let out_of_turn = [0, 1024].map(|found| {
        let error = UploadError::Offset { expected, found };
        (found, 512, error)
    });
    let of_bad_length = [0, 33, 513].map(|length| {
        let error = UploadError::ChunkLength { length };
        (expected, length, error)
    });
    for (offset, length, error) in out_of_turn.into_iter().chain(of_bad_length) {
        let data = &data[..length as usize];
        let sent = block_on(uploader.chunk(&mut store, UploadChunk { offset, data }));
        assert_eq!(sent, Err(error));
        assert_eq!(uploader.state(), state);
    }
    let (next_offset, length) = (expected, total);
    let incomplete = UploadError::Incomplete { next_offset, length };
    assert_eq!(block_on(uploader.commit(&mut store)), Err(incomplete));
    assert_eq!(*store.state(SlotId::B), SlotState::Receiving);
    // The upload still succeeds.
    assert!(block_on(upload(&mut uploader, &mut store, &new, 512)).is_ok());
    assert_library_is_left(&mut store, &old);
    let (length, end) = (40, 64);
    let begin = UploadBegin {
        length,
        crc32: 0,
        replaces_last: false,
    };
    let data = &data[..64];
    let past = block_on(async {
        uploader.begin(&mut store, begin).await?;
        uploader.chunk(&mut store, UploadChunk { offset: 0, data }).await
    });
    assert_eq!(past, Err(UploadError::PastEnd { end, length }));
}

#[test]
fn an_upload_goes_on_where_it_was_another_begins_anew_and_one_that_is_given_up_leaves_the_way_free() {
    let (mut uploader, mut store, old) = device();
    let (new, other) = (library(1, 30, 2), library(1, 30, 3));
    begun(&mut uploader, &mut store, &new, 1);
    let again = block_on(uploader.begin(&mut store, announcement(&new)));
    let next_offset = again.map(|progress| progress.next_offset);
    assert_eq!(next_offset, Ok(MAX_CHUNK_BYTES as u32));
    begun(&mut uploader, &mut store, &other, 1);
    uploader.abort(&mut store);
    assert_eq!(uploader.state(), UploadState::Idle);
    assert!(matches!(store.state(SlotId::B), SlotState::Faulty(_)));
    let ended = block_on(uploader.commit(&mut store));
    assert_eq!(ended, Err(UploadError::NotBegun));
    assert!(block_on(upload(&mut uploader, &mut store, &other, 32)).is_ok());
    let bytes = block_on(store.library_bytes(SlotId::B));
    assert_eq!(bytes, Ok(&other[..]));
    assert_library_is_left(&mut store, &old);
}

#[test]
fn bytes_that_are_no_library_or_not_those_announced_are_not_sealed() {
    let (mut uploader, mut store, old) = device();
    let noise: Vec<u8> = (0..5_000u32).map(|n| (n * 7 + n / 251) as u8).collect();
    let error = block_on(upload(&mut uploader, &mut store, &noise, 512));
    assert!(
        matches!(&error, Err(UploadError::Invalid { reason }) if reason.contains("HTXL")),
        "{error:?}"
    );
    assert_eq!(uploader.state(), UploadState::Idle);
    let announced = library(1, 30, 2);
    let mut sent = announced.clone();
    sent[100] ^= 1;
    let (expected, found) = (announcement(&announced).crc32, announcement(&sent).crc32);
    begun(&mut uploader, &mut store, &announced, 0);
    let error = block_on(async {
        for chunk in chunks(&sent, 0, 512) {
            uploader.chunk(&mut store, chunk).await?;
        }
        uploader.commit(&mut store).await
    });
    assert_eq!(error, Err(UploadError::Checksum { expected, found }));
    assert_eq!(store.newest(), Some(SlotId::A));
    assert_library_is_left(&mut store, &old);
}

/// Uploads into a device with a mishap at the operation `at`, and returns the error. Checks that the old library is
/// still there and that the next upload succeeds.
fn with_mishap(at: usize, mishap: Mishap) -> Option<UploadError> {
    let new = library(1, 30, 2);
    let (memory, old) = flash_with_library();
    let flash = SimulatedFlash::new(memory);
    flash.fate.strike(at, mishap);
    let mut store = block_on(SlotStore::open(flash));
    store.set_active(store.newest());
    let mut uploader = Uploader::new();
    let result = block_on(upload(&mut uploader, &mut store, &new, 512));
    assert_eq!(block_on(store.library_bytes(SlotId::A)), Ok(&old[..]));
    if result.is_err() {
        assert_eq!(store.newest(), Some(SlotId::A));
        // The fault happens once.
        let again = block_on(upload(&mut uploader, &mut store, &new, 512));
        assert!(again.is_ok(), "{again:?}");
    }
    result.err()
}

#[test]
fn a_fault_of_the_flash_is_told_with_its_place() {
    let words = library(1, 30, 2).len().div_ceil(32);
    let slot = SlotId::B;
    let header = MAX_LIBRARY_BYTES as u32;
    let (erase, write) = (FlashOperation::Erase, FlashOperation::Write);
    // Operation 0 erases the header's sector, operation 1 the first sector, and operation 2 writes the first word; the
    // header comes last.
    for (at, operation, offset) in [
        (0, erase, 3 * 128 * 1024),
        (1, erase, 0),
        (2, write, 0),
        (5, write, 96),
        (2 + words, write, header),
    ] {
        let error = UploadError::Flash {
            slot,
            operation,
            offset,
        };
        assert_eq!(with_mishap(at, Mishap::Refuse), Some(error), "{at}");
    }
    for (at, offset) in [(7, 160), (2 + words, header)] {
        let error = UploadError::ReadBack { slot, offset };
        assert_eq!(with_mishap(at, Mishap::Corrupt), Some(error), "{at}");
    }
    // The last operation writes the header's copy, without which the library is stored, too.
    assert_eq!(with_mishap(3 + words, Mishap::Refuse), None);
}

#[test]
fn a_commit_reads_each_word_once_and_what_it_reads_is_what_it_validates() {
    let new = library(1, 30, 2);
    let (memory, _) = flash_with_library();
    let mut flash = SimulatedFlash::new(memory);
    // One read after the word was written, one in the commit.
    let offset = 64;
    flash.wears_out = Some((SLOT_BYTES + offset, 2));
    let mut store = block_on(SlotStore::open(flash));
    store.set_active(store.newest());
    let uploaded = block_on(upload(&mut Uploader::new(), &mut store, &new, 512));
    assert_eq!(uploaded.map(|committed| committed.slot), Ok(SlotId::B));
    let offset = offset as u32;
    assert_eq!(
        block_on(store.library_bytes(SlotId::B)),
        Err(SlotFault::Unreadable { offset }),
        "no read was left"
    );
}

#[test]
fn a_call_that_is_dropped_half_way_ends_the_upload() {
    let (mut uploader, mut store, old) = device();
    let new = library(1, 30, 2);
    begun(&mut uploader, &mut store, &new, usize::MAX);
    // A commit yields while it reads. If its caller drops it there, the upload ends.
    assert!(poll_once(uploader.commit(&mut store)).is_pending());
    assert_eq!(uploader.state(), UploadState::Idle);
    assert_eq!(store.newest(), Some(SlotId::A));
    assert!(block_on(upload(&mut uploader, &mut store, &new, 512)).is_ok());
    assert_library_is_left(&mut store, &old);
}
