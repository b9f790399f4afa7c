//! Bilinear interpolation of θ = arcsin k over the grid.
//!
//! A mean of angles below π/2 is below π/2, so that every mean of stable lattices is stable.

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER};
use model_format::{Coefficients, THETA_FRACTION_BITS, Texture};

use crate::grid::{GridPoint, ONE};

/// Binary digits that a sum of codes times weights has beyond those of an interpolated θ.
const DROPPED_BITS: u32 = ONE.ilog2() - THETA_FRACTION_BITS;

/// Writes `coefficient` of each stage's θ at `point` to `stages`, the first stage first. θ has steps of π/2²⁴ and is
/// rounded to nearest. Stages that a node's model lacks have θ = 0.
///
/// Codes are summed in one word. Their fractions, which only the first stages have, are summed in another, so that the
/// further stages cost no more for them.
pub(crate) fn interpolate<T>(
    texture: &Texture<'_>,
    point: &GridPoint,
    stages: &mut [T],
    mut coefficient: impl FnMut(i32) -> T,
) {
    let mut sums = [0i32; MAX_ORDER];
    let mut fine = [0i32; MAX_FINE_STAGES];
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        let Coefficients::Lattice { codes, fractions } = texture.node(speed, force).coefficients
        else {
            continue;
        };
        for (sum, &code) in sums.iter_mut().zip(codes) {
            *sum += i32::from(i16::from_le_bytes(code)) * weight as i32;
        }
        for (sum, &fraction) in fine.iter_mut().zip(fractions) {
            *sum += i32::from(fraction.cast_signed()) * weight as i32;
        }
    }
    let (first, further) = stages.split_at_mut(stages.len().min(MAX_FINE_STAGES));
    for ((stage, &sum), &fine) in first.iter_mut().zip(&sums).zip(&fine) {
        // sum · 2⁸ + fine, rounded once, without a longer word: the lowest digits of the sum are added to fine.
        let lowest = sum & ((1 << DROPPED_BITS) - 1);
        let rest = (lowest << THETA_FRACTION_BITS) + fine + (1 << (ONE.ilog2() - 1));
        *stage = coefficient((sum >> DROPPED_BITS) + (rest >> ONE.ilog2()));
    }
    for (stage, &sum) in further.iter_mut().zip(&sums[MAX_FINE_STAGES..]) {
        *stage = coefficient((sum + (1 << (DROPPED_BITS - 1))) >> DROPPED_BITS);
    }
}
