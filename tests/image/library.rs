//! Libraries, and flash contents with these libraries. The application's own store has written them on this computer.

use embassy_futures::block_on;
use fake_stylus::device::change;
use fake_stylus::flash::{Memory, SimulatedFlash};
use fake_stylus::library::{library, upload};
use model_format::encode;
use model_format::limits::MAX_ORDER;
use model_format::link::{MAX_CHUNK_BYTES, Setting, SettingSet};
use stylus_app::settings::{SETTINGS_RANGE, SettingsStore};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;
use virtual_stylus::Options;
use virtual_stylus::model::flash::{BASE, BYTES, Contents};

use crate::requests::default_of;

/// The textures that every processor must play identically to the bit; about 25 KB.
pub fn small() -> Vec<u8> {
    encode(&kernel_vectors::specs()).expect("within the limits")
}

/// Another library of one texture, of about 50 KB.
pub fn middling() -> Vec<u8> {
    library(1, 200, 1)
}

/// A library of one texture of about 8 KB.
pub fn other() -> Vec<u8> {
    library(1, 25, 2)
}

/// Four textures of the highest order, which fill three quarters of a slot.
pub fn large() -> Vec<u8> {
    library(4, MAX_ORDER, 3)
}

/// Flash with `libraries` in its slots, the last one the newest, and with the required settings of the coil.
pub fn flash_with(libraries: &[&[u8]]) -> Contents {
    flash_set(libraries, &[])
}

/// Like [`flash_with`], with further settings. They are set here because a change made by the image would take as long
/// as a start.
fn flash_set(libraries: &[&[u8]], further: &[(Setting, f32)]) -> Contents {
    let slots = block_on(async {
        let mut flash = SimulatedFlash::two_slots();
        for library in libraries {
            let mut store = SlotStore::open(&mut flash).await;
            upload(&mut Uploader::new(), &mut store, library, MAX_CHUNK_BYTES)
                .await
                .expect("a valid library");
        }
        flash.memory
    });
    let settings = block_on(async {
        let flash = SimulatedFlash::new(Memory::blank(SETTINGS_RANGE.end as usize));
        let mut store = SettingsStore::open(flash, SETTINGS_RANGE).await;
        let required = SettingSet::REQUIRED.iter().map(default_of);
        let further = further.iter().map(|&(setting, value)| change(setting, value));
        let values: Vec<_> = required.chain(further).collect();
        store.set_all(&values).await.expect("within their ranges");
        store.into_flash().memory
    });
    let mut contents = Contents::default();
    let mut place = |at: usize, bytes: &[u8]| {
        let address = u64::from(BASE) + at as u64;
        contents.place(address, bytes).expect("it is in the flash");
    };
    // The slots are the whole of bank 2.
    place(BYTES / 2, slots.bytes());
    let range = SETTINGS_RANGE.start as usize..SETTINGS_RANGE.end as usize;
    place(range.start, &settings.bytes()[range]);
    contents
}

/// Options of a run with [`small`] in a slot.
pub fn options() -> Options {
    with(&small())
}

/// Options of a run with [`small`] in a slot and with these settings.
pub fn set_to(settings: &[(Setting, f32)]) -> Options {
    of(flash_set(&[&small()], settings))
}

/// Options of a run with `library` in a slot.
pub fn with(library: &[u8]) -> Options {
    of(flash_with(&[library]))
}

/// Options of a run that continues with this flash, as after a power cut.
pub fn after(flash: Contents) -> Options {
    Options {
        keep_flash: true,
        watch_ticks: false,
        ..of(flash)
    }
}

/// Options of a run with this flash.
pub fn of(flash: Contents) -> Options {
    Options {
        flash,
        ..Options::default()
    }
}
