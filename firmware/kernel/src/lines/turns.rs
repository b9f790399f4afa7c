//! Turns of a line per mm, and its phase at a position, with a relative error of 4·10⁻¹² of the turns over a thousand
//! kilometres.

use crate::position::Position;

/// Binary digits after the point of turns per mm.
const TURNS_BITS: u32 = 48;

/// Turns of a line per mm, in steps of 2⁻⁴⁸. The smallest value has 38 binary digits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turns(u64);

impl Turns {
    /// The turns per mm for `wavelength_mm`, which must be that of a valid texture.
    pub(super) fn of(wavelength_mm: f32) -> Self {
        // A float is an integer of 24 bits times a power of two; the quotient of integers is shifted by this power.
        let bits = wavelength_mm.to_bits();
        let mantissa = u64::from(bits & 0x007f_ffff | 0x0080_0000);
        let exponent = (bits >> 23).cast_signed() - 150;
        // 2⁶² / mantissa has 39 bits; 2⁴⁸ / wavelength is that quotient times 2^-(14 + exponent).
        let quotient = (1 << 62) / mantissa;
        let shift = 14 + exponent;
        Self(if shift >= 0 {
            quotient >> shift.min(63)
        } else {
            quotient << (-shift).min(24)
        })
    }

    /// Phase of `position`, in steps of 2⁻³² of a turn.
    pub(super) fn phase(self, position: Position) -> u32 {
        // Bits 48 to 79 of the product of 64 by 64 bits, computed in parts of 32 bits. The bits that are lost beyond 64
        // are whole turns.
        let (high, low) = (position.steps() >> 32, position.steps() & 0xffff_ffff);
        let (turns_high, turns_low) = ((self.0 >> 32).cast_signed(), self.0 & 0xffff_ffff);
        let lowest = (low.cast_unsigned() * turns_low) >> 32;
        let middle = low.wrapping_mul(turns_high).wrapping_add(lowest.cast_signed());
        let middle = middle.wrapping_add(high.wrapping_mul(turns_low.cast_signed()));
        let whole = high.wrapping_mul(turns_high) << 32;
        (middle.wrapping_add(whole) >> (TURNS_BITS - 32)) as u32
    }

    /// Turns at `position`, including whole turns, in steps of 2⁻¹⁶ of a turn. In addition to the error of the turns
    /// per mm, they are too low by up to two steps: one for the lowest product, which is left out, and one for rounding
    /// down.
    pub(super) fn turns(self, position: Position) -> i64 {
        // Each product of 32 by 32 bits is reduced to steps of 2⁻³² before the sum, so that the sum does not overflow.
        let (high, low) = (position.steps() >> 32, position.steps() & 0xffff_ffff);
        let (turns_high, turns_low) = ((self.0 >> 32).cast_signed(), (self.0 & 0xffff_ffff).cast_signed());
        let middle = ((low * turns_high) >> 16) + ((high * turns_low) >> 16);
        high * turns_high + (middle >> 16)
    }

    /// Phase over a distance of `steps` steps of a position, including whole turns. `exact` is the difference of the
    /// phases at its ends.
    pub(super) fn way(self, steps: i64, exact: u32) -> i64 {
        // `coarse` is off by less than 0.01 turns, so the nearest number with the exact low digits is right.
        let coarse = ((steps >> 16) * (self.0 >> 16).cast_signed()) >> 16;
        coarse + i64::from(exact.wrapping_sub(coarse as u32).cast_signed())
    }
}

#[cfg(test)]
mod tests {
    use super::super::LONGEST;
    use super::*;
    use proptest::prelude::*;

    /// The wavelength as the exact value of the float: mantissa · 2^exponent.
    fn fraction(wavelength_mm: f32) -> (i128, i32) {
        let bits = wavelength_mm.to_bits();
        let mantissa = i128::from(bits & 0x007f_ffff | 0x0080_0000);
        (mantissa, (bits >> 23).cast_signed() - 150)
    }

    proptest! {
        /// Compared with the turns as a fraction of integers of 128 bits, over 1000 km.
        #[test]
        fn a_phase_is_that_of_the_position_over_a_thousand_kilometres(
            bits in 0.02f32.to_bits()..=1000f32.to_bits(), mm in -1e9f64..1e9,
        ) {
            let wavelength_mm = f32::from_bits(bits);
            let position = Position::from_exact_mm(mm);
            let phase = Turns::of(wavelength_mm).phase(position);
            // Turns in steps of 2⁻³², from steps of 2⁻³² mm: steps / wavelength, which needs 90 bits.
            let (mantissa, exponent) = fraction(wavelength_mm);
            let scaled = i128::from(position.steps()) << (-exponent).clamp(0, 40);
            let exact = scaled.div_euclid(mantissa);
            let off = phase.wrapping_sub(exact as u32).cast_signed();
            // A relative error of 4·10⁻¹² of the turns, and two steps.
            let turns = (mm / f64::from(wavelength_mm)).abs();
            let bound = 2.0 + turns * 4e-12 * libm::exp2(32.0);
            prop_assert!(f64::from(off).abs() <= bound, "{off}, {bound}, {turns} turns");
        }

        /// The turns of a distance of at most [`LONGEST`] are exact, including whole ones; the way back has as many.
        #[test]
        fn the_turns_of_a_way_are_those_of_its_length(
            bits in 0.02f32.to_bits()..=1000f32.to_bits(), mm in -1e6f64..1e6, way_mm in -256f64..256.0,
        ) {
            let turns = Turns::of(f32::from_bits(bits));
            let [from, to] = [mm, mm + way_mm].map(Position::from_exact_mm);
            let exact = turns.phase(to).wrapping_sub(turns.phase(from));
            let steps = to.since(from);
            prop_assume!(steps.unsigned_abs() <= LONGEST);
            let way = turns.way(steps, exact);
            prop_assert_eq!(way as u32, exact);
            let expected = steps as f64 / f64::from(f32::from_bits(bits));
            prop_assert!((way as f64 - expected).abs() < 3.0 + expected.abs() * 1e-11, "{} {}", way, expected);
            prop_assert_eq!(turns.way(-steps, exact.wrapping_neg()), -way);
        }
    }
}
