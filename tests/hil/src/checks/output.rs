//! The output at the pin, which no status shows.

use crate::bench::Bench;

/// Says what the suite cannot see without an instrument.
pub fn check(bench: &mut Bench) {
    bench.leave_out(
        "codes at the pin",
        "no converter reads PA4 here: run `stylus selftest`, or put an oscilloscope or a second ADC on PA4",
    );
    bench.leave_out(
        "mid-scale between a fault and the reset",
        "a status comes only after the restart: put a logic analyser on NRST and an oscilloscope on PA4",
    );
}
