//! The reset report that the host reads: reason, number of resets, and the last fault in words.

use core::fmt::Write;

use model_format::link::{Fault, FaultKind, FaultText, ResetReason};
use stylus_app::control::ResetReport;

use crate::fault::record::{Before, Caught, Kind};
use crate::fault::stack;

/// Returns the report of this start, from what the processor and the memory kept.
pub fn reset_report(cause: ResetReason, before: Before) -> ResetReport {
    let fault = before.caught.map(|caught| Fault {
        kind: match caught.kind {
            Kind::HardFault => FaultKind::HardFault,
            Kind::Nmi => FaultKind::Nmi,
            Kind::Panic => FaultKind::Panic,
            Kind::UnexpectedInterrupt => FaultKind::UnexpectedInterrupt,
            Kind::TickStopped => FaultKind::TickStopped,
            Kind::ExecutorStopped => FaultKind::ExecutorStopped,
            Kind::ClockFailed => FaultKind::ClockFailed,
            Kind::StartHung => FaultKind::StartHung,
            Kind::StackOverflow => FaultKind::StackOverflow,
            Kind::MemoryProtection => FaultKind::MemoryProtection,
            Kind::BusFault => FaultKind::BusFault,
        },
        program_counter: caught.program_counter,
        detail: caught.detail,
        address: caught.address,
        text: text(&caught),
    });
    let reason = match cause {
        ResetReason::Software if before.new_fault => ResetReason::Fault,
        cause => cause,
    };
    ResetReport {
        reason,
        resets: before.resets,
        fault,
    }
}

/// Returns file and line of a panic; of a long file name only the end. For any other fault it returns the return
/// addresses in hexadecimal, the newest first, for `addr2line` on the image's file.
fn text(caught: &Caught) -> FaultText {
    /// Characters of the colon and the line's number, at most.
    const LINE_CHARACTERS: usize = 8;
    let mut text = FaultText::new();
    if let Some((file, line)) = stack::location(caught.location) {
        let left_out = file.len().saturating_sub(text.capacity() - LINE_CHARACTERS);
        // Fits. If the cut falls within a character of several bytes, only the line is written.
        let _ = write!(text, "{}:{line}", file.get(left_out..).unwrap_or_default());
        return text;
    }
    for &address in caught.trace.iter().filter(|&&address| address != 0) {
        let separator = if text.is_empty() { "" } else { " " };
        if write!(text, "{separator}{address:08x}").is_err() {
            break;
        }
    }
    text
}
