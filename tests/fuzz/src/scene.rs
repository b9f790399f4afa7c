//! Scenes as TOML.

use std::path::Path;
use std::sync::OnceLock;

use host_tools::scene::{SceneFile, with_scenes};
use model_format::{CodeSpec, Library, NodeSpec, Provenance, TextureSpec, encode};

use crate::place;

/// A library of one texture, `silk`.
fn library() -> &'static [u8] {
    static LIBRARY: OnceLock<Vec<u8>> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let node = NodeSpec::new(1.0, CodeSpec::lattice(vec![8000, -4000]));
        let texture = TextureSpec {
provenance: Provenance::Recorded,
..TextureSpec::new("silk", &[100.0], &[1.0], vec![node])
};
        encode(&[texture]).expect("it is sound")
    })
}

/// Judges `input` as a scene's text.
pub fn judge(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/scene.toml");
    let file = match SceneFile::from_toml(path, text) {
        Ok(file) => file,
        Err(error) => return place::check(&error, path, input),
    };
    // A response could be any file of this computer.
    let equaliser = file.description().equaliser.as_ref();
    if equaliser.is_some_and(|equaliser| equaliser.response.is_some()) {
        return;
    }
    let library = Library::decode(library()).expect("it was encoded");
    let compiled = match file.compile(&library) {
        Ok(compiled) => compiled,
        Err(error) => return place::check(&error, path, input),
    };
    let bytes = with_scenes(&library, std::slice::from_ref(&compiled.scene))
        .expect("a library has room for a scene");
    let again = Library::decode(&bytes).expect("it was encoded");
    assert_eq!(again.scenes().next().as_ref(), Some(&compiled.scene));
}
