//! Texts that a user writes or a command keeps: scenes and rigs as TOML, records of fits as JSON, settings as words.

use std::path::Path;
use std::sync::OnceLock;

use host_tools::fit::record::FitRecord;
use host_tools::link::settings::changes;
use host_tools::rig::RigFile;
use host_tools::scene::{SceneFile, with_scenes};
use model_format::link::SettingsChange;
use model_format::{CodeSpec, Library, NodeSpec, TextureSpec, encode};

use super::place;

/// A library of one texture, `silk`.
fn library() -> &'static [u8] {
    static LIBRARY: OnceLock<Vec<u8>> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let node = NodeSpec::new(1.0, CodeSpec::lattice(vec![8000, -4000]));
        let texture = TextureSpec::new("silk", &[100.0], &[1.0], vec![node]);
        encode(&[texture]).expect("it is sound")
    })
}

/// Checks `input` as a scene's text.
pub fn scene(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/scene.toml");
    let file = match SceneFile::from_toml(path, text) {
        Ok(file) => file,
        Err(error) => return place::check(&error, path, input),
    };
    let library = Library::decode(library()).expect("it was encoded");
    let compiled = match file.compile(&library) {
        Ok(compiled) => compiled,
        Err(error) => return place::check(&error, path, input),
    };
    let bytes = with_scenes(&library, std::slice::from_ref(&compiled.scene)).expect("a library has room for a scene");
    let again = Library::decode(&bytes).expect("it was encoded");
    assert_eq!(again.scenes().next().as_ref(), Some(&compiled.scene));
}

/// Checks `input` as a rig's description.
pub fn rig(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let path = Path::new("fuzz/rig.toml");
    match RigFile::from_toml(path, text) {
        Ok(rig) => {
            assert_eq!(rig.text(), text);
            let again = RigFile::from_toml(path, rig.text()).expect("it was read before");
            assert_eq!(again.description(), rig.description());
        }
        Err(error) => place::check(&error, path, input),
    }
}

/// Checks `input` as a record of a fit.
pub fn record(input: &[u8]) {
    let path = Path::new("fuzz/a.lib.fit.json");
    let record = match FitRecord::from_text(path, input) {
        Ok(record) => record,
        Err(error) => return place::check(&error, path, input),
    };
    let text = record.to_text().expect("a record is text");
    let again = FitRecord::from_text(path, text.as_bytes()).expect("it was written from a record");
    assert_eq!(again.to_text().expect("a record is text"), text);
}

/// Checks `input` as words of a command line.
pub fn settings(input: &[u8]) {
    let Ok(text) = std::str::from_utf8(input) else {
        return;
    };
    let words: Vec<String> = text.split('\n').map(str::to_owned).collect();
    let found = match changes(&words) {
        Ok(found) => found,
        Err(error) => {
            // The error must contain one of the words.
            let problem = error.to_string();
            assert!(words.iter().any(|word| problem.contains(word.as_str())), "{problem}");
            return;
        }
    };
    assert_eq!(2 * found.len(), words.len());
    let again: Vec<String> = found
        .iter()
        .flat_map(|change| [change.setting.spec().name.to_owned(), format!("{:?}", change.value)])
        .collect();
    let again = changes(&again).expect("they were written from changes");
    for (before, after) in found.iter().zip(&again) {
        assert_eq!(before.setting, after.setting);
        assert_eq!(before.value.is_nan(), after.value.is_nan());
        assert!(before.value.is_nan() || before.value.to_bits() == after.value.to_bits());
    }
    // Values out of range are refused with a message.
    if let Err(error) = SettingsChange::of(&found) {
        assert!(!error.to_string().is_empty());
    }
}
