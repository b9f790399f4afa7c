//! The probe image, and the exchange of commands and answers with it.

use std::path::PathBuf;

use virtual_stylus::{Options, VirtualStylus};

pub const TICK_NS: u64 = 200_000;
pub const MILLISECOND_NS: u64 = 1_000_000;
/// Time within which the image is ready for commands, ns.
pub const READY_NS: u64 = 20 * MILLISECOND_NS;

/// The image that `cargo tasks test-virtual-stylus` has built.
fn image() -> PathBuf {
    std::env::var_os("VIRTUAL_STYLUS_PROBE_IMAGE")
        .expect("set VIRTUAL_STYLUS_PROBE_IMAGE, as `cargo tasks test-virtual-stylus` does")
        .into()
}

pub fn start(options: Options) -> VirtualStylus {
    VirtualStylus::new(&image(), options).expect("the image fits the part")
}

pub fn ready(options: Options) -> VirtualStylus {
    let mut stylus = start(options);
    stylus.run_until(READY_NS);
    stylus
}

/// Sends a command and waits for `expected` bytes, at most ten seconds of virtual time.
pub fn ask(stylus: &mut VirtualStylus, command: u8, expected: usize) -> Vec<u8> {
    let mut answer = Vec::new();
    stylus.send(&[command]);
    let until = stylus.now_ns() + 10_000 * MILLISECOND_NS;
    let answered = stylus.run_until_true(until, TICK_NS / 2, |stylus| {
        answer.extend(stylus.receive().iter().map(|sent| sent.byte));
        answer.len() >= expected
    });
    assert!(answered, "{:?} was answered with {answer:?}", char::from(command));
    answer
}

pub fn words(bytes: &[u8]) -> Vec<u32> {
    let (words, _) = bytes.as_chunks();
    words.iter().map(|word| u32::from_le_bytes(*word)).collect()
}
