//! Sections of an equaliser as they are stored, and the check that they pass before they are played.

use serde::{Deserialize, Serialize};

use super::error::SceneProblem;
use super::limits::{MAX_EQUALISER_GAIN, MAX_POLE_RADIUS_1024THS, MAX_SECTIONS};

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

    /// Place of the angular frequency at which the denominator is smallest: the distance of its cosine from the nearer
    /// of 1 and -1.
    fn resonance(&self) -> f32 {
        let [a1, a2] = self.denominator.map(|steps| steps as f32 / ONE_F32);
        if a2 > 0.0 {
            let cos = (-a1 * (1.0 + a2) / (4.0 * a2)).clamp(-1.0, 1.0);
            1.0 - cos.abs()
        } else {
            0.0
        }
    }
}

const ONE_F32: f32 = (1u32 << Biquad::FRACTION_BITS) as f32;

fn value(steps: i32) -> f64 {
    f64::from(steps) / (1i64 << Biquad::FRACTION_BITS) as f64
}

/// |c0 + c1 z⁻¹ + c2 z⁻²|² on the unit circle, as a sum of squares in which nothing cancels: with z of cosine c,
/// (c0 c + c1 + c2 c)² + (c0 - c2)² (1 - c²).
///
/// With u = 1 - |c| the first square is that of (c0 + c2 + c1) - (c0 + c2) u where c is positive, and that of
/// (c0 + c2 - c1) - (c0 + c2) u where it is negative. These sums are exact in integers, and rounded once.
struct SquareMagnitude {
    at_one: f32,
    at_minus_one: f32,
    sum: f32,
    square_difference: f32,
}

impl SquareMagnitude {
    fn new([c0, c1, c2]: [i32; 3]) -> Self {
        let [c0, c1, c2] = [c0, c1, c2].map(i64::from);
        let number = |steps: i64| steps as f32 / ONE_F32;
        let difference = number(c0 - c2);
        Self {
            at_one: number(c0 + c2 + c1),
            at_minus_one: number(c0 + c2 - c1),
            sum: number(c0 + c2),
            square_difference: difference * difference,
        }
    }

    /// The squares at the cosines 1 - `distance` and `distance` - 1.
    #[inline(always)]
    fn at(&self, distance: f32, square_sine: f32) -> [f32; 2] {
        let imaginary = self.square_difference * square_sine;
        let step = self.sum * distance;
        [self.at_one, self.at_minus_one].map(|end| {
            let real = end - step;
            real * real + imaginary
        })
    }
}

/// A response's bound of the peak may exceed the square of the limit by this factor, 0.1 dB: bounds of short intervals
/// come near to the peak and never reach it.
const MARGIN: f32 = 1.02;

/// Most intervals of the band that a bound is taken of: those of an equaliser that was designed for an actuator are
/// some hundred.
const MOST_INTERVALS: usize = 4096;

impl SquareMagnitude {
    /// The least and the most of the squares at the cosines 1 - d and d - 1, for the distances d from `near` to `far`.
    fn between(&self, [near, far]: [f32; 2]) -> [[f32; 2]; 2] {
        let imaginary = [near, far].map(|d| self.square_difference * d * (2.0 - d));
        [self.at_one, self.at_minus_one].map(|end| {
            let [first, last] = [near, far].map(|distance| end - self.sum * distance);
            let least = if first * last > 0.0 {
                (first * first).min(last * last)
            } else {
                0.0
            };
            let most = (first * first).max(last * last);
            [least + imaginary[0], most + imaginary[1]]
        })
    }
}

/// Checks the gain of each of `sections`, and of all sections up to each of them, at every frequency: by bounds of the
/// numerators and denominators over intervals, which are halved where the bound is above the limit. [`check`] comes
/// first.
///
/// # Errors
/// The index of the first section whose gain is above the limit, or cannot be told from one that is.
pub fn check_peak(sections: &[Biquad]) -> Result<(), (usize, SceneProblem)> {
    let mut ends = [0.0; 40];
    let mut left = MOST_INTERVALS;
    let grid = DISTANCES.iter().zip(DISTANCES.iter().skip(1));
    for (&begin, &end) in grid {
        let (mut near, mut depth) = (begin, 0);
        ends[0] = end;
        loop {
            let far = ends[depth];
            let Some(at) = first_above(sections, [near, far]) else {
                near = far;
                if depth == 0 {
                    break;
                }
                depth -= 1;
                continue;
            };
            let middle = near + (far - near) / 2.0;
            left -= 1;
            depth += 1;
            if left == 0 || depth == ends.len() || middle <= near || middle >= far {
                return Err((at, SceneProblem::EqualiserGain));
            }
            ends[depth] = middle;
        }
    }
    Ok(())
}

