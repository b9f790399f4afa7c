//! Interpolated θ, the source of every lattice's coefficients.

use model_format::limits::MAX_ORDER;
use model_format::{OutputSample, Texture};

use crate::arithmetic::Portable;
use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, ONE};
use crate::lattice::GAIN_FRACTION_BITS;
use crate::level::{Levels, Ramp, rms_at};
use crate::nodes::Nodes;
use crate::rotation::Rotation;

/// Writes `coefficient` of each stage's rotation at `point` to `stages`, the first stage first; see
/// [`crate::theta`].
pub(super) fn interpolate<T>(
    texture: &Texture<'_>,
    point: &GridPoint,
    stages: &mut [T],
    mut coefficient: impl FnMut(Rotation) -> T,
) {
    let mut rotations = [Rotation::NONE; MAX_ORDER];
    let rotations = &mut rotations[..stages.len()];
    Nodes::at(texture, point).interpolate::<Portable>(rotations);
    for (stage, &rotation) in stages.iter_mut().zip(rotations.iter()) {
        *stage = coefficient(rotation);
    }
}

/// Binary digits between a standard deviation of a lattice's output and its full scale, eight of them.
const HEADROOM_BITS: u32 = 3;

/// The ramp from `from` to the level of `point` in `samples` samples, in the units of the normalised lattice.
pub(super) fn gain(texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) -> Ramp {
    let power = |speed, force| texture.node(speed, force).output_power;
    let rms = rms_at(point, texture.level_law(), GAIN_FRACTION_BITS, power);
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
