//! The ring's memory, in SRAM 1, which DMA1 reaches (RM0433 table 3). A word per code, because the converter's registers
//! are accessed by words.
//!
//! The tick writes, one stream reads and the other one writes. All are words, so no value is ever half of each.
#![expect(unsafe_code, reason = "a place in memory that DMA reaches")]

use core::sync::atomic::{AtomicU32, Ordering};

use model_format::DacCode;
use stylus_app::ring::LENGTH;

/// The code without current, as a word.
pub const MID_SCALE: u32 = DacCode::MID_SCALE.get() as u32;

/// The memory, which begins with noise.
struct Memory {
    codes: [AtomicU32; LENGTH],
    /// What the eraser writes.
    mid_scale: AtomicU32,
}

#[unsafe(link_section = ".sram1.output_ring")]
static MEMORY: Memory = Memory {
    codes: [const { AtomicU32::new(0) }; LENGTH],
    mid_scale: AtomicU32::new(0),
};

/// Address of the first code.
pub fn address() -> u32 {
    MEMORY.codes.as_ptr() as u32
}

/// Address of the word that the eraser writes.
pub fn eraser_address() -> u32 {
    MEMORY.mid_scale.as_ptr() as u32
}

/// Sets all codes to mid-scale.
pub fn clear() {
    for code in MEMORY.codes.iter().chain([&MEMORY.mid_scale]) {
        code.store(MID_SCALE, Ordering::Relaxed);
    }
    cortex_m::asm::dsb();
}

/// The code at `index`, which the callers keep below [`LENGTH`].
#[inline(always)]
pub fn get(index: usize) -> u32 {
    MEMORY.codes[index % LENGTH].load(Ordering::Relaxed)
}

/// Sets the code at `index`, which the callers keep below [`LENGTH`].
#[inline(always)]
pub fn set(index: usize, code: u32) {
    MEMORY.codes[index % LENGTH].store(code, Ordering::Relaxed);
}
