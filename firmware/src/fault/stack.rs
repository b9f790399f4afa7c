//! The stack: its addresses, how much of it was ever used, and the traces that a fault left on it.
//!
//! cortex-m-rt paints the stack before anything runs, and a word that still holds the paint was never used. The search
//! for the first word without paint is spread over many calls, so that no call takes long.
#![expect(unsafe_code, reason = "stack and flash are read as memory")]

use core::ops::Range;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m_rt::STACK_PAINT_VALUE;
use stylus_boot::map::{self, ACTIVE};

use crate::fault::record::TRACE;

/// Bytes that one call of [`search`] checks, in about a thousand cycles.
const PIECE_BYTES: u32 = 1024;

const WORD: u32 = size_of::<u32>() as u32;

/// Bytes of the stack used, as of the last complete search.
static USED: AtomicU32 = AtomicU32::new(0);

/// Bytes from the bottom that the current search has found painted.
static PAINTED: AtomicU32 = AtomicU32::new(0);

/// Addresses of the stack. It grows from the end down to the start, below which no memory may be accessed.
pub fn range() -> Range<u32> {
    unsafe extern "C" {
        static _stack_start: u32;
        static _stack_end: u32;
    }
    addr_of!(_stack_end) as u32..addr_of!(_stack_start) as u32
}

/// Length of the stack, bytes.
pub fn bytes() -> u32 {
    let stack = range();
    stack.end - stack.start
}

/// Checks the next part of the stack. One task calls this at regular intervals; a complete search takes at most one
/// call per [`PIECE_BYTES`] of the stack.
pub fn search() {
    let stack = range();
    let from = PAINTED.load(Ordering::Relaxed);
    let to = (from + PIECE_BYTES).min(bytes());
    let used = (from..to).step_by(WORD as usize).find(|&offset| {
        let word = (stack.start + offset) as *const u32;
        // SAFETY: this is a word of the stack's memory. Nothing owns the words below the stack pointer, and the first
        // word that is used ends the search.
        unsafe { word.read_volatile() != STACK_PAINT_VALUE }
    });
    let next = match used {
        Some(offset) => {
            USED.store(bytes() - offset, Ordering::Relaxed);
            0
        }
        None => to % bytes(),
    };
    PAINTED.store(next, Ordering::Relaxed);
}

/// Bytes of the stack used since the start, including by interrupts, as of the last complete search.
pub fn used_bytes() -> u32 {
    USED.load(Ordering::Relaxed)
}

/// The flash that the program is in.
const FLASH: Range<u32> = map::FLASH + ACTIVE.start..map::FLASH + ACTIVE.end;

/// The ITCM that code is in, see `tick.x`.
const ITCM: Range<u32> = 0x400..0x1_0000;

/// Reports whether `address` is in memory that holds code.
pub fn is_code(address: u32) -> bool {
    FLASH.contains(&address) || ITCM.contains(&address)
}

/// Returns the words on the stack from `stack_pointer` on, the newest first: the frames of a panic and some of its
/// callers.
///
/// After an overflow the pointer is below the stack, so the words begin at the lowest address of the stack.
pub fn words(stack_pointer: u32) -> impl Iterator<Item = u32> {
    /// Largest number of words that are read.
    const DEPTH: u32 = 256;
    let stack = range();
    let start = stack_pointer.clamp(stack.start, stack.end) & !(WORD - 1);
    let count = ((stack.end - start) / WORD).min(DEPTH);
    // SAFETY: these words are aligned and lie within the stack, all of which is memory.
    (0..count).map(move |index| unsafe { ((start + index * WORD) as *const u32).read_volatile() })
}

/// Returns likely return addresses on the stack: odd numbers that point into code.
///
/// Some are stale. With the image's file, `addr2line` shows the place of each in the source.
pub fn return_addresses(stack_pointer: u32) -> [u32; TRACE] {
    let mut found = [0; TRACE];
    let addresses = words(stack_pointer).filter(|&word| word & 1 == 1 && is_code(word));
    for (entry, address) in found.iter_mut().zip(addresses) {
        *entry = address & !1;
    }
    found
}

/// Returns file and line of the `core::panic::Location` at `address` in flash; none if there is no such value.
///
/// A `Location` consists of address and length of the file's name, line, and column. Nothing marks a `Location`, so the
/// plausibility of these values decides.
pub fn location(address: u32) -> Option<(&'static str, u32)> {
    const LONGEST_NAME: u32 = 256;
    const HIGHEST_LINE: u32 = 1_000_000;
    let in_flash = |start: u32, length: u32| start >= FLASH.start && start.saturating_add(length) <= FLASH.end;
    if !address.is_multiple_of(WORD) || !in_flash(address, 4 * WORD) {
        return None;
    }
    // SAFETY: this is aligned flash of this program, which changes only when another program is flashed.
    let [name, length, line, column] = unsafe { *(address as *const [u32; 4]) };
    if length > LONGEST_NAME || !in_flash(name, length) || line == 0 || line > HIGHEST_LINE || column == 0 {
        return None;
    }
    // SAFETY: as above; bytes need no alignment.
    let name = unsafe { core::slice::from_raw_parts(name as *const u8, length as usize) };
    let name = core::str::from_utf8(name).ok()?;
    name.as_bytes().ends_with(b".rs").then_some((name, line))
}
