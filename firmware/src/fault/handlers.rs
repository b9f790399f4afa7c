//! Handlers of faults: the output goes to mid-scale, the reason is recorded, the processor resets.
//!
//! A panic takes the same way. panic-probe masks interrupts and executes UDF, which is a HardFault some twenty
//! instructions after the panic, before anything is formatted or logged. panic-probe's own printing is left off,
//! because it would come before mid-scale. The panic's `Location`, which the stack points to, tells its file and line.
#![expect(unsafe_code, reason = "handlers of exceptions")]

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

use crate::boot::clock;
use crate::fault::record::{Caught, Kind, Record, TRACE};
use crate::fault::stack_trace;
use crate::tick::output;

/// Sets mid-scale, records the reason, resets. `frame` is what the processor saved, where there is one.
fn end(kind: Kind, detail: u32, frame: Option<&ExceptionFrame>) -> ! {
    output::mid_scale_now();
    let mut caught = Caught {
        kind,
        program_counter: 0,
        detail,
        trace: [0; TRACE],
        location: 0,
    };
    if let Some(frame) = frame {
        let stack_pointer = core::ptr::from_ref(frame).cast();
        caught.program_counter = frame.pc();
        caught.trace = stack_trace::return_addresses(stack_pointer);
        if kind == Kind::Panic {
            let mut locations = stack_trace::words(stack_pointer)
                .filter(|&word| stack_trace::location(word).is_some());
            caught.location = locations.next().unwrap_or(0);
        }
    }
    let mut record = Record::load().unwrap_or_default();
    record.set(caught);
    record.store();
    // Never blocks; dropped if the fault came in the middle of another message.
    defmt::error!("{}", caught);
    SCB::sys_reset()
}

/// Reports whether `program_counter` is at a UDF, with any number (ARM DDI 0403E, A7.7.194): how panic-probe ends.
fn is_udf(program_counter: u32) -> bool {
    // SAFETY: the processor has just fetched this instruction, and `is_code` says that it is memory.
    stack_trace::is_code(program_counter)
        && unsafe { (program_counter as *const u16).read_volatile() } >> 8 == 0xDE
}

// SAFETY: does not return, touches nothing of the program but the record, and its first act is mid-scale.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    /// CFSR: a fault on stacking, after which the frame means nothing (MSTKERR, STKERR).
    const STACKING: u32 = 1 << 4 | 1 << 12;
    output::mid_scale_now();
    // SAFETY: read and never written; the processor's fault status (ARM DDI 0403E, B3.2.15).
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    let frame = (status & STACKING == 0).then_some(frame);
    let kind = if frame.is_some_and(|frame| is_udf(frame.pc())) {
        Kind::Panic
    } else {
        Kind::HardFault
    };
    end(kind, status, frame)
}

// SAFETY: as for HardFault.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    output::mid_scale_now();
    let kind = if clock::has_failed() {
        Kind::ClockFailed
    } else {
        Kind::Nmi
    };
    end(kind, 0, None)
}

// SAFETY: as for HardFault.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    end(Kind::UnexpectedInterrupt, number as u32, None)
}
