//! The probe image, built once, and conversations with it.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use virtual_stylus::{Options, Result, VirtualStylus};

pub const TICK_NS: u64 = 200_000;
pub const MILLISECOND_NS: u64 = 1_000_000;
/// Time within which the image is ready for commands.
pub const READY_NS: u64 = 20 * MILLISECOND_NS;

/// The image that `VIRTUAL_STYLUS_PROBE_IMAGE` names, or one built with the present toolchain.
pub fn image() -> &'static Path {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    IMAGE.get_or_init(|| {
        if let Some(named) = std::env::var_os("VIRTUAL_STYLUS_PROBE_IMAGE") {
            return named.into();
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("probe-image");
        let target = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("probe-image");
        let built = Command::new(env!("CARGO"))
            .args(["build", "--release", "--quiet", "--locked", "--target-dir"])
            .arg(&target)
            .current_dir(&folder)
            .status()
            .expect("cargo runs");
        assert!(built.success(), "the probe image does not build");
        target.join("thumbv7em-none-eabihf/release/probe-image")
    })
}

pub fn start(options: Options) -> VirtualStylus {
    VirtualStylus::new(image(), options).expect("the image fits the part")
}

pub fn ready(options: Options) -> VirtualStylus {
    let mut stylus = start(options);
    stylus.run_until(READY_NS).expect("it runs");
    stylus
}

/// Sends a command and waits for `expected` bytes, for ten seconds of virtual time at most.
pub fn try_ask(stylus: &mut VirtualStylus, command: u8, expected: usize) -> Result<Vec<u8>> {
    let mut answer = Vec::new();
    stylus.send(&[command])?;
    let until = stylus.now_ns() + 10_000 * MILLISECOND_NS;
    let answered = stylus.run_until_true(until, TICK_NS / 2, |stylus| {
        answer.extend(stylus.receive()?.iter().map(|sent| sent.byte));
        Ok(answer.len() >= expected)
    })?;
    assert!(
        answered,
        "{:?} was answered with {answer:?}",
        char::from(command)
    );
    Ok(answer)
}

pub fn ask(stylus: &mut VirtualStylus, command: u8, expected: usize) -> Vec<u8> {
    try_ask(stylus, command, expected).expect("the run goes on")
}

pub fn numbers(bytes: &[u8]) -> Vec<u16> {
    bytes
        .as_chunks::<2>()
        .0
        .iter()
        .map(|pair| u16::from_le_bytes(*pair))
        .collect()
}

pub fn words(bytes: &[u8]) -> Vec<u32> {
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|word| u32::from_le_bytes(*word))
        .collect()
}
