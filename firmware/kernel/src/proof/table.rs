//! Constants of the expansions, computed at compile time in integers.

/// Number of Taylor terms.
pub(crate) const TERMS: usize = 14;

/// Steps of the whole circle in the table of cosines.
pub(super) const STEPS_PER_TURN: usize = 1024;

const QUARTER: usize = STEPS_PER_TURN / 4;

/// Digits of the intermediate results below.
const DIGITS: u32 = 60;

/// π/2 · 2⁶⁰, rounded to nearest.
const HALF_PI: i128 = 1_811_004_864_519_280_711;

/// cos(2π k / 1024) · 2³¹ of the first quarter turn, to one step.
static COSINES: [i32; QUARTER + 1] = cosines();

/// (π/2)^m / m! · 2³⁰, rounded to nearest.
pub(super) static FACTORS: [i32; TERMS] = factors();

/// Digits after the point of [`FACTORS`].
pub(super) const FACTOR_BITS: u32 = 30;

/// cos(2π `step` / 1024) · 2³¹, to one step.
pub(super) fn cosine(step: usize) -> i32 {
    let step = step % STEPS_PER_TURN;
    let step = step.min(STEPS_PER_TURN - step);
    if step <= QUARTER {
        COSINES[step]
    } else {
        -COSINES[2 * QUARTER - step]
    }
}

/// sin(2π `step` / 1024) · 2³¹, to one step.
pub(super) fn sine(step: usize) -> i32 {
    cosine(step + 3 * QUARTER)
}

const fn cosines() -> [i32; QUARTER + 1] {
    let mut table = [0; QUARTER + 1];
    let mut index = 0;
    while index <= QUARTER {
        let angle = HALF_PI * index as i128 / QUARTER as i128;
        let square = (angle * angle) >> DIGITS;
        let (mut term, mut sum, mut even) = (1i128 << DIGITS, 0, 2);
        // The series of the cosine; beyond 30 terms of an angle below 1.6 nothing is left.
        while even <= 60 {
            sum += term;
            term = -((term * square) >> DIGITS) / (even * (even - 1));
            even += 2;
        }
        let rounded = (sum + (1 << (DIGITS - 32))) >> (DIGITS - 31);
        table[index] = if rounded > i32::MAX as i128 {
            i32::MAX
        } else {
            rounded as i32
        };
        index += 1;
    }
    table
}

const fn factors() -> [i32; TERMS] {
    let mut table = [0; TERMS];
    let (mut term, mut index) = (1i128 << DIGITS, 0);
    while index < TERMS {
        let rounding = 1 << (DIGITS - FACTOR_BITS - 1);
        table[index] = ((term + rounding) >> (DIGITS - FACTOR_BITS)) as i32;
        index += 1;
        term = ((term * HALF_PI) >> DIGITS) / index as i128;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_PI_2, TAU};

    #[test]
    fn cosines_and_sines_are_within_a_step() {
        for step in 0..2 * STEPS_PER_TURN {
            let angle = TAU * step as f64 / STEPS_PER_TURN as f64;
            let off = |found: i32, exact: f64| (f64::from(found) - exact * 2_147_483_648.0).abs();
            assert!(off(cosine(step), libm::cos(angle)) <= 1.000_01, "{step}");
            assert!(off(sine(step), libm::sin(angle)) <= 1.000_01, "{step}");
        }
    }

    #[test]
    fn factors_are_rounded_to_nearest() {
        let mut exact = 1.0;
        for (index, &factor) in FACTORS.iter().enumerate() {
            let off = (f64::from(factor) - exact * f64::from(1 << FACTOR_BITS)).abs();
            assert!(off <= 0.500_01, "{index}");
            exact *= FRAC_PI_2 / (index + 1) as f64;
        }
    }
}
