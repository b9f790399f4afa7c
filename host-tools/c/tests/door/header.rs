//! The committed header is what cbindgen makes of the sources; the shared library exports what it declares; and
//! existing declarations change only with `STYLUS_PLAYER_ABI`.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use cbindgen::Config;
use stylusplayer::STYLUS_PLAYER_ABI;

use crate::examples::{libraries, run};

const WRITE: &str = "STYLUS_WRITE_HEADER";

fn config() -> Config {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("cbindgen.toml");
    Config::from_file(file).expect("it is a configuration")
}

/// The header.
fn made(config: Config) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut bytes = Vec::new();
    let sources = cbindgen::Builder::new()
        .with_src(folder.join("src/exports.rs"))
        .with_src(folder.join("src/status.rs"));
    sources
        .with_config(config)
        .generate()
        .expect("the sources are read")
        .write(&mut bytes);
    String::from_utf8(bytes).expect("the sources are")
}

/// Declarations of the header without a comment, with empty lines between them.
fn declarations() -> String {
    made(Config {
        header: None,
        after_includes: None,
        include_guard: None,
        sys_includes: Vec::new(),
        cpp_compat: false,
        documentation: false,
        ..config()
    })
}

/// The kept file, which is made anew if [`WRITE`] is set.
fn kept(file: &str, made: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, made).expect("it can be written");
    }
    std::fs::read_to_string(&path).unwrap_or_default()
}

#[test]
fn the_kept_header_is_that_of_the_sources() {
    let (file, made) = ("include/stylus_player.h", made(config()));
    assert!(
        kept(file, &made) == made,
        "{file} is not what cbindgen makes; write it anew: \
         {WRITE}=1 cargo test -p stylus-player-c --test door header"
    );
}

#[test]
fn an_interface_keeps_its_number_only_while_its_declarations_stay() {
    let (file, made) = (format!("tests/door/abi-{STYLUS_PLAYER_ABI}.h"), declarations());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
    for declaration in std::fs::read_to_string(path).unwrap_or_default().trim().split("\n\n") {
        assert!(
            made.contains(declaration),
            "callers rely on this, which has changed: raise STYLUS_PLAYER_ABI, and rename {file}\n{declaration}"
        );
    }
    assert!(
        kept(&file, &made) == made,
        "{file} lacks what is new; write it anew: {WRITE}=1 cargo test -p stylus-player-c --test door header"
    );
}

#[test]
fn the_shared_library_exports_the_functions_of_the_header_alone() {
    let library = libraries().join("libstylusplayer.so");
    let told = run(Command::new("nm")
        .args(["--dynamic", "--defined-only", "--format=posix"])
        .arg(library));
    let exported: BTreeSet<_> = told.lines().filter_map(|line| line.split(' ').next()).collect();
    let made = declarations();
    // A function's name stands before its bracket.
    let declared = made
        .match_indices('(')
        .map(|(end, _)| &made[..end])
        .filter_map(|head| head.rsplit([' ', '*', '\n']).next());
    assert_eq!(exported, declared.collect());
}
