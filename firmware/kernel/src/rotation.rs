//! Rotations (cos θ, sin θ) in 32 bits that never lengthen a vector, in the integers themselves.
//!
//! θ is added up from a coarse angle, whose sine and cosine are read from a table, and a small one, by the addition
//! theorems. The table's radius is below one by more than all round-off, so that cos² + sin² ≤ 2⁶² holds exactly. The
//! lattice's bound on energy rests on this.

pub use model_format::THETA_FRACTION_BITS;

/// θ = ±π/2, the ends of the range, in steps of an interpolated θ: 2²³.
pub const THETA_QUARTER_TURN: i32 = 1 << (15 + THETA_FRACTION_BITS);

/// Steps of θ between the table's angles, as a power of two.
const COARSE_BITS: u32 = 15;
const COARSE_COUNT: usize = (THETA_QUARTER_TURN >> COARSE_BITS) as usize;

/// Difference of the table's radius from one, in steps of 2⁻³¹.
const RADIUS_DEFICIT: i32 = 2;

/// Sines of the coarse angles in Q31, times the radius. Read backwards they are the cosines.
static SINES: [i32; COARSE_COUNT + 1] = sines();

/// A rotation by θ = arcsin k, in steps of 2⁻³¹. cos² + sin² ≤ 2⁶² holds in the integers.
///
/// The negative of the sine is kept as well, so that the lattice needs no instruction to make it. The three words have
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
        cos: i32::MAX - (RADIUS_DEFICIT - 1),
        sin: 0,
        neg_sin: 0,
    };

    /// The rotation by `theta`, in steps of π/2²⁴ rad. Values beyond ±[`THETA_QUARTER_TURN`] count as that.
    ///
    /// Sine and cosine are within 4 steps of 2⁻³¹ of the exact ones.
    #[inline]
    pub fn from_theta(theta: i32) -> Self {
        let magnitude = theta
            .clamp(-THETA_QUARTER_TURN, THETA_QUARTER_TURN)
            .unsigned_abs();
        let coarse = (magnitude >> COARSE_BITS) as usize;
        let fine = magnitude & ((1 << COARSE_BITS) - 1);
        let (sin_a, cos_a) = (SINES[coarse], SINES[COARSE_COUNT - coarse]);
        let (sin_b, versin_b) = small_angle(fine);
        let sin = sin_a + difference_of_products(cos_a, sin_b, sin_a, versin_b);
        let cos = cos_a + difference_of_products(-sin_a, sin_b, cos_a, versin_b);
        let sin = if theta < 0 { -sin } else { sin };
        Self {
            cos,
            sin,
            neg_sin: -sin,
        }
    }
}

/// sin b and 1 - cos b in Q31 for b below one coarse step, by their series, whose remainder is below a seventh of a
/// step.
#[inline(always)]
fn small_angle(fine: u32) -> (i32, i32) {
    /// π·2⁷, the Q31 angle per step of θ, with 23 more digits.
    const STEP: u64 = (core::f64::consts::PI * (1u64 << 30) as f64 + 0.5) as u64;
    let angle = ((u64::from(fine) * STEP + (1 << 22)) >> 23) as i32;
    let square = difference_of_products(angle, angle, 0, 0);
    let cube = difference_of_products(square, angle, 0, 0);
    (angle - (cube + 3) / 6, (square + 1) >> 1)
}

/// a·b - c·d in Q31, rounded to nearest once.
#[inline(always)]
fn difference_of_products(a: i32, b: i32, c: i32, d: i32) -> i32 {
    let exact = i64::from(a) * i64::from(b) - i64::from(c) * i64::from(d);
    ((exact + (1 << 30)) >> 31) as i32
}

const fn sines() -> [i32; COARSE_COUNT + 1] {
    let mut table = [0; COARSE_COUNT + 1];
    let mut index = 0;
    while index <= COARSE_COUNT {
        let angle = core::f64::consts::FRAC_PI_2 * index as f64 / COARSE_COUNT as f64;
        let (mut term, mut sum, mut n) = (angle, angle, 1.0);
        while n < 25.0 {
            term *= -angle * angle / ((n + 1.0) * (n + 2.0));
            sum += term;
            n += 2.0;
        }
        let radius = (1u32 << 31) as f64 - RADIUS_DEFICIT as f64;
        table[index] = (sum * radius + 0.5) as i32;
        index += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square_norm(rotation: Rotation) -> u64 {
        let square = |x: i32| u64::from(x.unsigned_abs()).pow(2);
        square(rotation.cos) + square(rotation.sin)
    }

    /// All θ that can be stored or interpolated are among them.
    #[test]
    fn no_theta_lengthens_a_vector() {
        for theta in -THETA_QUARTER_TURN..=THETA_QUARTER_TURN {
            let rotation = Rotation::from_theta(theta);
            assert!(square_norm(rotation) <= 1 << 62, "theta {theta}");
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
