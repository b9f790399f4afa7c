//! Bilinear interpolation of θ = arcsin k over the grid.
//!
//! A mean of angles below π/2 is below π/2, so that every mean of stable lattices is stable.

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER};
use model_format::{Coefficients, THETA_FRACTION_BITS, Texture};

use crate::grid::{GridPoint, ONE};

/// Binary digits that a sum of codes times weights has beyond those of an interpolated θ.
const DROPPED_BITS: u32 = ONE.ilog2() - THETA_FRACTION_BITS;

/// θ of each stage at `point`, in steps of π/2²⁴, rounded to nearest. Stages that a node's model lacks have θ = 0.
///
/// Codes are summed in one word. Their fractions, which only the first stages have, are summed in another, so that the
/// further stages cost no more for them.
pub(crate) fn interpolated(texture: &Texture<'_>, point: &GridPoint) -> [i32; MAX_ORDER] {
    let mut thetas = [0i32; MAX_ORDER];
    let mut fine = [0i32; MAX_FINE_STAGES];
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        let Coefficients::Lattice { codes, fractions } = texture.node(speed, force).coefficients
        else {
            continue;
        };
        for (theta, &code) in thetas.iter_mut().zip(codes) {
            *theta += i32::from(i16::from_le_bytes(code)) * weight as i32;
        }
        for (fine, &fraction) in fine.iter_mut().zip(fractions) {
            *fine += i32::from(fraction.cast_signed()) * weight as i32;
        }
    }
    let (first, further) = thetas.split_at_mut(MAX_FINE_STAGES);
    for (theta, fine) in first.iter_mut().zip(fine) {
        // theta · 2⁸ + fine, rounded once, without a longer word: the lowest digits of theta are added to fine.
        let lowest = *theta & ((1 << DROPPED_BITS) - 1);
        let rest = (lowest << THETA_FRACTION_BITS) + fine;
        *theta = (*theta >> DROPPED_BITS) + ((rest + (1 << (ONE.ilog2() - 1))) >> ONE.ilog2());
    }
    for theta in further {
        *theta = (*theta + (1 << (DROPPED_BITS - 1))) >> DROPPED_BITS;
    }
    thetas
}
