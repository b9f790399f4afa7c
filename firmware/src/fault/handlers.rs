//! Handlers of faults: the output goes to mid-scale, the reason is recorded, the processor resets.
//!
//! MemManage, BusFault and UsageFault arrive as HardFault; BusFault arrives through the handler of `stylus_boot::word`.
//! The processor's status distinguishes them.
//!
//! A stack that has overflowed leaves no memory for a handler: the handler's own first store would be a fault within
//! HardFault, at which the processor locks up with the last code at the output. So HardFault begins by switching to its
//! own stack, before any Rust code. The stack of the program stays as it is, to be read for the trace.
//!
//! Before that it masks interrupts, because a BusFault is less urgent than the tick. A tick would find its streams
//! stopped, and its panic would replace the record of the fault.
//!
//! A panic takes the same path. panic-probe masks interrupts and executes UDF, which is a HardFault some twenty
//! instructions after the panic, before anything is formatted or logged. panic-probe's own printing is left off,
//! because it would come before mid-scale. The panic's `Location`, to which a word on the stack points, gives file and
//! line.
#![expect(unsafe_code, reason = "handlers of exceptions")]

use core::arch::global_asm;
use core::cell::UnsafeCell;
use core::mem::{MaybeUninit, size_of};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

use crate::boot::clock;
use crate::fault::record::{Caught, Kind, Record, TRACE};
use crate::fault::stack;
use crate::tick::output;

/// Length of the handler's stack, bytes: several times what the handler uses.
const FAULT_STACK_BYTES: usize = 2048;

/// Stack of the handler of HardFault.
#[repr(C, align(8))]
struct FaultStack(UnsafeCell<MaybeUninit<[u8; FAULT_STACK_BYTES]>>);

// SAFETY: only HardFault's code uses it, with interrupts masked, and does not return. NMI may preempt that code, and
// does not return either.
unsafe impl Sync for FaultStack {}

#[unsafe(link_section = ".uninit.fault_stack")]
static FAULT_STACK: FaultStack = FaultStack(UnsafeCell::new(MaybeUninit::uninit()));

// SAFETY: the main stack is the only one in use, so its pointer is the address of the frame that the processor saved.
// Nothing of the interrupted program continues, so all registers are free. Clearing FPCCR.LSPACT (ARM DDI 0403E,
// B3.2.21) keeps floating-point instructions of the handler from saving registers to the frame, which may lie outside
// the stack.
global_asm!(
    ".section .text.HardFault, \"ax\", %progbits",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "    cpsid i",
    "    mov r0, sp",
    "    ldr r1, ={stack}",
    "    add r1, r1, #{bytes}",
    "    mov sp, r1",
    "    ldr r2, =0xE000EF34",
    "    ldr r3, [r2]",
    "    bic r3, r3, #1",
    "    str r3, [r2]",
    "    b {handler}",
    "    .ltorg",
    ".size HardFault, . - HardFault",
    stack = sym FAULT_STACK,
    bytes = const FAULT_STACK_BYTES,
    handler = sym hard_fault,
);

/// Status of a fault, CFSR (ARM DDI 0403E, B3.2.15).
#[derive(Clone, Copy)]
struct FaultStatus(u32);

impl FaultStatus {
    /// Faults while the frame was pushed, after which the frame means nothing: MSTKERR, MLSPERR, STKERR, LSPERR.
    const STACKING: u32 = 1 << 4 | 1 << 5 | 1 << 12 | 1 << 13;
    /// All of MemManage.
    const MEM_MANAGE: u32 = 0xFF;
    /// All of BusFault.
    const BUS_FAULT: u32 = 0xFF00;
    /// A fetch that the MPU refused: IACCVIOL. The program counter is the address of that fetch.
    const FETCH: u32 = 1;
    /// MMFAR holds an address.
    const MMFAR_VALID: u32 = 1 << 7;
    /// BFAR holds an address.
    const BFAR_VALID: u32 = 1 << 15;

    const fn has(self, bits: u32) -> bool {
        self.0 & bits != 0
    }

