//! The ring's memory, in SRAM 1, which DMA1 reaches (RM0433 table 3). It has a word per code, because the converter's
//! registers are accessed by words.
//!
//! The tick writes, one stream reads, and the other stream writes. All accesses are words, so a value is never a
//! mixture of two writes.
#![expect(unsafe_code, reason = "a place in memory that DMA reaches")]

use core::sync::atomic::{AtomicU32, Ordering};

use model_format::DacCode;
use stylus_app::ring::{SLOTS, Slot};
use stylus_app::safety::OVERSAMPLING;

/// The code that drives no current, as a word.
pub const MID_SCALE: u32 = DacCode::MID_SCALE.get() as u32;

/// The memory. It holds noise until [`clear`].
struct Memory {
    slots: [[AtomicU32; OVERSAMPLING]; SLOTS],
    /// The word that the eraser writes.
    mid_scale: AtomicU32,
}

#[unsafe(link_section = ".sram1.output_ring")]
static MEMORY: Memory = Memory {
    slots: [const { [const { AtomicU32::new(0) }; OVERSAMPLING] }; SLOTS],
    mid_scale: AtomicU32::new(0),
};

/// Address of the first code.
pub fn address() -> u32 {
    MEMORY.slots.as_ptr() as u32
}

/// Address of the word that the eraser writes.
pub fn eraser_address() -> u32 {
    MEMORY.mid_scale.as_ptr() as u32
}

/// Sets all codes to mid-scale.
pub fn clear() {
    for code in MEMORY.slots.iter().flatten().chain([&MEMORY.mid_scale]) {
        code.store(MID_SCALE, Ordering::Relaxed);
    }
    cortex_m::asm::dsb();
}

/// The first code of `slot`.
#[inline(always)]
pub fn first(slot: Slot) -> u32 {
    codes(slot)[0].load(Ordering::Relaxed)
}

/// The last code of `slot`.
#[inline(always)]
pub fn last(slot: Slot) -> u32 {
    codes(slot)[OVERSAMPLING - 1].load(Ordering::Relaxed)
}

/// Writes the codes of `slot`.
#[inline(always)]
pub fn fill(slot: Slot, written: [u32; OVERSAMPLING]) {
    for (code, value) in codes(slot).iter().zip(written) {
        code.store(value, Ordering::Relaxed);
    }
}

#[inline(always)]
fn codes(slot: Slot) -> &'static [AtomicU32; OVERSAMPLING] {
    &MEMORY.slots[slot.number() % SLOTS]
}
