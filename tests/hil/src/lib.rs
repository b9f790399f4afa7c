//! Hardware in the loop: the tests of the firmware that a real board can run, over its link and its probe.
//!
//! `cargo tasks hil` runs them on a board, and `tests/run long` on the virtual stylus. Every result depends only on the
//! device's own clock and counters: a test waits for milliseconds of the device, not of this computer. An emulator that
//! is slower than real time therefore passes and fails for the same reasons as a board.
//!
//! | module | subject |
//! |---|---|
//! | [`board`] | reset and flashing: a probe, the virtual stylus, or neither |
//! | [`bench`](mod@bench) | the device under test, its clock, and motions while something plays |
//! | [`checks`] | the tests by subject: what plays nothing, what plays, what is about time, and faults |
//! | [`library`] | what is uploaded and played |
//! | [`report`] | a line per test, and the summary |
//! | [`suite`] | order of the tests; settings and library saved before and restored after |
//!
//! Invariant: a test that cannot run is reported as such and does not count as passed. A run in which no test passed
//! fails.

pub mod bench;
pub mod board;

/// The tests by subject. Each takes the bench and adds its lines to the report. A failure of the link or
/// of the device ends the subject, not the run.
pub mod checks {
    pub mod faults;
    pub mod playing;
    pub mod silent;
    pub mod timing;
}

pub mod library;
pub mod report;
pub mod suite;
