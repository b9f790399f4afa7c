//! Cost of the tick's handler: instructions from its first to its return, for every tick.
//!
//! The entry is watched by the handler's symbol. An audit of the first tick finds the instruction that returns, which
//! is watched from then on. If the return of a later tick is not seen, the next tick is audited, too. Exception entry
//! and return (about a dozen cycles each) are not instructions, and are not counted.

use rigless::emulator::{Hit, HitKind, Watch};

use crate::core::{Audit, Auditor};

/// One tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Instant of the handler's entry, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// Instructions from the handler's first to its return, including both.
    pub instructions: u32,
}

/// Statistics of many ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickStatistics {
    /// Number of ticks.
    pub ticks: usize,
    /// Least number of instructions.
    pub min: u32,
    /// The lower median.
    pub median: u32,
    /// Largest number of instructions.
    pub max: u32,
}

impl TickStatistics {
    /// Computes the statistics of `ticks`, or `None` if there are no ticks.
    pub fn of(ticks: &[Tick]) -> Option<Self> {
        let mut counts: Vec<u32> = ticks.iter().map(|tick| tick.instructions).collect();
        counts.sort_unstable();
        Some(Self {
            ticks: counts.len(),
            min: *counts.first()?,
            median: counts[(counts.len() - 1) / 2],
            max: *counts.last()?,
        })
    }
}

/// Follows the ticks of a run.
#[derive(Debug)]
pub struct TickWatch {
    handler: Option<u64>,
    exits: Vec<u64>,
    auditor: Auditor,
    entered: Option<(u64, u64)>,
    audit_every: Option<u64>,
    entries: u64,
    ticks: Vec<Tick>,
    audits: Vec<Audit>,
    unfollowed: u64,
}

impl TickWatch {
    /// Creates a watch of the handler at address `handler`, if the image has a handler.
    pub fn new(handler: Option<u64>, auditor: Auditor) -> Self {
        Self {
            handler,
            exits: Vec::new(),
            auditor,
            entered: None,
            audit_every: None,
            entries: 0,
            ticks: Vec::new(),
            audits: Vec::new(),
            unfollowed: 0,
        }
    }

    /// The watch to set at the start.
    pub fn watches(&self) -> Option<Watch> {
        self.handler.map(Watch::Instruction)
    }

    /// Audits every `every`th tick from now on, in addition to the ticks that are audited to find an unknown return.
    pub fn audit_every(&mut self, every: u64) {
        self.audit_every = Some(every);
    }

    /// Returns the ticks since the last call, or since the run began.
    pub fn take_ticks(&mut self) -> Vec<Tick> {
        std::mem::take(&mut self.ticks)
    }

    /// Returns the audits since the last call, or since the run began.
    pub fn take_audits(&mut self) -> Vec<Audit> {
        std::mem::take(&mut self.audits)
    }

    /// Number of ticks whose return was not seen. They are missing from [`TickWatch::take_ticks`].
    pub fn unfollowed(&self) -> u64 {
        self.unfollowed
    }

    /// Handles a reset of the part, after which the tick under way never returns.
    pub fn reset(&mut self) {
        self.entered = None;
    }

    /// Handles a hit of a watch. Returns a further watch if one is needed.
    pub fn hit(&mut self, hit: &Hit) -> Option<Watch> {
        if hit.kind != HitKind::Instruction {
            return None;
        }
        if Some(hit.address) == self.handler {
            return self.enter(hit);
        }
        if self.exits.contains(&hit.address)
            && !self.auditor.running()
            && let Some((count, at_ns)) = self.entered.take()
        {
            // A watch stops before its instruction, so the return itself is not counted yet.
            let instructions = (hit.instruction_count + 1 - count) as u32;
            self.ticks.push(Tick { at_ns, instructions });
        }
        None
    }

    /// Handles the end of an audit. Returns a further watch if the tick returned by an instruction that was not known
    /// yet.
    pub fn audited(&mut self) -> Option<Watch> {
        let audit = self.auditor.take()?;
        let (_, at_ns) = self.entered.take()?;
        let instructions = audit.instructions as u32;
        self.ticks.push(Tick { at_ns, instructions });
        let exit = audit.exit;
        self.audits.push(audit);
        (!self.exits.contains(&exit)).then(|| {
            self.exits.push(exit);
            Watch::Instruction(exit)
        })
    }

    fn enter(&mut self, hit: &Hit) -> Option<Watch> {
        // The audit of the previous tick may have ended without a stop since then.
        let watch = self.audited();
        let unknown_return = self.entered.is_some() || self.exits.is_empty();
        self.unfollowed += u64::from(self.entered.is_some());
        self.entered = Some((hit.instruction_count, hit.at.0));
        self.entries += 1;
        let due = self.audit_every.is_some_and(|every| self.entries.is_multiple_of(every));
        if unknown_return || due {
            self.auditor.begin();
        }
        watch
    }
}
