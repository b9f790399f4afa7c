//! The ring of codes between tick and converter, as numbers; the registers are the image's.
//!
//! DMA takes one code per 25 µs from the ring, and erases to mid-scale what it has taken. A tick fills a slot of
//! [`OVERSAMPLING`] codes ahead of it, and after that slot a continuation: the last code for the time of one tick, then
//! a fade to mid-scale. The next tick overwrites the continuation. So a late tick is heard as a code that is held, and
//! an output whose ticks have ended goes to mid-scale without an instruction.
//!
//! A tick's own codes are put out from 212.5 µs after its trigger on, the hold ends at 612.5 µs, and the fade at
//! 1012.5 µs.

use model_format::DacCode;

use crate::safety::OVERSAMPLING;

/// Number of codes in the ring, a power of two.
pub const LENGTH: usize = 8 * OVERSAMPLING;

/// Number of codes for which the last code of a tick is held if no other tick follows.
pub const HELD: usize = OVERSAMPLING;

/// Number of codes from the held one to mid-scale. From the highest hard limit, 1.6 V, that is 4 V/ms, the default slew
/// limit.
pub const FADED: usize = 2 * OVERSAMPLING;

/// Number of codes that a tick writes, from the beginning of its slot.
pub const STRETCH: usize = OVERSAMPLING + HELD + FADED;

/// Distance between the code that DMA puts into the converter next and the one that it erases next.
pub const ERASED_BEHIND: usize = OVERSAMPLING;

/// Codes between the one that DMA fetches next and the first one that a tick may still write: 25 µs to compute and write
/// them.
const MARGIN: usize = 1;

const MASK: usize = LENGTH - 1;

// The part that is erased and not yet written again is at least a slot long.
const _: () =
    assert!(LENGTH.is_power_of_two() && STRETCH + ERASED_BEHIND + 2 * OVERSAMPLING <= LENGTH);

/// A slot of the ring: the place of a tick's codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot(usize);

impl Slot {
    /// The first slot that can still be filled, when DMA has `remaining` codes to put into the converter until the end
    /// of the ring, 1 to [`LENGTH`]. It has fetched the first of these codes already.
    #[inline(always)]
    pub const fn ahead_of(remaining: usize) -> Self {
        let next = LENGTH.wrapping_sub(remaining);
        let free = next.wrapping_add(1 + MARGIN);
        Self(free.next_multiple_of(OVERSAMPLING) & MASK)
    }

    /// Index of the code at `place` of the stretch that begins with this slot.
    #[inline(always)]
    pub const fn index(self, place: usize) -> usize {
        (self.0 + place) & MASK
    }

    /// Index of the code that is put out just before this slot.
    #[inline(always)]
    pub const fn before(self) -> usize {
        self.0.wrapping_sub(1) & MASK
    }

    /// Index of a code that has been erased since it was last put out, and that no tick has written since.
    #[inline(always)]
    pub const fn erased(self) -> usize {
        self.index(STRETCH)
    }

    /// Returns true if DMA had fetched the slot's first code when `remaining` codes remained.
    #[inline(always)]
    pub const fn is_late(self, remaining: usize) -> bool {
        let ahead = self.0.wrapping_sub(LENGTH.wrapping_sub(remaining)) & MASK;
        ahead == 0 || ahead > LENGTH / 2
    }
}

/// The code at `place` of the fade from `last` to mid-scale, 0 to [`FADED`] - 1. The last one is mid-scale.
#[inline(always)]
pub const fn faded(last: DacCode, place: usize) -> u32 {
    let (last, mid) = (last.get() as i32, DacCode::MID_SCALE.get() as i32);
    let share = (FADED - 1 - place) as i32;
    (mid + (((last - mid) * share) >> FADED.ilog2())) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Codes that a tick at the beginning of its period finds still to be put into the converter.
    fn on_time(period: usize) -> usize {
        LENGTH - (OVERSAMPLING * period + 1) % LENGTH
    }

    #[test]
    fn a_tick_fills_one_slot_for_the_first_137_microseconds_of_its_period_and_the_next_one_after_that()
     {
        for period in 0..20 {
            let remaining = |passed: usize| match (on_time(period) + LENGTH - passed) % LENGTH {
                0 => LENGTH,
                other => other,
            };
            let slot = Slot::ahead_of(remaining(0));
            assert_eq!(slot.index(0), (period + 1) * OVERSAMPLING % LENGTH);
            for passed in 0..=5 {
                assert_eq!(Slot::ahead_of(remaining(passed)), slot, "{passed}");
                assert!(!slot.is_late(remaining(passed)));
            }
            let next = Slot::ahead_of(remaining(6));
            assert_eq!(next.index(0), slot.index(OVERSAMPLING));
            assert!(!slot.is_late(remaining(6)) && slot.is_late(remaining(7)));
        }
    }

    #[test]
    fn neither_what_is_read_nor_what_is_written_meets_the_code_that_must_have_been_erased() {
        for passed in 0..=6 {
            let next = 1 + passed;
            let slot = Slot::ahead_of(LENGTH - next);
            // Erased since the last period at the latest, when the stretch began a slot earlier.
            let written = (0..STRETCH).map(|place| slot.index(place + LENGTH - OVERSAMPLING));
            let eraser = (next + LENGTH - ERASED_BEHIND) % LENGTH;
            assert!(written.clone().all(|index| index != slot.erased()));
            // From what is erased next to what is put out next, nothing has been erased yet.
            assert!(
                (0..=ERASED_BEHIND + 1).all(|ahead| (eraser + ahead) % LENGTH != slot.erased())
            );
        }
    }

    proptest! {
        #[test]
        fn a_fade_goes_in_equal_steps_to_exactly_mid_scale(offset in -2048i32..=2047) {
            let last = DacCode::from_mid_scale(offset);
            let codes: Vec<i32> = std::iter::once(i32::from(last.get()))
                .chain((0..FADED).map(|place| faded(last, place) as i32))
                .collect();
            prop_assert_eq!(codes[FADED], 2048);
            let equal = f64::from(offset).abs() / FADED as f64;
            for pair in codes.windows(2) {
                let step = f64::from(pair[1] - pair[0]) * -f64::from(offset.signum());
                prop_assert!((step - equal).abs() <= 1.0 || offset == 0, "{:?}", pair);
            }
        }
    }

    use std::vec::Vec;
}
