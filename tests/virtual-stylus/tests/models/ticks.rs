//! Cost of the tick's handler.

use virtual_stylus::Options;
use virtual_stylus::tick::TickStatistics;

use crate::probe::{READY_NS, TICK_NS, ready};

#[test]
fn every_tick_is_counted_and_one_without_a_branch_always_costs_the_same() {
    let mut stylus = ready(Options::default());
    stylus.audit_ticks(10);
    stylus.run_for(READY_NS);
    let ticks = stylus.take_ticks();
    let latches = stylus.take_dac_record().len() - 1;
    assert!(
        latches.abs_diff(ticks.len()) <= 1,
        "{latches} triggers, {} ticks",
        ticks.len()
    );
    assert!(
        ticks
            .windows(2)
            .all(|pair| (pair[1].at_ns - pair[0].at_ns).abs_diff(TICK_NS) < 1000)
    );
    let figures = TickStatistics::of(&ticks).unwrap();
    assert_eq!(figures.min, figures.max);
    assert_eq!(stylus.unfollowed_ticks(), 0);
    // The audit and the watches count the same.
    for audit in stylus.take_audits() {
        assert_eq!(audit.instructions, u64::from(figures.median));
    }
}

#[test]
fn an_audit_sees_code_and_constants_in_flash() {
    let mut stylus = ready(Options::default());
    let audits = stylus.take_audits();
    let first = audits.first().expect("the first tick is always audited");
    // The handler of this image and its constants are in flash.
    assert_eq!(first.flash_fetches, first.instructions);
    assert!(!first.places.is_empty());
}
