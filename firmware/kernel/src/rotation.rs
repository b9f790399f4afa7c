//! Rotations (cos θ, sin θ) in 32 bits that never lengthen a vector, even in integer arithmetic.
//!
//! θ comes as a **sum**, in steps of which [`SUM_QUARTER_TURN`] are π/2: a mean of stored codes before anything is
//! rounded. Sine and cosine of the nearest angle of a table are turned by the rest, an angle of at most π/1152, by a
//! series of second order whose slope is chosen for that range. The table's radius is below one by more than all
//! round-off, so that cos² + sin² ≤ 2⁶² holds exactly. The lattice's bound on energy relies on this.
//!
//! The table has 288 steps per quarter turn, because with 256, a power of two, sine and cosine would be more than four
//! steps of 2⁻³¹ off. It covers three quarter turns, -π/2 to π, so that one index finds sine and cosine without a
//! branch on the sign.

pub use model_format::THETA_FRACTION_BITS;

use crate::fixed::{high_word_rounded, plus_high_word};

/// θ = ±π/2, the ends of the range, in steps of a stored fine θ, π/2²⁴: 2²³.
pub const THETA_QUARTER_TURN: i32 = 1 << (15 + THETA_FRACTION_BITS);

/// Steps of the table per quarter turn.
pub const TABLE_STEPS: usize = 288;

/// Binary logarithm of a step of the table, in steps of a sum.
pub const STEP_BITS: u32 = 21;

/// A quarter turn in steps of a sum.
pub const SUM_QUARTER_TURN: i32 = (TABLE_STEPS as i32) << STEP_BITS;

/// Steps of a sum per step of a stored fine θ, π/2²⁴.
pub const SUM_PER_THETA: i32 = SUM_QUARTER_TURN / THETA_QUARTER_TURN;

/// Lowest binary digits of a sum that a rotation ignores. They absorb what the truncated products of a mean lose, so
/// that the mean of equal angles is that angle.
pub const SPARE_BITS: u32 = 3;

const _: () = assert!(SUM_PER_THETA % (1 << SPARE_BITS) == 0);
const _: () = assert!(SUM_PER_THETA * THETA_QUARTER_TURN == SUM_QUARTER_TURN);

/// Difference of the table's radius from one, in steps of 2⁻³¹.
const RADIUS_DEFICIT: f64 = 1.5;

/// Sines in Q31, times the radius, of the angles from -π/2 to π by steps of the table. The cosine of an angle is the
/// entry [`TABLE_STEPS`] further on.
pub static SINES: [i32; 3 * TABLE_STEPS + 1] = sines();

/// Angle of a step of the table in steps of 2⁻³². Multiplied by the rest of a sum, it gives the sine of the rest.
///
/// The value is smaller than the angle by a relative h²/8, where h is half the angle. The error of the sine, φ³/6 -
/// φ·h²/8, is then at most h³/24 from -h to h, a fourth of the error with the angle itself.
pub const ANGLE: i32 = {
    let step = core::f64::consts::FRAC_PI_2 / TABLE_STEPS as f64;
    (step * (1.0 - step * step / 32.0) * (1u64 << 32) as f64 + 0.5) as i32
};

/// A rotation by θ = arcsin k, in steps of 2⁻³¹. cos² + sin² ≤ 2⁶² holds in the integers.
///
/// The negative of the sine is stored as well, so that the lattice needs no instruction for it. The three words have
/// this order because a processor's own [`crate::arithmetic::Arithmetic`] may load them at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Rotation {
    /// cos θ, not negative.
    pub cos: i32,
    /// sin θ, the stage's reflection coefficient.
    pub sin: i32,
    /// -sin θ.
    pub neg_sin: i32,
}

impl Rotation {
    /// No rotation: a stage that only delays.
    pub const NONE: Self = Self {
        cos: sine(TABLE_STEPS),
        sin: 0,
        neg_sin: 0,
    };

    /// The rotation by `theta`, in steps of π/2²⁴ rad, clamped to ±[`THETA_QUARTER_TURN`].
    ///
    /// Sine and cosine are within 4 steps of 2⁻³¹ of the exact values.
    #[inline]
    pub fn from_theta(theta: i32) -> Self {
        Self::from_sum(theta.clamp(-THETA_QUARTER_TURN, THETA_QUARTER_TURN) * SUM_PER_THETA)
    }

