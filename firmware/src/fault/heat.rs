//! The coil's heat, kept over a reset, because a coil is as hot after a reset as before, however the program ended.
//!
//! Two copies are written in turn, so that a reset during a write leaves the other copy, at most two milliseconds old.
//! Each has a checksum. The duration of the reset is not known, so no cooling is subtracted. After power-on the memory
//! holds noise, and its error-correcting codes are wrong, too, so it is not even read.
#![expect(unsafe_code, reason = "a place in memory that outlives a reset")]

use core::sync::atomic::{AtomicU32, Ordering};

use model_format::link::ResetReason;
use stylus_app::safety::Heat;

use crate::fault::record::checksum;

/// Whole words, so that no word waits in the memory's buffer for its error-correcting code when the reset comes
/// (AN5342, section 2).
type Copy = [AtomicU32; 3];

#[unsafe(link_section = ".uninit.heat")]
static KEPT: [Copy; 2] = [const { [const { AtomicU32::new(0) }; 3] }; 2];

/// The copy that is written next.
static NEXT: AtomicU32 = AtomicU32::new(0);

fn sum(low: u32, high: u32) -> u32 {
    checksum(0x4845_4154, &[low, high])
}

fn load(copy: &Copy) -> Option<Heat> {
    let [low, high, kept] = copy.each_ref().map(|word| word.load(Ordering::Relaxed));
    let heat = Heat::from_bits(u64::from(high) << 32 | u64::from(low));
    heat.filter(|_| kept == sum(low, high))
}

/// Returns the heat from before the reset: the higher value of the two copies. Returns none after power-on, or if
/// neither copy has a valid checksum.
pub fn take(cause: ResetReason) -> Option<Heat> {
    if cause == ResetReason::PowerOn {
        return None;
    }
    KEPT.iter().filter_map(load).max()
}

/// Keeps `heat`. Called every millisecond, by one task.
pub fn keep(heat: Heat) {
    let next = NEXT.load(Ordering::Relaxed);
    NEXT.store(next ^ 1, Ordering::Relaxed);
    let bits = heat.to_bits();
    let (low, high) = (bits as u32, (bits >> 32) as u32);
    let words = [low, high, sum(low, high)];
    for (kept, word) in KEPT[next as usize & 1].iter().zip(words) {
        kept.store(word, Ordering::Relaxed);
    }
    cortex_m::asm::dsb();
}
