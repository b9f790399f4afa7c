//! Sections of an equaliser as they are stored, and the check that they pass before they are played.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::SceneProblem;
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

    /// Creates the section with these coefficients, each rounded to the nearest step. Returns none if a coefficient is
    /// out of range or not finite.
    pub fn from_f64(numerator: [f64; 3], denominator: [f64; 2]) -> Option<Self> {
        let mut stored = Self::IDENTITY;
        let places = stored.numerator.iter_mut().chain(&mut stored.denominator);
        for (place, value) in places.zip(numerator.into_iter().chain(denominator)) {
            let steps = value * (1i64 << Self::FRACTION_BITS) as f64;
            // A cast truncates, so half a step is added in the direction of the sign to round to the nearest step.
            let steps = if steps < 0.0 { steps - 0.5 } else { steps + 0.5 };
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
        // All terms are multiplied by 2²⁰. No product reaches 2⁵³.
        let a2 = a2 << 20;
        a2.abs() <= square && a1.abs() * RADIUS * 1024 <= square + a2
    }
}

const ONE_F32: f32 = (1u32 << Biquad::FRACTION_BITS) as f32;

fn value(steps: i32) -> f64 {
    f64::from(steps) / (1i64 << Biquad::FRACTION_BITS) as f64
}

/// Evaluates |c0 + c1 z⁻¹ + c2 z⁻²|² on the unit circle as a sum of squares, in which no digits cancel:
///
/// ```text
/// (c0 c + c1 + c2 c)² + (c0 - c2)² (1 - c²)                          c the cosine of the angle of z
/// (c0 + c2 ± c1 - (c0 + c2) d)² + (c0 - c2)² d (2 - d)               d = 1 - |c|, + for c > 0 and - for c < 0
/// ```
/// The second form is computed. The sums of coefficients are exact in integers and are rounded only once.
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

    /// Lower and upper bounds of the squared magnitude over distances d from `near` to `far`: first for the cosines 1 -
    /// d, then for the cosines d - 1.
    #[inline(always)]
    fn between(&self, [near, far]: [f32; 2]) -> [[f32; 2]; 2] {
        // It rises with d up to 1, so that the ends of the interval are its bounds.
        let imaginary = [near, far].map(|d| self.square_difference * d * (2.0 - d));
        [self.at_one, self.at_minus_one].map(|end| {
            let [first, last] = [near, far].map(|distance| end - self.sum * distance);
            let squares = [first * first, last * last];
            let [less, more] = if squares[0] < squares[1] {
                squares
            } else {
                [squares[1], squares[0]]
            };
            // Where the linear term changes its sign, its square is 0 within the interval.
            let least = if first * last > 0.0 { less } else { 0.0 };
            [least + imaginary[0], more + imaginary[1]]
        })
    }
}

/// Checks the poles and the gain of each of `sections`, and the gain of the cascade from the first section up to each.
///
/// # Errors
/// The index of the first section with a fault, and the fault.
///
/// # Panics
/// Panics if there are more than [`MAX_SECTIONS`] sections.
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

/// Factor by which the bound of a squared gain may exceed the square of the limit, 0.1 dB. It is needed because the
/// bound of a short interval comes near to the peak but always stays above it.
const MARGIN: f32 = 1.02;

/// Largest number of intervals of the band that are halved. Eight narrow sections at the limit take some two hundred
/// intervals in all, of which about half are halved.
const MOST_INTERVALS: usize = 512;

/// Number of intervals that one step of a check looks at.
const STEP_INTERVALS: usize = 24;

/// Largest number of ends on the stack, one more than there are halvings one inside the other. The intervals are then
/// much narrower than the resonance of a pole at the limit.
const MOST_HALVINGS: usize = 40;

/// A check of the gain at every frequency: of each section, and of the cascade from the first section up to each.
///
/// The squared magnitudes of numerators and denominators are bounded over intervals of frequency. An interval is halved
/// if its bound of the gain is above the limit. The arithmetic is that of `f32`, which the device's processor has in
/// hardware, and every processor computes the same results.
#[derive(Clone, Debug)]
pub(crate) struct GainCheck {
    /// Numerator and denominator of each section.
    sections: Vec<[SquareMagnitude; 2], MAX_SECTIONS>,
    /// Beginning of the current interval: the distance of the cosine from 1, and in a second interval from -1.
    near: f32,
    /// Ends of intervals, as a stack. The last one is the end of the current interval. Those before it are the ends of
    /// the larger intervals of which it is a part.
    ends: Vec<f32, MOST_HALVINGS>,
    /// Number of halvings that are still allowed.
    left: usize,
}

impl GainCheck {
    /// Creates the check of at most [`MAX_SECTIONS`] sections. Their poles must be within the limit.
    pub fn new(sections: &[Biquad]) -> Self {
        let magnitudes = |section: &Biquad| {
            let [a1, a2] = section.denominator;
            let denominator = [1 << Biquad::FRACTION_BITS, a1, a2];
            [section.numerator, denominator].map(SquareMagnitude::new)
        };
        Self {
            sections: sections.iter().map(magnitudes).collect(),
            near: 0.0,
            // A distance of 1 is a cosine of 0: each interval stands for one in either half of the band.
            ends: Vec::from([1.0]),
            left: MOST_INTERVALS,
        }
    }

    /// Checks some intervals; returns true after the last one.
    ///
    /// # Errors
    /// The index of the first section at which the gain is above the limit, or cannot be shown to be below it.
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
            // In `f32` the middle of the shortest interval is one of its ends.
            let middle = self.near + (far - self.near) / 2.0;
            let is_new = middle > self.near && middle < far && self.left > 0;
            if !is_new || self.ends.push(middle).is_err() {
                return Err((at, SceneProblem::EqualiserGain));
            }
            self.left -= 1;
        }
        Ok(self.ends.is_empty())
    }

    /// Index of the first section at which, in this interval, the bound of the gain is above the limit: of the
    /// section's own gain or of the cascade's up to it.
    fn first_above(&self, interval: [f32; 2]) -> Option<usize> {
        const HIGHEST: f32 = (MAX_EQUALISER_GAIN * MAX_EQUALISER_GAIN) as f32 * MARGIN;
        let mut all = [1.0f32; 2];
        self.sections.iter().position(|section| {
            let [above, below] = section.each_ref().map(|part| part.between(interval));
            let mut is_above = false;
            for side in 0..2 {
                // The upper bound of the numerator over the lower bound of the denominator. If that is 0, the quotient
                // is infinite, and the interval is halved.
                let own = above[side][1] / below[side][0];
                all[side] *= own;
                // The comparison is negated so that a NaN counts as above the limit.
                is_above |= !(own <= HIGHEST && all[side] <= HIGHEST);
            }
            is_above
        })
    }
}
