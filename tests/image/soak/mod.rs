//! Random use by two hosts, one on USB and one on the serial port, with mishaps, for as long as requested. During all
//! of it no tick is late, the pin keeps its limits, counters add up, marks keep their bounds, and the flash holds what
//! it must.
//!
//! `cargo tasks soak` runs it. The seed determines everything that happens.
//!
//! [`Limits`] at the pin hold code by code, and the amplifier is on only while mid-scale has settled and is driven.

mod operations;
mod world;

use std::collections::VecDeque;
use std::time::Instant;

use operations::{CUT_AT_OPERATION, LINKS_BROKEN, OPERATIONS, Operation, ROLLED_BACK};
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::model::pins::{Drive, Driven};
use world::{RESETS, World};

use crate::device::{CODE_NS, MID_SCALE, SECOND};
use crate::output::SETTLED_NS;

/// Number of steps that the report of a failure lists.
const TOLD: usize = 40;

/// Length from which on a run must not let the stack's mark grow in its last quarter, s.
const LONG_S: u64 = 600;

/// The number in the environment variable `variable`, or `default`.
fn number(variable: &str, default: u64) -> u64 {
    let text = std::env::var(variable).ok();
    text.map_or(default, |text| text.parse().expect("a number"))
}

/// Prints how to reproduce a failure, if the run ends with one.
struct FailureReport {
    seed: u64,
    step: u64,
    now_s: u64,
    /// Names of the last steps.
    last: VecDeque<&'static str>,
}

impl Drop for FailureReport {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let Self {
                seed,
                step,
                now_s,
                last,
            } = self;
            println!("step {step}, after {now_s} s of the device's time, the last of these: {last:#?}");
            println!(
                "to see it again: cargo tasks soak --seed {seed} --for {}s",
                // The step that failed may take a while.
                *now_s + 60
            );
        }
    }
}

fn drawn(world: &mut World) -> &'static Operation {
    let shares = OPERATIONS.iter().map(|(_, share, _)| share).sum();
    // Each operation takes a stretch of the numbers as long as its share.
    let mut left = world.below(shares);
    OPERATIONS
        .iter()
        .find(|(_, share, _)| {
            let is_drawn = left < *share;
            left = left.saturating_sub(*share);
            is_drawn
        })
        .expect("the shares are all")
}

/// Prints how often each thing was done so far, and the marks.
fn tell(world: &World, told: &FailureReport, begun: Instant) {
    println!(
        "seed {}: {} steps in {} s of the device's time, {} s of this computer's",
        told.seed,
        told.step,
        told.now_s,
        begun.elapsed().as_secs()
    );
    for name in OPERATIONS
        .iter()
        .map(|(name, ..)| *name)
        .chain([LINKS_BROKEN, CUT_AT_OPERATION, ROLLED_BACK, RESETS])
    {
        println!("{:>11} {name}", world.done.get(name).unwrap_or(&0));
    }
    world.tell_figures();
}

#[test]
#[ignore = "as long as asked: cargo tasks soak"]
fn two_hosts_and_all_mishaps_leave_every_invariant_whole() {
    let seconds = number("STYLUS_SOAK_SECONDS", 60);
    let seed = number("STYLUS_SOAK_SEED", 1);
    let begun = Instant::now();
    let mut told = FailureReport {
        seed,
        step: 0,
        now_s: 0,
        last: VecDeque::new(),
    };
    let mut world = World::new(seed);
    while told.now_s < seconds {
        let (name, _, work) = *drawn(&mut world);
        let usb = world.once_in(2);
        world.turn_to(usb);
        told.step += 1;
        told.last.push_back(name);
        if told.last.len() > TOLD {
            told.last.pop_front();
        }
        let before = world.settings;
        work(&mut world);
        if !std::mem::take(&mut world.skipped) {
            world.count(name);
        }
        world.check(before);
        told.now_s = world.now_ns() / SECOND;
        let quarter = (4 * told.now_s / seconds).min(3) as usize;
        if told.step.is_multiple_of(100) {
            println!(
                "{} s, {} steps, {} s of this computer",
                told.now_s,
                told.step,
                begun.elapsed().as_secs()
            );
        }
        if quarter > world.quarter {
            tell(&world, &told, begun);
        }
        world.quarter = quarter;
    }
    tell(&world, &told, begun);
    world.check_marks(seconds >= LONG_S);
}

/// Largest offset of a code from mid-scale and largest change between successive codes, converter steps.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub offset: u16,
    pub slew: u16,
}

/// Follows the pin in one run, from power-on.
#[derive(Debug, Default)]
pub struct Pin {
    last: Option<Output>,
    /// The outputs of the last [`SETTLED_NS`].
    settled: VecDeque<Output>,
    amplifier: bool,
    /// Number of codes put out so far.
    pub codes: u64,
    /// Number of codes other than mid-scale.
    pub heard: u64,
    /// Largest offset from mid-scale, converter steps.
    pub largest: u16,
}

impl Pin {
    /// Checks the next outputs and changes of the amplifier, which are later than those of the previous call.
    pub fn follow(&mut self, outputs: &[Output], amplifier: &[Driven], limits: Limits) {
        let mut changes = amplifier.iter().peekable();
        for output in outputs {
            while let Some(change) = changes.next_if(|change| change.at_ns < output.at_ns) {
                self.switch(*change);
            }
            self.put(*output, limits);
        }
        for change in changes {
            self.switch(*change);
        }
    }

    fn put(&mut self, output: Output, limits: Limits) {
        let code = output.code.unwrap_or(MID_SCALE);
        let offset = code.abs_diff(MID_SCALE);
        assert!(offset <= limits.offset, "{output:?} of {limits:?}");
        if output.cause == Cause::Trigger {
            // A code after a reset, or after one that was written, has neither a period nor a slew limit.
            if let Some(last) = self.last.filter(|last| last.cause == Cause::Trigger) {
                assert_eq!(output.at_ns - last.at_ns, CODE_NS, "{last:?}, then {output:?}");
                let step = code.abs_diff(last.code.unwrap_or(MID_SCALE));
                assert!(step <= limits.slew, "{last:?}, then {output:?} of {limits:?}");
            }
            self.codes += 1;
        } else {
            assert_eq!(offset, 0, "no trigger has put out {output:?}");
        }
        assert!(!self.amplifier || output.code.is_some() || output.cause == Cause::Reset);
        self.heard += u64::from(offset != 0);
        self.largest = self.largest.max(offset);
        self.last = Some(output);
        self.settled.push_back(output);
        while (self.settled.front()).is_some_and(|first| first.at_ns + SETTLED_NS < output.at_ns) {
            self.settled.pop_front();
        }
    }

    fn switch(&mut self, change: Driven) {
        self.amplifier = change.drive == Drive::High;
        if self.amplifier {
            let is_settled = |output: &Output| output.code == Some(MID_SCALE);
            assert!(self.settled.iter().all(is_settled), "{change:?} before it has settled");
            assert!(self.settled.len() as u64 >= SETTLED_NS / CODE_NS - 1, "{change:?}");
        }
    }
}
