//! What happens when something is wrong: the output goes to mid-scale, a reason is kept, the processor resets.
//!
//! A panic takes the same way. panic-probe masks interrupts and executes UDF; that is a HardFault some twenty instructions
//! after the panic, before anything is formatted or logged, which is why panic-probe's own printing is left off: it would
//! come before mid-scale. Where the panic was is
//! told by its `Location`, which the stack points to.
//!
//! The reason lies in memory that a start does not touch, and is believed when its checksum is right: power that comes
//! leaves noise there. It is written in whole words, so that none waits in the memory's buffer for its error-correcting code
//! when the reset comes (AN5342, section 2).
#![expect(
    unsafe_code,
    reason = "handlers of exceptions, and memory that outlives a reset"
)]

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::ops::Range;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

use crate::output;

/// What kind of fault was caught; the numbers are kept over a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
#[repr(u32)]
pub enum Kind {
    /// HardFault, or a fault that escalated to it.
    HardFault = 1,
    /// Non-maskable interrupt.
    Nmi,
    /// A panic.
    Panic,
    /// An interrupt or exception without a handler.
    UnexpectedInterrupt,
    /// The watchdog came because the tick stood still or did not end.
    TickStopped,
    /// The watchdog came though the tick went on: the executor stood still.
    ExecutorStopped,
}

/// Return addresses that are kept.
pub const TRACE: usize = 6;

/// A fault as it is kept over the reset that follows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Caught {
    /// What it was.
    pub kind: Kind,
    /// The program counter at it.
    pub program_counter: u32,
    /// CFSR for a HardFault, the number of the exception for an unexpected one, 0 otherwise.
    pub detail: u32,
    /// What look like return addresses on the stack, the newest first; 0 where there are no more.
    pub trace: [u32; TRACE],
    /// Where in the flash the place of a panic is written, see [`place`]; 0 if it was not found.
    pub location: u32,
}

/// Words of a record: magic, what [`Caught`] has, whether the tick stood still, resets, whether the fault is new, checksum.
const WORDS: usize = 9 + TRACE;
const MAGIC: u32 = 0x5354_594C;

/// Everything that outlives a reset.
#[derive(Clone, Copy, Debug, Default)]
struct Record {
    words: [u32; WORDS],
}

const AT_KIND: usize = 1;
const AT_PROGRAM_COUNTER: usize = 2;
const AT_DETAIL: usize = 3;
const AT_TRACE: usize = 4;
const AT_LOCATION: usize = AT_TRACE + TRACE;
const AT_TICK_STOPPED: usize = AT_LOCATION + 1;
const AT_RESETS: usize = AT_TICK_STOPPED + 1;
const AT_NEW: usize = AT_RESETS + 1;
const AT_SUM: usize = AT_NEW + 1;

#[repr(C, align(8))]
struct Kept(UnsafeCell<MaybeUninit<[u32; WORDS]>>);

// SAFETY: thread mode uses it with interrupts masked, and the handlers of faults, which never return, run alone.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.fault")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

impl Record {
    /// What is kept, if it was written by this program.
    fn load() -> Option<Self> {
        // SAFETY: reading noise as integers is what the checksum is for; a volatile read takes whatever is there.
        let words: [u32; WORDS] = unsafe { KEPT.0.get().cast::<[u32; WORDS]>().read_volatile() };
        let record = Self { words };
        (words[0] == MAGIC && words[AT_SUM] == record.sum()).then_some(record)
    }

    fn store(mut self) {
        self.words[0] = MAGIC;
        self.words[AT_SUM] = self.sum();
        // SAFETY: nothing else accesses it meanwhile, see `Kept`.
        unsafe {
            KEPT.0
                .get()
                .cast::<[u32; WORDS]>()
                .write_volatile(self.words);
        }
        cortex_m::asm::dsb();
    }

    fn sum(&self) -> u32 {
        self.words[..AT_SUM]
            .iter()
            .fold(0x9E37_79B9, |sum: u32, &word| {
                (sum ^ word).rotate_left(5).wrapping_mul(0x85EB_CA6B)
            })
    }

