//! Libraries, and flash with a library in it.

use std::sync::OnceLock;

use model_format::limits::MAX_ORDER;
use model_format::{CodeSpec, NodeSpec, TextureSpec, encode};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;

use crate::device::Device;

/// The textures that every processor must play to the same bits; about 25 KB.
pub fn small() -> &'static [u8] {
    static SMALL: OnceLock<Vec<u8>> = OnceLock::new();
    SMALL.get_or_init(|| {
        encode(&kernel_vectors::specs()).expect("within the limits")
    })
}

/// Another library, of about 8 KB.
pub fn other() -> Vec<u8> {
    encode(&[grid("other", 5, 4, 200)]).expect("within the limits")
}

/// A library of about 50 KB: a texture of 15 x 8 nodes.
pub fn middling() -> Vec<u8> {
    encode(&[grid("middling", 15, 8, 200)]).expect("within the limits")
}

/// Four textures of 15 x 8 nodes of the highest order, which almost fill a slot.
pub fn large() -> Vec<u8> {
    let textures = ["one", "two", "three", "four"].map(|name| grid(name, 15, 8, MAX_ORDER));
    encode(&textures).expect("within the limits")
}

/// A texture of different lattices with small angles.
fn grid(name: &str, speeds: u16, forces: u16, order: usize) -> TextureSpec {
    let node = |number: u16| NodeSpec::new(4.0, CodeSpec::lattice(
            (0..order)
                .map(|stage| {
                    (stage as i16)
                        .wrapping_mul(7919)
                        .wrapping_add(number as i16)
                        >> 4
                })
                .collect(),
        ));
    TextureSpec::new(name, &(1..=speeds).map(|speed| f32::from(speed) * 20.0).collect::<Vec<_>>(), &(1..=forces).map(|force| f32::from(force) * 0.2).collect::<Vec<_>>(), (0..speeds * forces).map(node).collect())
}

/// Flash with [`small`] in a slot, after an upload.
pub fn flash_with_small() -> Contents {
    static FLASH: OnceLock<Contents> = OnceLock::new();
    FLASH.get_or_init(|| flash_with(small())).clone()
}

/// Flash with `library` in a slot, after an upload, and with the settings of the coil.
pub fn flash_with(library: &[u8]) -> Contents {
    let mut device = Device::started(Options::default());
    device.set_coil();
    device.upload(library);
    device.stylus.flash().expect("the run goes on")
}

/// Options of a run with `flash`.
pub fn options() -> Options {
    Options {
        flash: flash_with_small(),
        ..Options::default()
    }
}
