//! The record of a fault, which survives the reset that follows the fault.
//!
//! The record lies in memory that a start does not touch. It counts as valid only if its checksum is right, because
//! power-on leaves noise there. It is written in whole words, so that no word waits in the memory's buffer for its
//! error-correcting code when the reset comes (AN5342, section 2).
#![expect(unsafe_code, reason = "memory that outlives a reset")]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use model_format::link::{ResetReason, StartStage};
use stylus_app::start::{Ended, Kept as KeptOfStarts};

use crate::tick::alive;

/// Kind of fault; the numbers are kept over a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
#[repr(u32)]
pub enum Kind {
    /// HardFault, or a usage fault that escalated to it.
    HardFault = 1,
    /// Non-maskable interrupt.
    Nmi,
    /// A panic.
    Panic,
    /// An interrupt or exception without a handler.
    UnexpectedInterrupt,
    /// Watchdog reset because the tick did not run or did not end.
    TickStopped,
    /// Watchdog reset while the tick still ran: the executor was stuck.
    ExecutorStopped,
    /// The stack overflowed.
    StackOverflow,
    /// The memory protection refused an access.
    MemoryProtection,
    /// The bus refused an access.
    BusFault,
    /// Failure of the external clock.
    ClockFailed,
    /// Watchdog reset before the start had ended.
    StartHung,
}

/// Number of return addresses that are kept.
pub const TRACE: usize = 6;

/// A fault as it is kept over the reset that follows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Caught {
    /// Kind of fault.
    pub kind: Kind,
    /// Program counter at the fault.
    pub program_counter: u32,
    /// CFSR for a fault of the processor, the number of the exception for an unexpected one, 0 otherwise.
    pub detail: u32,
    /// Address of the access that was refused, or address that the stack had reached.
    pub address: Option<u32>,
    /// Likely return addresses from the stack, the newest first; 0 after the last one.
    pub trace: [u32; TRACE],
    /// Address in flash of a panic's `Location`, see [`crate::fault::stack::location`]; 0 if it was not found.
    pub location: u32,
}

/// Words of a record: magic, the fields of [`Caught`], tick stopped, resets, whether the fault is new, starts,
/// checksum.
///
/// Noise passes as a record with a probability of 2⁻⁶⁴: magic and checksum have 32 bits each, and the checksum depends
/// on every bit of every word.
const WORDS: usize = 12 + TRACE;
const MAGIC: u32 = 0x5354_594C;

/// Everything that survives a reset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Record {
    words: [u32; WORDS],
}

const AT_KIND: usize = 1;
const AT_PROGRAM_COUNTER: usize = 2;
const AT_DETAIL: usize = 3;
const AT_TRACE: usize = 4;
const AT_LOCATION: usize = AT_TRACE + TRACE;
const AT_HAS_ADDRESS: usize = AT_LOCATION + 1;
const AT_ADDRESS: usize = AT_HAS_ADDRESS + 1;
const AT_TICK_STOPPED: usize = AT_ADDRESS + 1;
const AT_RESETS: usize = AT_TICK_STOPPED + 1;
const AT_NEW: usize = AT_RESETS + 1;
const AT_STARTS: usize = AT_NEW + 1;
const AT_SUM: usize = AT_STARTS + 1;

/// Returns a checksum of `words`, which depends on every bit of every word.
pub fn checksum(seed: u32, words: &[u32]) -> u32 {
    words
        .iter()
        .fold(seed, |sum, &word| (sum ^ word).rotate_left(5).wrapping_mul(0x85EB_CA6B))
}

#[repr(C, align(8))]
struct Kept(UnsafeCell<MaybeUninit<[u32; WORDS]>>);

// SAFETY: only thread mode and the handlers of faults use it. The handlers never return, and no other handler uses it.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.fault")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

impl Record {
    /// The record in memory, if this program wrote it.
    pub fn load() -> Option<Self> {
        // SAFETY: any bits are valid integers, and the checksum detects noise; a volatile read accepts whatever the
        // memory holds.
        let words: [u32; WORDS] = unsafe { KEPT.0.get().cast::<[u32; WORDS]>().read_volatile() };
        let record = Self { words };
        (words[0] == MAGIC && words[AT_SUM] == record.sum()).then_some(record)
    }

    /// Writes the record to memory, with its checksum.
    pub fn store(mut self) {
        self.words[0] = MAGIC;
        self.words[AT_SUM] = self.sum();
        // SAFETY: nothing else accesses it meanwhile, see `Kept`.
        unsafe {
            KEPT.0.get().cast::<[u32; WORDS]>().write_volatile(self.words);
        }
        cortex_m::asm::dsb();
    }

    fn sum(&self) -> u32 {
        checksum(0x9E37_79B9, &self.words[..AT_SUM])
    }