    /// The rotation by `sum`, of at most [`SUM_QUARTER_TURN`] in magnitude, rounded down to a multiple of
    /// 2^[`SPARE_BITS`].
    #[inline(always)]
    pub fn from_sum(sum: i32) -> Self {
        const REST_BITS: u32 = 32 - STEP_BITS;
        let nearest = (sum + (1 << (STEP_BITS - 1))) >> STEP_BITS;
        // No sum of the range exceeds this bound, which replaces checks of the table's length.
        let index = (nearest + TABLE_STEPS as i32) as usize;
        let index = index.min(2 * TABLE_STEPS);
        let (s, c) = (SINES[index], SINES[index + TABLE_STEPS]);
        // Sine of the rest, and half of that sine: cos φ = 1 - sine · half within h⁴/12, which is a hundredth of a step
        // of 2⁻³¹.
        let rest = (sum >> SPARE_BITS) << (REST_BITS + SPARE_BITS);
        let sine = high_word_rounded(i64::from(rest) * i64::from(ANGLE));
        let half = i64::from(sine >> 1);
        let sine = i64::from(sine);
        let to_sin = plus_high_word(c, -half * i64::from(s));
        let to_cos = plus_high_word(s, half * i64::from(c));
        let sin = plus_high_word(s, sine * i64::from(to_sin));
        let cos = plus_high_word(c, -sine * i64::from(to_cos));
        Self {
            cos,
            sin,
            neg_sin: -sin,
        }
    }
}

const fn sines() -> [i32; 3 * TABLE_STEPS + 1] {
    let mut table = [0; 3 * TABLE_STEPS + 1];
    let mut index = 0;
    while index <= TABLE_STEPS {
        let sine = sine(index);
        table[TABLE_STEPS - index] = -sine;
        table[TABLE_STEPS + index] = sine;
        table[3 * TABLE_STEPS - index] = sine;
        index += 1;
    }
    table
}

/// Sine of `index` steps of the table, at most a quarter turn, in Q31 times the radius.
const fn sine(index: usize) -> i32 {
    let angle = core::f64::consts::FRAC_PI_2 * index as f64 / TABLE_STEPS as f64;
    let (mut term, mut sum, mut n) = (angle, angle, 1.0);
    while n < 25.0 {
        term *= -angle * angle / ((n + 1.0) * (n + 2.0));
        sum += term;
        n += 2.0;
    }
    let radius = (1u32 << 31) as f64 - RADIUS_DEFICIT;
    (sum * radius + 0.5) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square_norm(rotation: Rotation) -> u64 {
        let square = |x: i32| u64::from(x.unsigned_abs()).pow(2);
        square(rotation.cos) + square(rotation.sin)
    }

    /// All 150 994 945 sums that differ, and so every mean of any nodes.
    #[test]
    fn no_sum_lengthens_a_vector() {
        for sum in (-SUM_QUARTER_TURN..=SUM_QUARTER_TURN).step_by(1 << SPARE_BITS) {
            let rotation = Rotation::from_sum(sum);
            assert!(square_norm(rotation) <= 1 << 62, "sum {sum}");
            assert!(rotation.cos >= 0 && rotation.neg_sin == -rotation.sin);
        }
        assert!(square_norm(Rotation::NONE) <= 1 << 62);
    }

    #[test]
    fn sine_and_cosine_are_within_four_steps_of_the_exact_ones() {
        let unit = libm::exp2(31.0);
        let mut worst: f64 = 0.0;
        for theta in (-THETA_QUARTER_TURN..=THETA_QUARTER_TURN).step_by(97) {
            let rotation = Rotation::from_theta(theta);
            let angle = f64::from(theta) * core::f64::consts::PI / libm::exp2(24.0);
            let (sin, cos) = libm::sincos(angle);
            worst = worst
                .max((f64::from(rotation.sin) - sin * unit).abs())
                .max((f64::from(rotation.cos) - cos * unit).abs());
        }
        assert!(worst < 4.0, "worst {worst}");
    }

    #[test]
    fn no_angle_is_no_rotation_and_beyond_the_ends_is_the_end() {
        assert_eq!(Rotation::from_theta(0), Rotation::NONE);
        let end = Rotation::from_theta(THETA_QUARTER_TURN);
        assert_eq!(Rotation::from_theta(i32::MAX), end);
        assert_eq!(end.cos, 0);
        assert_eq!(Rotation::from_theta(i32::MIN).sin, -end.sin);
    }
}
