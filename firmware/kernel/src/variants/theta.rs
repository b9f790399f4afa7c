//! Interpolated θ, the source of every lattice's coefficients.

use model_format::limits::MAX_ORDER;
use model_format::{Coefficients, OutputSample, Texture};

use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, ONE};
use crate::lattice::GAIN_FRACTION_BITS;
use crate::level::{Levels, Ramp, rms_in_steps};
use crate::rotation::THETA_FRACTION_BITS;

/// Binary digits between a standard deviation of a lattice's output and its full scale, eight of them.
const HEADROOM_BITS: u32 = 3;

/// Bilinear θ of each stage at `point`, as [`crate::rotation::Rotation::from_theta`] takes it. Stages that a node's
/// model lacks have θ = 0.
pub(super) fn interpolated(texture: &Texture<'_>, point: &GridPoint) -> [i32; MAX_ORDER] {
    const DROPPED_BITS: u32 = 16 - THETA_FRACTION_BITS;
    let mut thetas = [0i32; MAX_ORDER];
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        let Coefficients::Lattice { codes, .. } = texture.node(speed, force).coefficients else {
            continue;
        };
        for (theta, &code) in thetas.iter_mut().zip(codes) {
            *theta += i32::from(i16::from_le_bytes(code)) * weight as i32;
        }
    }
    thetas.map(|theta| (theta + (1 << (DROPPED_BITS - 1))) >> DROPPED_BITS)
}

/// The ramp from `from` to the level of `point` in `samples` samples, in the units of the normalised lattice.
pub(super) fn gain(texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) -> Ramp {
    let power = point.mean(|speed, force| texture.node(speed, force).output_power);
    let rms = rms_in_steps(power, GAIN_FRACTION_BITS);
    let gain = (u64::from(rms) * u64::from(point.fade)) / u64::from(ONE);
    Ramp::between(from.amplitude, gain as u32, samples)
}

/// Output of a lattice whose full scale is 2^`full_scale_bits`, at the level `gain`.
#[inline(always)]
pub(super) fn output(filtered: i32, gain: i32, full_scale_bits: u32) -> OutputSample {
    const EXTRA_BITS: u32 = GAIN_FRACTION_BITS - OutputSample::FRACTION_BITS;
    let product = i64::from(filtered) * i64::from(gain);
    OutputSample(shift_toward_zero(product, full_scale_bits - HEADROOM_BITS + EXTRA_BITS) as i32)
}
