//! Sections of an equaliser as they are stored, and the check that they pass before they are played.

use serde::{Deserialize, Serialize};

use super::error::SceneProblem;
use super::limits::{MAX_EQUALISER_GAIN, MAX_POLE_RADIUS_1024THS};

/// A section of second order, `(b0 + b1 z⁻¹ + b2 z⁻²) / (1 + a1 z⁻¹ + a2 z⁻²)`.
///
/// All five coefficients are stored in steps of 2⁻²⁸, so that they lie between -8 and 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Biquad {
    /// b0, b1, b2, in steps of 2⁻²⁸.
    pub numerator: [i32; 3],
    /// a1, a2, in steps of 2⁻²⁸.
    pub denominator: [i32; 2],
}

impl Biquad {
    /// Binary digits after the point of a coefficient.
    pub const FRACTION_BITS: u32 = 28;

    /// The section that leaves its input as it is.
    pub const IDENTITY: Self = Self {
        numerator: [1 << Self::FRACTION_BITS, 0, 0],
        denominator: [0, 0],
    };

    /// The section of these coefficients, each to the nearest step. None if one of them is out of range or not finite.
    pub fn from_f64(numerator: [f64; 3], denominator: [f64; 2]) -> Option<Self> {
        let mut stored = Self::IDENTITY;
        let places = stored.numerator.iter_mut().chain(&mut stored.denominator);
        for (place, value) in places.zip(numerator.into_iter().chain(denominator)) {
            let steps = value * (1i64 << Self::FRACTION_BITS) as f64;
            // A cast truncates; half a step more makes the result the nearest.
            let steps = if steps < 0.0 {
                steps - 0.5
            } else {
                steps + 0.5
            };
            if !(f64::from(i32::MIN)..f64::from(i32::MAX)).contains(&steps) {
                return None;
            }
            *place = steps as i32;
        }
        Some(stored)
    }

    /// b0, b1, b2 as numbers.
    pub fn numerator(&self) -> [f64; 3] {
        self.numerator.map(value)
    }

    /// a1, a2 as numbers.
    pub fn denominator(&self) -> [f64; 2] {
        self.denominator.map(value)
    }

    /// Returns whether both poles lie within the limit's radius ρ.
    ///
    /// The test is Jury's triangle for z/ρ, which is |a2| ≤ ρ² and ρ|a1| ≤ ρ² + a2. It is exact in the stored integers.
    pub fn poles_are_within_limit(&self) -> bool {
        const RADIUS: i64 = MAX_POLE_RADIUS_1024THS;
        let [a1, a2] = self.denominator.map(i64::from);
        let square = (RADIUS * RADIUS) << Self::FRACTION_BITS;
        // Everything times 2²⁰; no product reaches 2⁵³.
        let a2 = a2 << 20;
        a2.abs() <= square && a1.abs() * RADIUS * 1024 <= square + a2
    }

    /// The square of the gain at the angular frequency whose cosine is `cos`: numerator and denominator are polynomials
    /// in it.
    fn square_gain(&self, cos: f64) -> f64 {
        let square = |c: [f64; 3]| {
            let [c0, c1, c2] = c;
            // |c0 + c1 z⁻¹ + c2 z⁻²|² with z on the unit circle, as a sum of squares, so that nothing cancels.
            let real = c0 * cos + c1 + c2 * cos;
            let imaginary = c0 - c2;
            real * real + imaginary * imaginary * (1.0 - cos) * (1.0 + cos)
        };
        let [a1, a2] = self.denominator();
        square(self.numerator()) / square([1.0, a1, a2])
    }

    /// Cosine of the angular frequency at which the denominator is smallest.
    fn resonance(&self) -> f64 {
        let [a1, a2] = self.denominator();
        if a2 > 0.0 {
            (-a1 * (1.0 + a2) / (4.0 * a2)).clamp(-1.0, 1.0)
        } else if a1 < 0.0 {
            1.0
        } else {
            -1.0
        }
    }
}

fn value(steps: i32) -> f64 {
    f64::from(steps) / (1i64 << Biquad::FRACTION_BITS) as f64
}

/// Checks the poles and the gain of each of `sections`, and the gain of all sections up to each of them.
///
/// Gains are taken at the resonances of all sections, at both ends of the band and at 127 frequencies between. These
/// are spread evenly, but denser at the ends. That is a sample and no proof; a narrow peak lies at a resonance.
///
/// # Errors
/// The index of the first section with a fault, and the fault.
pub(super) fn check(sections: &[Biquad]) -> Result<(), (usize, SceneProblem)> {
    const INTERVALS: u32 = 128;
    if let Some(at) = sections.iter().position(|s| !s.poles_are_within_limit()) {
        return Err((at, SceneProblem::PoleRadius));
    }
    let resonances = sections.iter().map(Biquad::resonance);
    let spread = (0..=INTERVALS).map(|step| {
        let t = f64::from(2 * step) / f64::from(INTERVALS) - 1.0;
        // Near the ends 1 - |cos| grows with the square of the distance, as the cosine of an even step does.
        (t * (3.0 - t * t) / 2.0).clamp(-1.0, 1.0)
    });
    let highest = MAX_EQUALISER_GAIN * MAX_EQUALISER_GAIN;
    for cos in resonances.chain(spread) {
        let mut all = 1.0;
        for (at, section) in sections.iter().enumerate() {
            let own = section.square_gain(cos);
            all *= own;
            // The comparison is negated because a NaN must be refused too.
            if !(own <= highest && all <= highest) {
                return Err((at, SceneProblem::EqualiserGain));
            }
        }
    }
    Ok(())
}