/// Index of the first of `sections` up to which the bound of the gain is above the limit in an interval of distances.
fn first_above(sections: &[Biquad], interval: [f32; 2]) -> Option<usize> {
    const HIGHEST: f32 = (MAX_EQUALISER_GAIN * MAX_EQUALISER_GAIN) as f32 * MARGIN;
    let mut all = [1.0f32; 2];
    sections.iter().position(|section| {
        let [a1, a2] = section.denominator;
        let above = SquareMagnitude::new(section.numerator).between(interval);
        let below = SquareMagnitude::new([1 << Biquad::FRACTION_BITS, a1, a2]).between(interval);
        let mut is_above = false;
        for side in 0..2 {
            let own = above[side][1] / below[side][0];
            all[side] *= own;
            // The comparison is negated because a NaN is no bound.
            is_above |= !(own <= HIGHEST && all[side] <= HIGHEST);
        }
        is_above
    })
}

/// Number of frequencies of each half of the band at which gains are taken, besides the resonances.
const SPREAD: usize = 65;

/// Distances of these frequencies' cosines from 1 or -1: spread evenly, but denser at the ends of the band.
const DISTANCES: [f32; SPREAD] = {
    let mut distances = [0.0; SPREAD];
    let mut step = 0;
    while step < SPREAD {
        // t goes from 1 to 0. Near 1 the distance grows with the square of 1 - t, as the cosine of an even step does.
        let t = 1.0 - step as f64 / (SPREAD - 1) as f64;
        distances[step] = (1.0 - t * (3.0 - t * t) / 2.0) as f32;
        step += 1;
    }
    distances
};

/// Checks the poles and the gain of each of `sections`, and the gain of all sections up to each of them.
///
/// Gains are taken at the resonances of all sections, at their mirror images, at both ends of the band and at 127
/// frequencies between. These are spread evenly, but denser at the ends. That is a sample and no proof, see
/// [`check_peak`]; a narrow peak of one section lies at a resonance. The arithmetic is that of `f32`, which a stylus
/// has in hardware; every processor has the same results. Its round-off is below a ten-thousandth, which the limit is
/// widened by.
///
/// # Errors
/// The index of the first section with a fault, and the fault.
pub fn check(sections: &[Biquad]) -> Result<(), (usize, SceneProblem)> {
    const HIGHEST: f32 = (MAX_EQUALISER_GAIN * MAX_EQUALISER_GAIN * 1.0001) as f32;
    if let Some(at) = sections.iter().position(|s| !s.poles_are_within_limit()) {
        return Err((at, SceneProblem::PoleRadius));
    }
    let mut resonances = [0.0; MAX_SECTIONS];
    for (resonance, section) in resonances.iter_mut().zip(sections) {
        *resonance = section.resonance();
    }
    let mut all = [[1.0f32; 2]; SPREAD + MAX_SECTIONS];
    for (at, section) in sections.iter().enumerate() {
        let [a1, a2] = section.denominator;
        let numerator = SquareMagnitude::new(section.numerator);
        let denominator = SquareMagnitude::new([1 << Biquad::FRACTION_BITS, a1, a2]);
        for (all, &distance) in all.iter_mut().zip(DISTANCES.iter().chain(&resonances)) {
            let square_sine = distance * (2.0 - distance);
            let above = numerator.at(distance, square_sine);
            let below = denominator.at(distance, square_sine);
            for side in 0..2 {
                let own = above[side] / below[side];
                all[side] *= own;
                // The comparison is negated because a NaN must be refused too.
                if !(own <= HIGHEST && all[side] <= HIGHEST) {
                    return Err((at, SceneProblem::EqualiserGain));
                }
            }
        }
    }
    Ok(())
}
