//! The watchdog, the reset flags, and the memory that outlives a reset.

use virtual_stylus::{Options, Reset, ResetCause};

use crate::probe::{MILLISECOND_NS, READY_NS, ask, ready, words};

const BY_SOFTWARE: u32 = 1 << 24;
const BY_WATCHDOG: u32 = 1 << 26;
const KEPT: u32 = 0x5AFE_C0DE;
/// 1024 counts of 4 cycles of the 32 kHz LSI.
const TIMEOUT_NS: u64 = 128 * MILLISECOND_NS;

#[test]
fn a_watchdog_that_is_not_fed_resets_the_part_at_the_end_of_its_count() {
    let mut stylus = ready(Options::default());
    ask(&mut stylus, b'w', 1);
    let started_ns = stylus.now_ns();
    // The LSI must start first.
    stylus.run_for(MILLISECOND_NS / 2);
    assert_eq!(
        stylus.board(|board| board.part.watchdog.timeout_ns()),
        Some(TIMEOUT_NS)
    );
    stylus.run_for(TIMEOUT_NS - MILLISECOND_NS);
    assert!(stylus.resets().is_empty());
    stylus.run_for(2 * MILLISECOND_NS + READY_NS);
    let resets = stylus.resets();
    let [Reset { at_ns, cause }] = resets[..] else {
        panic!("{resets:?}")
    };
    assert_eq!(cause, ResetCause::Watchdog);
    assert!(at_ns.abs_diff(started_ns + TIMEOUT_NS) < MILLISECOND_NS);
    assert_eq!(
        words(&ask(&mut stylus, b'f', 8))[0] & (BY_WATCHDOG | BY_SOFTWARE),
        BY_WATCHDOG
    );
    // It starts again in the same way.
    ask(&mut stylus, b'w', 1);
    stylus.run_for(TIMEOUT_NS + READY_NS);
    assert_eq!(stylus.resets().len(), 2);
}

#[test]
fn memory_and_the_reset_flags_outlive_a_reset() {
    let mut stylus = ready(Options::default());
    let flags = words(&ask(&mut stylus, b'f', 8))[0];
    assert_eq!(flags & (BY_SOFTWARE | BY_WATCHDOG), 0);
    ask(&mut stylus, b'k', 1);
    stylus.send(b"s");
    stylus.run_for(READY_NS);
    assert_eq!(stylus.resets()[0].cause, ResetCause::Software);
    let answer = words(&ask(&mut stylus, b'f', 8));
    assert_eq!(answer[0] & BY_SOFTWARE, BY_SOFTWARE);
    assert_eq!(answer[1], KEPT);
}

#[test]
fn the_pin_resets_the_part_too() {
    let mut stylus = ready(Options::default());
    stylus.reset_by_pin();
    stylus.run_for(READY_NS);
    assert_eq!(stylus.resets()[0].cause, ResetCause::Other);
    let flags = words(&ask(&mut stylus, b'f', 8))[0];
    assert_eq!(flags & (BY_SOFTWARE | BY_WATCHDOG), 0);
}
