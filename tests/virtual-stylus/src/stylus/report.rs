//! Reports of a run: resets of the part, and accesses that no model answered.

use rigless::session::Session;

use crate::board::StylusBoard;

/// Cause of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// The image asked for it.
    Software,
    /// The watchdog ended its count.
    Watchdog,
    /// Anything else.
    Other,
}

/// A reset of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    /// Instant, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The cause.
    pub cause: ResetCause,
}

/// Accesses that the part would answer and no model does.
#[derive(Clone, Debug, Default)]
pub struct RunReport {
    /// Registers without a model, with counts of their reads and writes.
    pub without_model: Vec<String>,
    /// Unmapped addresses, and the places of the accesses.
    pub unmapped: Vec<String>,
    /// Accesses that the part refuses, such as to an instance whose clock is off.
    pub refused: Vec<String>,
    /// Requests that models do not carry out.
    pub told: Vec<String>,
    /// Interrupts that reach no line of the core.
    pub unrouted: Vec<String>,
}

/// The resets of the part, the first power-on left out.
pub(super) fn resets(session: &Session<StylusBoard>) -> Vec<Reset> {
    let resets = session.resets().iter();
    resets
        .map(|reset| Reset {
            at_ns: reset.at.0,
            cause: match reset.cause {
                rigless::device::ResetCause::Core => ResetCause::Software,
                rigless::device::ResetCause::Model("IWDG") => ResetCause::Watchdog,
                _ => ResetCause::Other,
            },
        })
        .collect()
}

/// The accesses of the run that no model answered.
pub(super) fn report(session: &mut Session<StylusBoard>) -> RunReport {
    let without_model = session.unimplemented().iter().map(|(address, met)| {
        format!(
            "{}.{} ({address:#010x}): {} reads, {} writes, last {:#x}, first from {:#010x}",
            met.instance,
            met.register,
            met.reads,
            met.writes,
            met.written.unwrap_or_default(),
            met.program_counter
        )
    });
    let undefined = session.undefined().iter().map(|(address, met)| {
        format!(
            "{} ({address:#010x}), no register: {} reads, {} writes, first from {:#010x}",
            met.instance, met.reads, met.writes, met.program_counter
        )
    });
    let mut report = RunReport {
        without_model: without_model.chain(undefined).collect(),
        unmapped: session.unmapped().iter().map(ToString::to_string).collect(),
        refused: (session.refused().iter())
            .map(|(address, fault)| format!("{address:#010x}: {fault}"))
            .collect(),
        told: session
            .told()
            .map(|told| format!("{}.{}: {}", told.instance, told.register, told.reason))
            .collect(),
        unrouted: session
            .unrouted()
            .iter()
            .map(|(instance, line)| format!("{instance}: {line}"))
            .collect(),
    };
    report.told.sort();
    report
}
