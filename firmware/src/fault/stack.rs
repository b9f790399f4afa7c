//! The stack: its place, and the most that was ever used of it.
//!
//! cortex-m-rt paints the stack before anything runs, and a word that keeps the paint was never used. The search for
//! the first that does not is spread over many calls, so that none of them takes long.
#![expect(unsafe_code, reason = "the stack is read as memory")]

use core::ops::Range;
use core::ptr::addr_of;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m_rt::STACK_PAINT_VALUE;

/// Bytes that one call of [`search`] looks at: about a thousand cycles.
const PIECE_BYTES: u32 = 1024;

const WORD: u32 = size_of::<u32>() as u32;

/// Bytes of the stack used, as of the last whole search.
static USED: AtomicU32 = AtomicU32::new(0);

/// Bytes from the bottom that the search under way found painted.
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

/// Looks at the next part of the stack. For one task, at regular intervals; a whole search takes at most 48 calls.
pub fn search() {
    let stack = range();
    let from = PAINTED.load(Ordering::Relaxed);
    let to = (from + PIECE_BYTES).min(bytes());
    let used = (from..to).step_by(WORD as usize).find(|&offset| {
        let word = (stack.start + offset) as *const u32;
        // SAFETY: a word of the stack's memory. Nothing owns those below the stack pointer, and the first one that is
        // used ends the search.
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

/// Bytes of the stack used since the start, interrupts included, as of the last whole search.
pub fn used_bytes() -> u32 {
    USED.load(Ordering::Relaxed)
}
