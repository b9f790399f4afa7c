//! Sections of an equaliser as they are stored, and the check that they pass before they are played.

use heapless::Vec;
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
#[derive(Clone, Debug)]
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

    /// The least and the most of the squares at the cosines 1 - d and d - 1, for the distances d from `near` to `far`.
    #[inline(always)]
    fn between(&self, [near, far]: [f32; 2]) -> [[f32; 2]; 2] {
        let imaginary = [near, far].map(|d| self.square_difference * d * (2.0 - d));
        [self.at_one, self.at_minus_one].map(|end| {
            let [first, last] = [near, far].map(|distance| end - self.sum * distance);
            let squares = [first * first, last * last];
            let [less, more] = if squares[0] < squares[1] {
                squares
            } else {
                [squares[1], squares[0]]
            };
            let least = if first * last > 0.0 { less } else { 0.0 };
            [least + imaginary[0], more + imaginary[1]]
        })
    }
}

/// Checks the poles and the gain of each of `sections`, and the gain of all sections up to each of them.
///
/// # Errors
/// The index of the first section with a fault, and the fault.
///
/// # Panics
/// More than [`MAX_SECTIONS`].
pub fn check(sections: &[Biquad]) -> Result<(), (usize, SceneProblem)> {
    check_poles(sections)?;
    let mut check = GainCheck::new(sections);
    while !check.step()? {}
    Ok(())
}

/// Checks the poles of each of `sections`.
///
/// # Errors
/// The index of the first section with a pole beyond the limit.
pub(super) fn check_poles(sections: &[Biquad]) -> Result<(), (usize, SceneProblem)> {
    let outside = sections.iter().position(|s| !s.poles_are_within_limit());
    outside.map_or(Ok(()), |at| Err((at, SceneProblem::PoleRadius)))
}

/// Factor by which the bound of a squared gain may exceed that of the limit, 0.1 dB: bounds of short intervals come
/// near to the peak and never reach it.
const MARGIN: f32 = 1.02;

/// Most intervals of the band that are halved. Eight narrow sections at the limit take some two hundred.
const MOST_INTERVALS: usize = 512;

/// Intervals in a step of a check.
const STEP_INTERVALS: usize = 24;

/// Most halvings of the band: intervals are then much narrower than the resonance of a pole at the limit.
const MOST_HALVINGS: usize = 40;

/// A check of the gain of each of some sections, and of all sections up to each, at every frequency.
///
/// The numerators and denominators are bounded over intervals, which are halved where the bound of the gain is above
/// the limit. The arithmetic is that of `f32`, which a stylus has in hardware; every processor has the same results.
#[derive(Clone, Debug)]
pub(crate) struct GainCheck {
    /// Numerator and denominator of each section.
    sections: Vec<[SquareMagnitude; 2], MAX_SECTIONS>,
    /// Begin of the interval, a distance of its cosine from 1 and from -1.
    near: f32,
    /// End of the interval, behind those of the intervals that it is a half of.
    ends: Vec<f32, MOST_HALVINGS>,
    /// Number of intervals that may follow.
    left: usize,
}

impl GainCheck {
    /// The check of at most [`MAX_SECTIONS`] sections, whose poles are within their limit.
    pub fn new(sections: &[Biquad]) -> Self {
        let magnitudes = |section: &Biquad| {
            let [a1, a2] = section.denominator;
            let denominator = [1 << Biquad::FRACTION_BITS, a1, a2];
            [section.numerator, denominator].map(SquareMagnitude::new)
        };
        Self {
            sections: sections.iter().map(magnitudes).collect(),
            near: 0.0,
            ends: Vec::from([1.0]),
            left: MOST_INTERVALS,
        }
    }

    /// Checks some intervals; returns true after the last one.
    ///
    /// # Errors
    /// The index of the first section whose gain is above the limit, or cannot be told from one that is.
    pub fn step(&mut self) -> Result<bool, (usize, SceneProblem)> {
        for _ in 0..STEP_INTERVALS {
            let Some(&far) = self.ends.last() else {
                break;
            };
            let Some(at) = self.first_above([self.near, far]) else {
                self.near = far;
                self.ends.pop();
                continue;
            };
            let middle = self.near + (far - self.near) / 2.0;
            let is_new = middle > self.near && middle < far && self.left > 0;
            if !is_new || self.ends.push(middle).is_err() {
                return Err((at, SceneProblem::EqualiserGain));
            }
            self.left -= 1;
        }
        Ok(self.ends.is_empty())
    }

    /// Index of the first section up to which the bound of the gain is above the limit in an interval of distances.
    fn first_above(&self, interval: [f32; 2]) -> Option<usize> {
        const HIGHEST: f32 = (MAX_EQUALISER_GAIN * MAX_EQUALISER_GAIN) as f32 * MARGIN;
        let mut all = [1.0f32; 2];
        self.sections.iter().position(|section| {
            let [above, below] = section.each_ref().map(|part| part.between(interval));
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
}
