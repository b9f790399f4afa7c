//! The kept header is what cbindgen makes of the sources.

use std::path::Path;

const WRITE: &str = "STYLUS_WRITE_HEADER";

/// The header.
fn made() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config =
        cbindgen::Config::from_file(folder.join("cbindgen.toml")).expect("it is a configuration");
    let mut bytes = Vec::new();
    let sources = cbindgen::Builder::new().with_src(folder.join("src/exports.rs"));
    let sources = sources.with_src(folder.join("src/status.rs"));
    let bindings = sources
        .with_config(config)
        .generate()
        .expect("the sources are read");
    bindings.write(&mut bytes);
    String::from_utf8(bytes).expect("the sources are")
}

#[test]
fn the_kept_header_is_that_of_the_sources() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/stylus_player.h");
    let made = made();
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, &made).expect("it can be written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == made,
        "include/stylus_player.h is not what cbindgen makes; write it anew: \
         {WRITE}=1 cargo test -p stylus-player-c --test door header"
    );
}
