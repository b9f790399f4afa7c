//! How much of the stack was ever used: cortex-m-rt paints it before anything runs, and what is still painted never was.
#![expect(unsafe_code, reason = "the stack is looked at as memory")]

use core::ptr::addr_of;

use cortex_m_rt::STACK_PAINT_VALUE;

/// Bytes of the stack that were used since the start, of how many. Interrupts are on the same stack.
pub fn used() -> (usize, usize) {
    unsafe extern "C" {
        static _stack_start: u32;
        static _stack_end: u32;
    }
    let (bottom, top) = (addr_of!(_stack_end), addr_of!(_stack_start));
    let bytes = top as usize - bottom as usize;
    let words = bytes / size_of::<u32>();
    // SAFETY: these words are the stack's memory. Those below the stack pointer are nobody's; the first one above that
    // differs ends the search.
    let untouched = (0..words)
        .take_while(|&index| unsafe { bottom.add(index).read_volatile() } == STACK_PAINT_VALUE);
    (bytes - untouched.count() * size_of::<u32>(), bytes)
}
