//! Margins as a certificate stores them, in units of the proof.

use model_format::{CELL_MARGIN_STEPS_PER_OCTAVE, UNCERTIFIED_CELL};

use super::units::UNIT_BITS;

/// 2^(-step/4) · 2³² of a margin's steps within an octave, rounded up.
const QUARTERS: [u64; CELL_MARGIN_STEPS_PER_OCTAVE as usize] =
    [1 << 32, 3_611_622_603, 3_037_000_500, 2_553_802_834];

/// Margin that `byte` of a certificate claims, in units of 2^(`exponent` - 41), rounded up; at least one.
pub fn claimed_units(byte: u8, exponent: u32) -> i64 {
    let steps = CELL_MARGIN_STEPS_PER_OCTAVE;
    let quarter = QUARTERS[usize::from(byte % steps)];
    let octaves = u32::from(byte / steps) + exponent;
    // One is 2^(41 - exponent) units, and the table has 32 digits.
    let more = UNIT_BITS - 32;
    let units = if octaves <= more {
        quarter << (more - octaves)
    } else {
        (quarter >> (octaves - more).min(63)) + 1
    };
    units as i64
}

/// The byte that claims most of a margin of `units`, without exceeding it; [`UNCERTIFIED_CELL`] if none does.
pub fn margin_byte(units: i64, exponent: u32) -> u8 {
    let mut bytes = 0..UNCERTIFIED_CELL;
    bytes
        .find(|&byte| claimed_units(byte, exponent) <= units)
        .unwrap_or(UNCERTIFIED_CELL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(byte: u8, exponent: u32) -> f64 {
        let digits = f64::from(UNIT_BITS) - f64::from(exponent) - f64::from(byte) / 4.0;
        libm::exp2(digits)
    }

    #[test]
    fn a_claim_is_rounded_up_by_less_than_a_unit_and_a_share() {
        for exponent in 0..=10 {
            for byte in 0..UNCERTIFIED_CELL {
                let (claimed, exact) =
                    (claimed_units(byte, exponent) as f64, exact(byte, exponent));
                assert!(claimed >= exact * (1.0 - 1e-14), "{byte} {exponent}");
                assert!(claimed <= exact * (1.0 + 1e-9) + 1.0, "{byte} {exponent}");
            }
        }
    }

    proptest! {
        #[test]
        fn a_margin_s_byte_claims_no_more_and_at_least_five_sixths(units in 1i64..1 << 41, exponent in 0u32..=10) {
            let byte = margin_byte(units, exponent);
            let claimed = claimed_units(byte, exponent);
            prop_assert!(claimed <= units);
            prop_assert!(byte == 0 || (claimed + 1) * 6 >= units * 5 || units < 16);
        }
    }

    #[test]
    fn no_byte_claims_a_margin_of_nothing() {
        assert_eq!(margin_byte(0, 0), UNCERTIFIED_CELL);
        assert_eq!(margin_byte(-5, 3), UNCERTIFIED_CELL);
    }
}
