//! Levels: from powers in (m/s²)² to a gain in fixed point, by the texture's law, and ramps from one gain to the next.

use model_format::LevelLaw;

use crate::grid::{GridPoint, ONE, mean};
use crate::logarithm::{LOG2_FRACTION_BITS, exp2, log2};

/// √(power · 4^bits), truncated: the RMS of `power` in steps of 2^-`bits`, at most 2³¹ - 1.
///
/// `power` · 4^`bits` must be below 2⁶⁴, which holds for every valid node and the bits that this crate uses.
pub fn rms_in_steps(power: f32, bits: u32) -> u32 {
    // A power of two scales a float exactly; the integer root is exact too.
    let scaled = (power * (1u64 << bits) as f32 * (1u64 << bits) as f32) as u64;
    // The highest power of a node has an RMS of 2³¹ steps of 2⁻²³ m/s², one more than a gain can hold.
    scaled.isqrt().min(i32::MAX as u64) as u32
}

/// The RMS at `point` in steps of 2^-`bits`, from the powers of the four nodes around it, by `law`; see [`rms_of`].
pub fn rms_at(point: &GridPoint, law: LevelLaw, bits: u32, power: impl Fn(usize, usize) -> f32) -> u32 {
    let powers = point.nodes.map(|(speed, force)| power(speed, force));
    rms_of(&point.weights, law, bits, &powers)
}

/// Returns the RMS in steps of 2^-`bits` between four nodes of these `powers`, with their `weights`, by `law`.
///
/// At a node it is [`rms_in_steps`] of the node's power, by every law. By amplitude and by logarithm, the RMS is never
/// outside the range of the nodes that have a weight, and is monotonic along an edge of a cell. The mean of powers is
/// computed in single precision.
pub fn rms_of(weights: &[u32; 4], law: LevelLaw, bits: u32, powers: &[f32; 4]) -> u32 {
    let terms = || {
        // A node without a weight would widen the range of the last law below.
        let terms = powers.iter().copied().zip(weights.iter().copied());
        terms.filter(|&(_, weight)| weight > 0)
    };
    match law {
        LevelLaw::Power => rms_in_steps(mean(weights, powers), bits),
        LevelLaw::Amplitude => {
            let rms = |power| u64::from(rms_in_steps(power, bits));
            let terms = terms().map(|(power, weight)| u64::from(weight) * rms(power));
            (terms.sum::<u64>() / u64::from(ONE)) as u32
        }
        LevelLaw::Logarithm => {
            // Digits after the point of the amplitude's logarithm: those of `log2`, of the weights, and one for the
            // square.
            const FRACTION_BITS: u32 = LOG2_FRACTION_BITS + ONE.ilog2() + 1;
            let (mut sum, mut lowest, mut highest) = (0, f32::MAX, 0.0f32);
            for (power, weight) in terms() {
                // Comparisons, because minimum and maximum are library calls on ARM.
                if power < lowest {
                    lowest = power;
                }
                if power > highest {
                    highest = power;
                }
                sum += i64::from(weight) * log2(power);
            }
            // At a node both bounds are its own level. Elsewhere the rounding of the logarithm cannot leave the range
            // of the nodes.
            exp2(sum + (i64::from(bits) << FRACTION_BITS), FRACTION_BITS)
                .max(rms_in_steps(lowest, bits))
                .min(rms_in_steps(highest, bits))
        }
    }
}

/// A quantity that goes in equal steps from its value in one frame to that in the next, so that no change clicks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ramp {
    target: i32,
    step: i32,
}

impl Ramp {
    /// A ramp that stays at zero.
    pub const fn new() -> Self {
        Self { target: 0, step: 0 }
    }

    /// A ramp from `from`, which must not be negative, to `target` in `samples` steps. A target above 2³¹ - 1 is
    /// clamped to 2³¹ - 1.
    pub fn between(from: i32, target: u32, samples: u32) -> Self {
        let target = target.min(i32::MAX as u32) as i32;
        Self {
            target,
            // Truncated, so that no value is beyond either end. The first sample takes what is left over.
            step: (target - from) / samples.max(1) as i32,
        }
    }

    /// A ramp from `from`, which must not be negative, to the same target in `samples` steps.
    #[must_use]
    pub fn again(self, from: i32, samples: u32) -> Self {
        Self::between(from, self.target.cast_unsigned(), samples)
    }

    /// The value when `left` samples of the ramp remain. At the end it is exactly the target.
    #[inline(always)]
    pub fn value(self, left: u32) -> i32 {
        self.target - self.step * left as i32
    }
}

/// Values of a frame's ramps, from which the next frame continues.
///
/// The units are those of the texture's frames, and are the same for all frames of one texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    pub(crate) amplitude: i32,
    pub(crate) fade: i32,
}

impl Levels {
    /// Silence.
    pub const SILENT: Self = Self { amplitude: 0, fade: 0 };
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ramp_stays_between_its_ends_and_reaches_its_target(
            from in 0u32..=i32::MAX as u32, to in 0u32..=i32::MAX as u32, samples in 1u32..64,
        ) {
            let ramp = Ramp::between(from as i32, to, samples);
            prop_assert_eq!(ramp.value(0), to as i32);
            for left in 0..samples {
                let value = ramp.value(left) as u32;
                prop_assert!((from.min(to)..=from.max(to)).contains(&value));
            }
        }

        #[test]
        fn rms_is_the_root_of_the_power(power in 0.0f32..65_536.0) {
            let rms = f64::from(rms_in_steps(power, 23)) / libm::exp2(23.0);
            let exact = libm::sqrt(f64::from(power)).min(f64::from(i32::MAX) / libm::exp2(23.0));
            prop_assert!((rms - exact).abs() <= 1.0 / libm::exp2(23.0));
        }
    }
}