    fn set(&mut self, kind: Kind, detail: u32, program_counter: u32) {
        self.words[AT_KIND] = kind as u32;
        self.words[AT_DETAIL] = detail;
        self.words[AT_PROGRAM_COUNTER] = program_counter;
        self.words[AT_TRACE..AT_TRACE + TRACE].fill(0);
        self.words[AT_LOCATION] = 0;
        self.words[AT_NEW] = 1;
    }

    fn caught(&self) -> Option<Caught> {
        let kind = match self.words[AT_KIND] {
            1 => Kind::HardFault,
            2 => Kind::Nmi,
            3 => Kind::Panic,
            4 => Kind::UnexpectedInterrupt,
            5 => Kind::TickStopped,
            6 => Kind::ExecutorStopped,
            _ => return None,
        };
        Some(Caught {
            kind,
            program_counter: self.words[AT_PROGRAM_COUNTER],
            detail: self.words[AT_DETAIL],
            trace: core::array::from_fn(|index| self.words[AT_TRACE + index]),
            location: self.words[AT_LOCATION],
        })
    }
}

/// Set while the tick runs; it outlives a reset, so that a tick that never ends is told from an executor that hangs.
#[unsafe(link_section = ".uninit.tick_running")]
static TICK_RUNNING: AtomicU32 = AtomicU32::new(0);

/// [`TICK_RUNNING`] during a tick. Noise is hardly ever this.
const RUNNING: u32 = 0x5449_434B;

/// Tells that the tick begins.
#[inline(always)]
pub fn tick_begins() {
    TICK_RUNNING.store(RUNNING, Ordering::Relaxed);
}

/// Tells that the tick has ended.
#[inline(always)]
pub fn tick_ends() {
    TICK_RUNNING.store(0, Ordering::Relaxed);
}

/// What was kept from before the last reset.
#[derive(Clone, Copy, Debug, Default)]
pub struct Before {
    /// The last fault since power came.
    pub caught: Option<Caught>,
    /// Whether [`Before::caught`] was caught since the last start.
    pub new_fault: bool,
    /// Resets since power came, this one included.
    pub resets: u32,
}

/// Takes what was kept and counts this start. `power_came` says that what is kept is noise, whatever it looks like;
/// `watchdog` that the watchdog brought this start about, which is a fault too.
pub fn take(power_came: bool, watchdog: bool) -> Before {
    let mut record = Record::load().filter(|_| !power_came).unwrap_or_default();
    if watchdog {
        let in_tick = TICK_RUNNING.load(Ordering::Relaxed) == RUNNING;
        let tick_stopped = in_tick || record.words[AT_TICK_STOPPED] != 0;
        let kind = if tick_stopped {
            Kind::TickStopped
        } else {
            Kind::ExecutorStopped
        };
        record.set(kind, 0, 0);
    }
    let before = Before {
        caught: record.caught(),
        new_fault: record.words[AT_NEW] != 0,
        resets: if power_came {
            0
        } else {
            record.words[AT_RESETS].saturating_add(1)
        },
    };
    record.words[AT_RESETS] = before.resets;
    record.words[AT_TICK_STOPPED] = 0;
    record.words[AT_NEW] = 0;
    record.store();
    tick_ends();
    before
}

/// Keeps that the tick stands still; the watchdog resets the processor next.
pub fn tick_stopped() {
    let mut record = Record::load().unwrap_or_default();
    record.words[AT_TICK_STOPPED] = 1;
    record.store();
}

/// The flash that the program is in.
const FLASH: Range<u32> = 0x0800_0000..0x080C_0000;

/// The ITCM that code is in, see `tick.x`.
const ITCM: Range<u32> = 0x400..0x1_0000;

fn is_code(address: u32) -> bool {
    FLASH.contains(&address) || ITCM.contains(&address)
}