    /// Replaces the fault; the counters of resets stay.
    pub fn set(&mut self, caught: Caught) {
        self.words[AT_KIND] = caught.kind as u32;
        self.words[AT_DETAIL] = caught.detail;
        self.words[AT_PROGRAM_COUNTER] = caught.program_counter;
        self.words[AT_TRACE..AT_TRACE + TRACE].copy_from_slice(&caught.trace);
        self.words[AT_LOCATION] = caught.location;
        self.words[AT_HAS_ADDRESS] = u32::from(caught.address.is_some());
        self.words[AT_ADDRESS] = caught.address.unwrap_or(0);
        self.words[AT_NEW] = 1;
    }

    /// The last fault since power-on.
    pub fn caught(&self) -> Option<Caught> {
        let kind = match self.words[AT_KIND] {
            1 => Kind::HardFault,
            2 => Kind::Nmi,
            3 => Kind::Panic,
            4 => Kind::UnexpectedInterrupt,
            5 => Kind::TickStopped,
            6 => Kind::ExecutorStopped,
            7 => Kind::StackOverflow,
            8 => Kind::MemoryProtection,
            9 => Kind::BusFault,
            10 => Kind::ClockFailed,
            11 => Kind::StartHung,
            _ => return None,
        };
        Some(Caught {
            kind,
            program_counter: self.words[AT_PROGRAM_COUNTER],
            detail: self.words[AT_DETAIL],
            address: (self.words[AT_HAS_ADDRESS] != 0).then_some(self.words[AT_ADDRESS]),
            trace: core::array::from_fn(|index| self.words[AT_TRACE + index]),
            location: self.words[AT_LOCATION],
        })
    }
}

/// State kept from before the last reset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Before {
    /// The last fault since power-on.
    pub caught: Option<Caught>,
    /// True if [`Before::caught`] was caught since the last start.
    pub new_fault: bool,
    /// Resets since power-on, this one included.
    pub resets: u32,
    /// What was kept about earlier starts, with the decisions for this start.
    pub starts: KeptOfStarts,
}

/// Reads the kept state, counts this start, decides how the start continues, and keeps the result.
///
/// After power-on the memory holds noise, and its error-correcting codes are wrong, too, so the memory is not even
/// read. After a reset by the watchdog, that reset becomes the last fault.
pub fn take(cause: ResetReason) -> Before {
    let power_on = cause == ResetReason::PowerOn;
    let mut record = if power_on {
        Record::default()
    } else {
        Record::load().unwrap_or_default()
    };
    let starts = KeptOfStarts::from_word(record.words[AT_STARTS]);
    if cause == ResetReason::Watchdog {
        let tick_stopped = alive::is_running() || record.words[AT_TICK_STOPPED] != 0;
        let kind = match starts.stage {
            Some(_) => Kind::StartHung,
            None if tick_stopped => Kind::TickStopped,
            None => Kind::ExecutorStopped,
        };
        record.set(Caught {
            kind,
            program_counter: 0,
            detail: 0,
            address: None,
            trace: [0; TRACE],
            location: 0,
        });
    }
    let caught = record.caught();
    let new_fault = record.words[AT_NEW] != 0;
    let ended = match cause {
        ResetReason::PowerOn | ResetReason::Pin => Ended::ByHand,
        ResetReason::Watchdog => Ended::ByWatchdog,
        _ if new_fault => Ended::ByFault {
            clock_failed: caught.is_some_and(|caught| caught.kind == Kind::ClockFailed),
        },
        _ => Ended::WithoutFault,
    };
    let before = Before {
        caught,
        new_fault,
        resets: if power_on {
            0
        } else {
            record.words[AT_RESETS].saturating_add(1)
        },
        starts: starts.next(ended),
    };
    record.words[AT_RESETS] = before.resets;
    record.words[AT_TICK_STOPPED] = 0;
    record.words[AT_NEW] = 0;
    record.words[AT_STARTS] = before.starts.to_word();
    record.store();
    alive::clear_running();
    before
}

/// Records that the start has reached `stage`, or none once the start has ended.
pub fn enter(stage: Option<StartStage>) {
    change_starts(|starts| starts.stage = stage);
}

/// Records that this run has lasted long enough to count as healthy.
pub fn note_healthy() {
    change_starts(|starts| starts.healthy = true);
}

fn change_starts(change: impl FnOnce(&mut KeptOfStarts)) {
    // This section is short, and runs a few times per start.
    critical_section::with(|_| {
        let mut record = Record::load().unwrap_or_default();
        let mut starts = KeptOfStarts::from_word(record.words[AT_STARTS]);
        change(&mut starts);
        record.words[AT_STARTS] = starts.to_word();
        record.store();
    });
}

/// Records that the tick does not run; the watchdog resets the processor next.
pub fn note_tick_stopped() {
    let mut record = Record::load().unwrap_or_default();
    record.words[AT_TICK_STOPPED] = 1;
    record.store();
}
