//! Part of kind 6: the stages of a lattice after the first 32 have codes of one byte.
//!
//! The content is a `u16` per node, speed-major: the step of the node's one-byte codes, in units of π/2²⁴. With this
//! part, the coefficients of a node are 16-bit codes for its first [`MAX_FINE_STAGES`] stages, and a signed byte for
//! each further stage. These bytes are the node's tail: θ = byte · step · π/2²⁴. The first stages determine the lines
//! and the slope of a spectrum. Further stages have a small θ, and its rounding hardly changes the spectrum.

use crate::error::Problem;
use crate::library::node::Tail;
use crate::limits::{MAX_FINE_STAGES, MIN_LARGEST_TAIL_CODE};

#[cfg(feature = "alloc")]
use super::PartSpec;

/// The last stages of a lattice, see [`crate::Tail`].
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TailSpec {
    /// The codes, at least -127.
    pub codes: alloc::vec::Vec<i8>,
    /// Step of a code, in units of [`crate::FINE_THETA_STEP_RAD`].
    pub step: u16,
}

#[cfg(feature = "alloc")]
impl TailSpec {
    /// Creates the tail for these θ, in units of [`crate::FINE_THETA_STEP_RAD`]. The step is the smallest with which
    /// the codes reach all of them, and each θ is rounded to the nearest code.
    ///
    /// A θ whose magnitude exceeds [`TailSpec::MAX_THETA`] is limited to it.
    pub fn of(thetas: &[i32]) -> Self {
        let largest = thetas.iter().map(|theta| theta.unsigned_abs()).max();
        let largest = largest.unwrap_or(0).min(Self::MAX_THETA.unsigned_abs());
        let step = largest.div_ceil(u32::from(Self::MAX_CODE.unsigned_abs())) as i32;
        let code = |&theta: &i32| {
            let theta = theta.clamp(-Self::MAX_THETA, Self::MAX_THETA);
            // Euclidean, so that negative θ, too, are rounded to the nearest code. The step is 0 if all θ are 0.
            (2 * theta + step).div_euclid(2 * step.max(1)) as i8
        };
        Self {
            codes: thetas.iter().map(code).collect(),
            step: step as u16,
        }
    }

    /// Largest θ of a tail, in steps of [`crate::FINE_THETA_STEP_RAD`].
    pub const MAX_THETA: i32 = Self::MAX_CODE as i32 * u16::MAX as i32;

    /// Largest code; the lowest is its negative.
    pub const MAX_CODE: i8 = i8::MAX;

    /// The empty tail, of a node without one-byte codes.
    pub(crate) const NONE: Self = Self {
        codes: alloc::vec::Vec::new(),
        step: 0,
    };

    /// θ of the stages, in steps of [`crate::FINE_THETA_STEP_RAD`].
    pub(crate) fn thetas(&self) -> impl Iterator<Item = i32> + '_ {
        let step = i32::from(self.step);
        self.codes.iter().map(move |&code| i32::from(code) * step)
    }
}

/// Kind of this part.
pub(crate) const KIND: u32 = 6;

/// Width of a step, bytes.
const STEP_BYTES: usize = 2;

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tails<'a>(pub &'a [u8]);

impl Tails<'_> {
    /// Length of a node's coefficients, bytes.
    pub const fn coefficient_bytes(order: usize) -> usize {
        order + Self::stages_before(order)
    }

    /// Number of stages of a node that have codes of 16 bits.
    pub const fn stages_before(order: usize) -> usize {
        if order < MAX_FINE_STAGES {
            order
        } else {
            MAX_FINE_STAGES
        }
    }

    /// The tail of node `index` with the codes `codes`. The part's length must have been found valid.
    #[inline]
    pub fn of_node<'c>(&self, index: usize, codes: &'c [u8]) -> Tail<'c> {
        let step = u16::from_le_bytes(self.0.as_chunks().0[index]);
        Tail { codes, step }
    }

    /// Checks the part's length, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize) -> Result<(), Problem> {
        Problem::same("bytes of steps of tails", self.0.len(), STEP_BYTES * nodes)
    }
}

const OTHER_STEP: Problem = Problem::Rule(
    "the step of a tail must be 0 exactly where all codes are, and at most 1 where no code is above half its range",
);

/// Checks the tail of a node.
///
/// The step must be 0 if and only if all codes are 0, and otherwise no larger than the codes need. So a tail hardly
/// ever has two encodings, and its resolution is never lower than its bytes allow.
pub(in crate::library) fn check(tail: Tail<'_>) -> Result<(), Problem> {
    let mut largest = 0;
    for &code in tail.codes {
        largest = code.cast_signed().unsigned_abs().max(largest);
    }
    // Only -128 has this magnitude. It is refused, so that the range of codes is symmetrical.
    if largest == i8::MIN.unsigned_abs() {
        let lowest = |&code: &u8| code.cast_signed() == i8::MIN;
        let index = tail.codes.iter().position(lowest).unwrap_or(0);
        let stage = MAX_FINE_STAGES + index + 1;
        let what = "the code -128 in a tail; codes are -127 to 127";
        return Err(Problem::Stage { stage, what });
    }
    let needed = match tail.step {
        0 => largest == 0,
        1 => largest > 0,
        _ => largest >= MIN_LARGEST_TAIL_CODE,
    };
    if needed { Ok(()) } else { Err(OTHER_STEP) }
}

/// Creates the part for nodes that each have this number of stages of 16 bits, then this tail; none if no node has a
/// tail.
///
/// # Errors
/// A node whose tail does not begin after the first [`MAX_FINE_STAGES`] stages, or has a step but no tail is in use:
/// the index of the node and the fault.
#[cfg(feature = "alloc")]
pub(crate) fn part<'t>(
    nodes: impl Iterator<Item = (usize, &'t TailSpec)> + Clone,
) -> Result<Option<PartSpec>, (usize, Problem)> {
    let some = nodes.clone().any(|(_, tail)| !tail.codes.is_empty());
    let mut content = alloc::vec::Vec::new();
    for (number, (before, tail)) in nodes.enumerate() {
        let fits = if tail.codes.is_empty() {
            !some || before <= MAX_FINE_STAGES
        } else {
            before == MAX_FINE_STAGES
        };
        if !fits {
            let rule = "a tail begins after stage 32, and if one node has one, so has every node of more stages";
            return Err((number, Problem::Rule(rule)));
        }
        if !some && tail.step != 0 {
            return Err((number, OTHER_STEP));
        }
        content.extend(tail.step.to_le_bytes());
    }
    Ok(some.then_some((KIND, content)))
}