    /// Returns the address of the access that was refused. MMFAR and BFAR are one register on this processor.
    fn address(self, program_counter: Option<u32>) -> Option<u32> {
        if self.has(Self::MMFAR_VALID | Self::BFAR_VALID) {
            // SAFETY: the register is read and never written (ARM DDI 0403E, B3.2.17).
            return Some(unsafe { (*SCB::PTR).mmfar.read() });
        }
        program_counter.filter(|_| self.has(Self::FETCH))
    }
}

/// Reports whether an address, of an access or of the stack pointer, is in the megabyte just below the stack. No region
/// of the MPU allows a store there.
fn is_below_stack(address: u32) -> bool {
    const BELOW: u32 = 1 << 20;
    let start = stack::range().start;
    (start - BELOW..start).contains(&address)
}

/// Records the reason and resets. The output must be at mid-scale already.
fn end(caught: Caught) -> ! {
    let mut record = Record::load().unwrap_or_default();
    record.set(caught);
    record.store();
    // Never blocks. The message is dropped if the fault came in the middle of another message.
    defmt::error!("{}", caught);
    SCB::sys_reset()
}

/// Returns a fault of which only `kind` and `detail` are known.
const fn bare(kind: Kind, detail: u32) -> Caught {
    Caught {
        kind,
        program_counter: 0,
        detail,
        address: None,
        trace: [0; TRACE],
        location: 0,
    }
}

/// Reports whether `program_counter` is at a UDF, with any number (ARM DDI 0403E, A7.7.194). panic-probe ends with UDF.
fn is_udf(program_counter: u32) -> bool {
    // SAFETY: the processor has just fetched this instruction, and `is_code` checks that the address is in memory.
    stack::is_code(program_counter) && unsafe { (program_counter as *const u16).read_volatile() } >> 8 == 0xDE
}

/// The handler, on its own stack. `frame` is the address of the frame that the processor saved, or would have saved.
extern "C" fn hard_fault(frame: u32) -> ! {
    output::mid_scale_now();
    // SAFETY: read and never written; the processor's fault status (ARM DDI 0403E, B3.2.15).
    let status = FaultStatus(unsafe { (*SCB::PTR).cfsr.read() });
    let stack = stack::range();
    let is_whole = !status.has(FaultStatus::STACKING)
        && frame >= stack.start
        && frame <= stack.end - size_of::<ExceptionFrame>() as u32
        && frame.is_multiple_of(8);
    // SAFETY: the frame lies within the stack, aligned, and the processor reports no fault on writing it. Nothing
    // changes it.
    let program_counter = is_whole.then(|| unsafe { &*(frame as *const ExceptionFrame) }.pc());
    let address = status.address(program_counter);
    // An overflow comes first, because the MPU reports it like any other access that it refuses.
    let kind = if is_below_stack(frame) || address.is_some_and(is_below_stack) {
        Kind::StackOverflow
    } else if program_counter.is_some_and(is_udf) {
        Kind::Panic
    } else if status.has(FaultStatus::MEM_MANAGE) {
        Kind::MemoryProtection
    } else if status.has(FaultStatus::BUS_FAULT) {
        Kind::BusFault
    } else {
        Kind::HardFault
    };
    let location = if kind == Kind::Panic {
        stack::words(frame).find(|&word| stack::location(word).is_some())
    } else {
        None
    };
    end(Caught {
        kind,
        program_counter: program_counter.unwrap_or(0),
        detail: status.0,
        address: match kind {
            Kind::StackOverflow => Some(address.unwrap_or(frame)),
            _ => address,
        },
        trace: stack::return_addresses(frame),
        location: location.unwrap_or(0),
    })
}

// SAFETY: it does not return, changes nothing of the program except the record, and first sets mid-scale.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    output::mid_scale_now();
    let kind = if clock::has_failed() {
        Kind::ClockFailed
    } else {
        Kind::Nmi
    };
    end(bare(kind, 0))
}

// SAFETY: as for NonMaskableInt.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    output::mid_scale_now();
    end(bare(Kind::UnexpectedInterrupt, number as u32))
}
