//! The ring of codes between tick and converter, as arithmetic on indices; the image sets the registers.
//!
//! DMA takes one code from the ring every 25 µs, and erases it to mid-scale afterwards. A tick fills a slot of
//! [`OVERSAMPLING`] codes ahead of DMA, and behind that slot a continuation: the last code for the time of one tick,
//! then a fade to mid-scale. The next tick overwrites the continuation. If a tick is late, the output therefore holds
//! the last code. If no more ticks come, it goes to mid-scale without an instruction.
//!
//! A tick's own codes are put out from 212.5 µs after its trigger on, the hold ends at 612.5 µs, and the fade at
//! 1012.5 µs.

use model_format::DacCode;

use crate::safety::{MOST_HELD_TICKS, OVERSAMPLING};

/// Number of slots in the ring, a power of two.
pub const SLOTS: usize = 8;

/// Number of codes in the ring.
pub const LENGTH: usize = SLOTS * OVERSAMPLING;

/// Number of slots for which the last code of a tick is held if no other tick follows.
pub const HELD_SLOTS: usize = 1;

/// Number of slots from the held code to mid-scale. From the highest hard limit, 1.45 V, that is 3.6 V/ms, which is
/// within the default slew limit of 4 V/ms.
pub const FADED_SLOTS: usize = 2;

/// Number of slots that a tick writes: its own and the continuation.
pub const STRETCH: usize = 1 + HELD_SLOTS + FADED_SLOTS;

/// Codes between the one that DMA puts into the converter next and the one that it erases next.
pub const ERASED_BEHIND: usize = OVERSAMPLING;

/// Codes between the one that DMA fetches next and the first one that a tick may still write. They leave 25 µs to
/// compute and write a slot.
const MARGIN: usize = 1;

/// Number of codes of the fade.
const FADED: usize = FADED_SLOTS * OVERSAMPLING;

// At least two slots are erased and not yet written again.
const _: () = assert!(SLOTS.is_power_of_two() && STRETCH + 1 + 2 < SLOTS);
const _: () = assert!(OVERSAMPLING.is_power_of_two() && FADED.is_power_of_two());
const _: () = assert!(STRETCH <= 1 + MOST_HELD_TICKS as usize);

/// A slot of the ring: the place of a tick's codes.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot(usize);

impl Slot {
    /// The first slot that can still be filled, when DMA has `remaining` codes to put into the converter until the end
    /// of the ring, 1 to [`LENGTH`]. It has fetched the first of these codes already.
    #[inline(always)]
    pub const fn ahead_of(remaining: usize) -> Self {
        let next = LENGTH.wrapping_sub(remaining);
        let free = next.wrapping_add(1 + MARGIN);
        Self((free.wrapping_add(OVERSAMPLING - 1) / OVERSAMPLING) % SLOTS)
    }

    /// The slot's number, below [`SLOTS`].
    #[inline(always)]
    pub const fn number(self) -> usize {
        self.0
    }

    /// The slot that lies `others` slots further on.
    #[inline(always)]
    pub const fn after(self, others: usize) -> Self {
        Self((self.0 + others) % SLOTS)
    }

    /// The slot that is put out just before.
    #[inline(always)]
    pub const fn before(self) -> Self {
        self.after(SLOTS - 1)
    }

    /// A slot that has been erased since it was last put out, and that no tick has written since.
    #[inline(always)]
    pub const fn erased(self) -> Self {
        self.after(STRETCH)
    }

    /// Returns true if DMA had fetched the slot's first code when `remaining` codes remained.
    #[inline(always)]
    pub const fn is_late(self, remaining: usize) -> bool {
        let next = LENGTH.wrapping_sub(remaining);
        let ahead = (self.0 * OVERSAMPLING).wrapping_sub(next) % LENGTH;
        ahead == 0 || ahead > LENGTH / 2
    }
}

