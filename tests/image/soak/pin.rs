//! Limits at the pin, code by code, and the amplifier, which may be on only while mid-scale has settled and is driven.

use std::collections::VecDeque;

use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::model::pin::{Drive, Driven};

use crate::device::{CODE_NS, MID_SCALE};
use crate::output::SETTLED_NS;

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
