//! Reads of a flash word that may not be readable.
//!
//! A power loss while a word of 32 bytes is programmed can leave it with an error that its code cannot correct. A read
//! of such a word is answered with a bus error (RM0433 section 4.3.12), which is precise for a load: the processor
//! takes BusFault at the load itself. The handler recognises the loads of this module and makes them return failure; a
//! BusFault anywhere else becomes a HardFault. Unlike a read with FAULTMASK set and CCR.BFHFNMIGN, this masks no
//! interrupt, so it does not delay the tick. BFAR is not used, because on revisions Y and W of the part it may be wrong
//! here (ES0392, 2.2.6).
#![expect(
    unsafe_code,
    reason = "reads of memory that may fault, and the handler that resumes them"
)]

use core::arch::global_asm;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::{Exception, SystemHandler};

use crate::map::WORD_BYTES;

// SAFETY: the procedure call standard is kept: r0 is the source and later the result, r1 the destination, and r2 need
// not be preserved. If one of the eight loads faults, it is resumed at `flash_word_failed` with nothing but r2
// undefined. Only in that case does the handler change the saved program counter, which lies 24 bytes up in the frame,
// with or without a floating-point part (ARM DDI 0403E, B1.5.7), on the main stack, the only one in use.
global_asm!(
    ".section .text.flash_word_read, \"ax\", %progbits",
    ".global flash_word_read",
    ".type flash_word_read, %function",
    ".thumb_func",
    "flash_word_read:",
    ".rept 8",
    "    ldr r2, [r0], #4",
    "    str r2, [r1], #4",
    ".endr",
    "    movs r0, #0",
    "    bx lr",
    "flash_word_failed:",
    "    movs r0, #1",
    "    bx lr",
    ".size flash_word_read, . - flash_word_read",
    ".section .text.BusFault, \"ax\", %progbits",
    ".global BusFault",
    ".type BusFault, %function",
    ".thumb_func",
    "BusFault:",
    "    ldr r0, [sp, #24]",
    "    ldr r1, =flash_word_read",
    "    bic r1, r1, #1",
    "    cmp r0, r1",
    "    blo 2f",
    "    ldr r1, =flash_word_failed",
    "    bic r1, r1, #1",
    "    cmp r0, r1",
    "    bhs 2f",
    "    str r1, [sp, #24]",
    // Writing CFSR's byte of BusFault back clears it (ARM DDI 0403E, B3.2.15).
    "    ldr r0, =0xE000ED29",
    "    ldrb r1, [r0]",
    "    strb r1, [r0]",
    "    dsb",
    "    bx lr",
    "2:  b HardFault",
    "    .ltorg",
    ".size BusFault, . - BusFault",
);

unsafe extern "C" {
    /// Copies a flash word and returns 0, or 1 if it cannot be read.
    fn flash_word_read(source: *const u32, destination: *mut u32) -> u32;
}

/// Enables BusFault, with a priority below the tick's; otherwise a bus fault would be a HardFault.
pub fn enable_bus_fault(scb: &mut SCB) {
    // SAFETY: no critical section masks by priority.
    unsafe { scb.set_priority(SystemHandler::BusFault, 0x80) };
    scb.enable(Exception::BusFault);
}

/// The flash word at `address`, a multiple of [`WORD_BYTES`] within the flash; none if it cannot be read.
pub fn read(address: u32) -> Option<[u8; WORD_BYTES]> {
    let mut word = MaybeUninit::<[u32; WORD_BYTES / 4]>::uninit();
    // SAFETY: the source is flash, aligned, and read by loads that may fault; the destination has eight words.
    let failed = unsafe { flash_word_read(address as *const u32, word.as_mut_ptr().cast()) };
    if failed != 0 {
        return None;
    }
    // SAFETY: all eight words were written.
    let word = unsafe { word.assume_init() };
    let mut bytes = [0; WORD_BYTES];
    for (part, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(word) {
        *part = word.to_le_bytes();
    }
    Some(bytes)
}