/// The codes of slot `slot` of the fade from `last` to mid-scale, as words. The fade's last code is mid-scale.
#[inline(always)]
pub fn faded(last: DacCode, slot: usize) -> [u32; OVERSAMPLING] {
    let mid = i32::from(DacCode::MID_SCALE.get());
    let offset = i32::from(last.get()) - mid;
    core::array::from_fn(|place| {
        let share = (FADED - 1 - slot * OVERSAMPLING - place) as i32;
        (mid + ((offset * share) >> FADED.ilog2())) as u32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::Config;
    use model_format::link::{Setting, Settings};
    use proptest::prelude::*;
    use std::vec::Vec;

    /// Codes that remain in the ring for a tick at the beginning of its period, after DMA has put `passed` more into
    /// the converter.
    fn remaining(period: usize, passed: usize) -> usize {
        LENGTH - (OVERSAMPLING * period + 1 + passed) % LENGTH
    }

    #[test]
    fn a_fade_from_the_highest_hard_limit_is_within_the_default_slew_limit() {
        let per_step = 1.0 / DacCode::STEP.0;
        let highest = (Setting::HardLimit.spec().highest * per_step) as i32;
        let slew = Config::new(&Settings::default(), 1.0).slew_steps();
        let last = DacCode::from_mid_scale(highest);
        let codes = core::iter::once(u32::from(last.get())).chain((0..FADED_SLOTS).flat_map(|slot| faded(last, slot)));
        let codes: Vec<i32> = codes.map(|code| code as i32).collect();
        let largest = codes.windows(2).map(|pair| pair[0] - pair[1]).max();
        assert!(largest <= Some(slew), "{largest:?}, {slew}");
        // One slot would be too fast.
        assert!(highest / OVERSAMPLING as i32 > slew);
    }

    #[test]
    fn a_tick_fills_one_slot_for_the_first_137_microseconds_of_its_period_and_the_next_one_after_that() {
        for period in 0..20 {
            let slot = Slot::ahead_of(remaining(period, 0));
            assert_eq!(slot.number(), (period + 1) % SLOTS);
            for passed in 0..=5 {
                assert_eq!(Slot::ahead_of(remaining(period, passed)), slot, "{passed}");
                assert!(!slot.is_late(remaining(period, passed)));
            }
            assert_eq!(Slot::ahead_of(remaining(period, 6)), slot.after(1));
            assert!(!slot.is_late(remaining(period, 6)) && slot.is_late(remaining(period, 7)));
        }
    }

    #[test]
    fn neither_what_was_written_nor_what_is_not_yet_erased_meets_the_slot_that_must_have_been_erased() {
        for passed in 0..=6 {
            let slot = Slot::ahead_of(remaining(0, passed));
            // The tick before wrote this slot or the one before it.
            for written in (0..STRETCH).flat_map(|slots| [slot.after(slots), slot.before().after(slots)]) {
                assert_ne!(written, slot.erased());
            }
            // From the code that is erased next to the one that is fetched next; an interrupt when the eraser was
            // started may have added two codes.
            let next = 1 + passed + LENGTH;
            for code in next - ERASED_BEHIND - 2..=next + 1 {
                assert_ne!(code / OVERSAMPLING % SLOTS, slot.erased().number());
            }
        }
    }

    proptest! {
        #[test]
        fn a_fade_goes_in_equal_steps_to_exactly_mid_scale(offset in -2048i32..=2047) {
            let last = DacCode::from_mid_scale(offset);
            let codes: Vec<i32> = std::iter::once(u32::from(last.get()))
                .chain((0..FADED_SLOTS).flat_map(|slot| faded(last, slot)))
                .map(|code| code as i32)
                .collect();
            prop_assert_eq!(codes[FADED], 2048);
            let equal = f64::from(offset).abs() / FADED as f64;
            for pair in codes.windows(2) {
                let step = f64::from(pair[0] - pair[1]) * f64::from(offset.signum());
                prop_assert!((step - equal).abs() <= 1.0, "{:?}", pair);
            }
        }
    }
}