/// The words on the stack from `stack_pointer` on, the newest first: the frames of a panic and some of its callers.
fn stack(stack_pointer: *const u32) -> impl Iterator<Item = u32> {
    /// Words that are looked at.
    const DEPTH: usize = 256;
    unsafe extern "C" {
        static _stack_start: u32;
    }
    let left =
        (addr_of!(_stack_start) as usize).saturating_sub(stack_pointer as usize) / size_of::<u32>();
    // SAFETY: these words lie between a pointer to the stack and the stack's beginning, which is all memory.
    (0..left.min(DEPTH)).map(move |index| unsafe { stack_pointer.add(index).read_volatile() })
}

/// What look like return addresses on the stack: odd numbers that point into code. Some are stale; with the image's file,
/// `addr2line` tells each one's place in the source.
fn trace(stack_pointer: *const u32) -> [u32; TRACE] {
    let mut found = [0; TRACE];
    let addresses = stack(stack_pointer).filter(|&word| word & 1 == 1 && is_code(word));
    for (place, address) in found.iter_mut().zip(addresses) {
        *place = address & !1;
    }
    found
}

/// The file and line that are written at `address` in the flash, as core's `Location` has them: address and length of the
/// file's name, line, column. Nothing if they are not there, which is found out from what is there alone.
pub fn place(address: u32) -> Option<(&'static str, u32)> {
    const WORD: u32 = size_of::<u32>() as u32;
    const LONGEST_NAME: u32 = 256;
    const HIGHEST_LINE: u32 = 1_000_000;
    let in_flash =
        |start: u32, length: u32| start >= FLASH.start && start.saturating_add(length) <= FLASH.end;
    if !address.is_multiple_of(WORD) || !in_flash(address, 4 * WORD) {
        return None;
    }
    // SAFETY: flash, aligned, of this program, which changes only by flashing another.
    let [name, length, line, column] = unsafe { *(address as *const [u32; 4]) };
    if length > LONGEST_NAME
        || !in_flash(name, length)
        || line == 0
        || line > HIGHEST_LINE
        || column == 0
    {
        return None;
    }
    // SAFETY: as above; bytes need no alignment.
    let name = unsafe { core::slice::from_raw_parts(name as *const u8, length as usize) };
    let name = core::str::from_utf8(name).ok()?;
    name.as_bytes().ends_with(b".rs").then_some((name, line))
}

/// Mid-scale, then the reason, then a reset. `frame` is what the processor saved, where there is one.
fn end(kind: Kind, detail: u32, frame: Option<&ExceptionFrame>) -> ! {
    output::mid_scale_now();
    let mut record = Record::load().unwrap_or_default();
    record.set(kind, detail, frame.map_or(0, ExceptionFrame::pc));
    if let Some(frame) = frame {
        let stack_pointer = core::ptr::from_ref(frame).cast();
        record.words[AT_TRACE..AT_TRACE + TRACE].copy_from_slice(&trace(stack_pointer));
        let mut places = stack(stack_pointer).filter(|&word| place(word).is_some());
        if kind == Kind::Panic {
            record.words[AT_LOCATION] = places.next().unwrap_or(0);
        }
    }
    record.store();
    if let Some(caught) = record.caught() {
        // Never blocks; dropped if the fault came in the middle of another message.
        defmt::error!("{}", caught);
    }
    SCB::sys_reset()
}

/// UDF with any number (ARM DDI 0403E, A7.7.194): how panic-probe ends.
fn is_udf(program_counter: u32) -> bool {
    // SAFETY: the processor has just fetched this instruction, and `is_code` says that it is memory.
    is_code(program_counter)
        && unsafe { (program_counter as *const u16).read_volatile() } >> 8 == 0xDE
}

// SAFETY: does not return, touches nothing of the program but what is kept, and its first act is mid-scale.
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
    end(Kind::Nmi, 0, None)
}

// SAFETY: as for HardFault.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    end(Kind::UnexpectedInterrupt, number as u32, None)
}
