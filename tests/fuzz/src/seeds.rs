//! Seeds of the fuzzer, in one folder per target. The decoder's seeds are small valid libraries: grids of one and of
//! several nodes, orders 0 to 400, every optional part, and scenes. For each parser of the host there is a small file
//! of each kind.

use std::error::Error;
use std::path::Path;

use model_format::limits::MAX_ORDER;

#[path = "../../../model-format/tests/library/bytes.rs"]
#[allow(dead_code, missing_docs, reason = "tests of the format use more of it")]
mod bytes;

use bytes::{RawLibrary, RawTexture};

/// Writes the seeds of every target into the target's folder below `root`.
pub fn write(root: &Path) -> Result<(), Box<dyn Error>> {
    #[cfg(feature = "parsers")]
    crate::parsers::seeds::write(root)?;
    let folder = root.join("decode");
    std::fs::create_dir_all(&folder)?;
    for (number, library) in libraries().iter().enumerate() {
        std::fs::write(folder.join(number.to_string()), library.bytes())?;
    }
    Ok(())
}

/// The format's own examples: a plain library, one with everything, and each texture of that one alone. Also a node of
/// the highest order.
fn libraries() -> Vec<RawLibrary> {
    let full = RawLibrary::full();
    let of_one = |texture: &RawTexture| RawLibrary {
        textures: vec![texture.clone()],
        ..RawLibrary::sound()
    };
    let mut highest = of_one(&full.textures[0]);
    let texture = &mut highest.textures[0];
    texture.parts.clear();
    (texture.speed_axis, texture.force_axis) = (vec![100.0], vec![0.5]);
    texture.nodes.drain(..2);
    texture.nodes.truncate(1);
    texture.nodes[0].order = MAX_ORDER as u16;
    texture.coefficients = vec![9; 2 * MAX_ORDER];
    full.textures
        .iter()
        .map(of_one)
        .chain([RawLibrary::sound(), highest])
        .chain([full.clone()])
        .collect()
}
