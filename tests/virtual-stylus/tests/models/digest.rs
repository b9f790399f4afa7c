//! The kernel on the emulated part, with the device's own arithmetic, plays the words of every other platform.

use kernel_vectors::DIGESTED;
use virtual_stylus::Options;

use crate::probe;

#[test]
fn the_emulated_part_plays_the_digest_that_every_platform_plays() {
    let mut stylus = probe::ready(Options::default());
    let answer = probe::ask(&mut stylus, b'd', 4);
    let [digest] = probe::words(&answer)[..] else {
        panic!("{answer:?}");
    };
    assert_eq!(digest, DIGESTED, "{digest:08x}");
}
