//! Peak use of the stack: cortex-m-rt paints the stack before anything runs, and words that keep the paint were never
//! used.
#![expect(unsafe_code, reason = "the stack is read as memory")]

use core::ptr::addr_of;

use cortex_m_rt::STACK_PAINT_VALUE;

/// Bytes of the stack used since the start, and its length in bytes. Interrupts use the same stack.
pub fn used() -> (usize, usize) {
    unsafe extern "C" {
        static _stack_start: u32;
        static _stack_end: u32;
    }
    let (bottom, top) = (addr_of!(_stack_end), addr_of!(_stack_start));
    let bytes = top as usize - bottom as usize;
    let words = bytes / size_of::<u32>();
    // SAFETY: these words are the stack's memory. Nothing owns those below the stack pointer; the first word that
    // differs ends the search.
    let untouched = (0..words)
        .take_while(|&index| unsafe { bottom.add(index).read_volatile() } == STACK_PAINT_VALUE);
    (bytes - untouched.count() * size_of::<u32>(), bytes)
}
