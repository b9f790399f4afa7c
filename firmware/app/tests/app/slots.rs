//! Contents of slots, as a store finds them.

use embassy_futures::block_on;
use model_format::limits::{MAX_LIBRARY_BYTES, MAX_TEXTURES, SLOT_BYTES};
use model_format::link::{SlotFault, SlotId, SlotState};
use model_format::{SAMPLE_RATE_HZ, encode};
use stylus_app::slots::{SlotStore, WORD_BYTES};
use stylus_app::upload::Uploader;

use fake_stylus::flash::{Memory, SimulatedFlash};
use fake_stylus::library::{library, small_texture, upload};

/// Flash with two libraries; the one in slot B is newer.
fn two_libraries() -> (Memory, Vec<u8>, Vec<u8>) {
    let (first, second) = (library(1, 10, 1), library(3, 20, 2));
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        for (bytes, slot) in [&first, &second].into_iter().zip(SlotId::ALL) {
            let committed = upload(&mut Uploader::new(), &mut store, bytes, 512).await;
            assert_eq!(committed.map(|library| library.slot), Ok(slot));
        }
    });
    (flash.memory, first, second)
}

fn opened(memory: Memory) -> SlotStore<SimulatedFlash<'static>> {
    block_on(SlotStore::open(SimulatedFlash::new(memory)))
}

fn fault_of(store: &SlotStore<SimulatedFlash<'_>>, slot: SlotId) -> SlotFault {
    match store.state(slot) {
        SlotState::Faulty(fault) => fault.clone(),
        state => panic!("slot {slot} is {state:?}"),
    }
}

#[test]
fn a_word_that_faults_makes_a_slot_invalid_wherever_it_is() {
    let (memory, _, second) = two_libraries();
    let offsets = [0, 32, second.len() / 2, second.len() - 1, MAX_LIBRARY_BYTES];
    for offset in offsets {
        let mut memory = memory.clone();
        memory.set_faulty(SLOT_BYTES + offset);
        if offset == MAX_LIBRARY_BYTES {
            assert_eq!(
                opened(memory.clone()).newest(),
                Some(SlotId::B),
                "the header has a copy"
            );
            memory.set_faulty(SLOT_BYTES + offset + WORD_BYTES);
        }
        let store = opened(memory);
        let offset = (offset / 32 * 32) as u32;
        assert_eq!(fault_of(&store, SlotId::B), SlotFault::Unreadable { offset });
        assert_eq!(store.newest(), Some(SlotId::A));
    }
    // Outside of the library a faulty word does no harm.
    let mut memory = memory;
    memory.set_faulty(SLOT_BYTES + second.len().next_multiple_of(32));
    assert_eq!(opened(memory).newest(), Some(SlotId::B));
}

#[test]
fn a_slot_that_goes_bad_while_the_device_runs_is_not_handed_out() {
    let (memory, first, _) = two_libraries();
    let mut flash = SimulatedFlash::new(memory);
    // Opening the store reads each word once, and returning the library reads each word again.
    flash.wears_out = Some((64, 2));
    let mut store = block_on(SlotStore::open(flash));
    assert_eq!(
        block_on(store.library_bytes(SlotId::A)).map(<[u8]>::len),
        Ok(first.len())
    );
    let fault = SlotFault::Unreadable { offset: 64 };
    assert_eq!(block_on(store.library_bytes(SlotId::A)), Err(fault.clone()));
    assert_eq!(*store.state(SlotId::A), SlotState::Faulty(fault));
}

#[test]
fn the_last_of_256_textures_is_listed_and_all_are_counted() {
    let textures: Vec<_> = (0..MAX_TEXTURES)
        .map(|index| small_texture(&format!("texture {index}"), 1, SAMPLE_RATE_HZ))
        .collect();
    let bytes = encode(&textures).expect("within the limits");
    block_on(async {
        let mut store = SlotStore::open(SimulatedFlash::two_slots()).await;
        let committed = upload(&mut Uploader::new(), &mut store, &bytes, 512).await;
        assert_eq!(committed.map(|library| library.textures), Ok(256));
        let last = store.texture(SlotId::A, u8::MAX).await;
        assert_eq!(
            last.map(|texture| texture.name.as_str().to_owned()),
            Ok("texture 255".to_owned())
        );
    });
}
