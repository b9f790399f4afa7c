//! Position of a motion on a texture's grid: the nodes around it, their weights, and the fade below the lowest of them.

use model_format::{Axis, FadeLaw, MillimetresPerSecond, Newton, Texture};

/// Motion of the tool at a moment: a tangential speed and a normal force, both finite and not negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    speed_mm_s: f32,
    force_n: f32,
}

/// A motion that no sensor should produce.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionError {
    /// The speed is NaN or infinite.
    Speed,
    /// The force is NaN or infinite.
    Force,
}

impl core::fmt::Display for MotionError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Speed => "the speed is not finite",
            Self::Force => "the force is not finite",
        })
    }
}

impl core::error::Error for MotionError {}

impl Motion {
    /// No motion and no contact.
    pub const REST: Self = Self {
        speed_mm_s: 0.0,
        force_n: 0.0,
    };

    /// Creates a motion. The speed's sign is dropped, and a negative force counts as no contact.
    pub fn new(speed: MillimetresPerSecond, force: Newton) -> Result<Self, MotionError> {
        if !speed.0.is_finite() {
            return Err(MotionError::Speed);
        }
        if !force.0.is_finite() {
            return Err(MotionError::Force);
        }
        Ok(Self {
            speed_mm_s: speed.0.abs(),
            force_n: force.0.max(0.0),
        })
    }

    /// Tangential speed, mm/s; not negative.
    pub fn speed_mm_s(&self) -> f32 {
        self.speed_mm_s
    }

    /// Normal force, N; not negative.
    pub fn force_n(&self) -> f32 {
        self.force_n
    }
}

/// The number one in weights, fades and gains: they have steps of 2⁻¹⁶.
pub const ONE: u32 = 1 << 16;

/// A position on a grid: the four nodes around it with their bilinear weights, and the fade of the level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridPoint {
    /// Nodes as (speed index, force index). At the upper end of an axis some are equal; of equal nodes only the first
    /// may have a weight.
    pub nodes: [(usize, usize); 4],
    /// Weights of the nodes in steps of 2⁻¹⁶. They add up to exactly [`ONE`].
    pub weights: [u32; 4],
    /// Factor of the amplitude in steps of 2⁻¹⁶: [`ONE`] on the grid and above it, less below the lowest speed or
    /// force, and exactly zero at rest or without contact.
    pub fade: u32,
}

impl GridPoint {
    /// Finds `motion` on the grid of `texture`. Above the grid, the values at its edge apply.
    pub fn locate(texture: &Texture<'_>, motion: Motion) -> Self {
        let law = texture.fade_law();
        let speed = AxisPosition::on(texture.speed_axis(), motion.speed_mm_s, law);
        let force = AxisPosition::on(texture.force_axis(), motion.force_n, law);
        // One product is rounded and the others are differences, so the sum stays exact and no weight is negative.
        let both = ((u64::from(speed.fraction) * u64::from(force.fraction)) >> 16) as u32;
        Self {
            nodes: [
                (speed.below, force.below),
                (speed.below, force.above),
                (speed.above, force.below),
                (speed.above, force.above),
            ],
            weights: [
                ONE - speed.fraction - (force.fraction - both),
                force.fraction - both,
                speed.fraction - both,
                both,
            ],
            fade: ((u64::from(speed.fade) * u64::from(force.fade)) >> 16) as u32,
        }
    }

    /// Returns the bilinear mean of a quantity of the nodes.
    pub fn mean(&self, quantity: impl Fn(usize, usize) -> f32) -> f32 {
        let quantities = self.nodes.map(|(speed, force)| quantity(speed, force));
        mean(&self.weights, &quantities)
    }
}

/// Returns the mean of four nodes' `quantities` with their `weights`, in single precision.
pub(crate) fn mean(weights: &[u32; 4], quantities: &[f32; 4]) -> f32 {
    // Floats are added in this order everywhere, because another order may give other bits.
    let mut sum = 0.0;
    for (quantity, &weight) in quantities.iter().zip(weights) {
        sum += quantity * (weight as f32 / ONE as f32);
    }
    sum
}

/// Position of a value on one axis.
struct AxisPosition {
    below: usize,
    above: usize,
    /// Weight of `above`, 2⁻¹⁶.
    fraction: u32,
    fade: u32,
}

impl AxisPosition {
    fn on(axis: Axis<'_>, value: f32, law: FadeLaw) -> Self {
        let last = axis.len() - 1;
        let mut below = 0;
        while below < last && axis.value(below + 1) <= value {
            below += 1;
        }
        let above = (below + 1).min(last);
        let (low, high) = (axis.value(below), axis.value(above));
        // At the upper end of the axis the quotient would divide by zero.
        let fraction = if value <= low || above == below {
            0
        } else {
            steps((value - low) / (high - low))
        };
        let lowest = axis.value(0);
        let fade = if value <= 0.0 {
            0
        } else if value >= lowest {
            ONE
        } else {
            match law {
                FadeLaw::Amplitude => steps(value / lowest),
                FadeLaw::Power => root_steps(value / lowest),
            }
        };
        Self {
            below,
            above,
            fraction,
            fade,
        }
    }
}

/// A fraction in steps of 2⁻¹⁶, rounded to nearest, at most one.
fn steps(fraction: f32) -> u32 {
    ((fraction * ONE as f32 + 0.5) as u32).min(ONE)
}

/// The root of a fraction below one, in steps of 2⁻¹⁶, rounded to nearest.
fn root_steps(fraction: f32) -> u32 {
    /// Extra binary digits of the root, which are rounded away.
    const MORE_BITS: u32 = 8;
    const SCALE: u64 = 1 << (2 * (ONE.ilog2() + MORE_BITS));
    // A power of two scales a float exactly; the integer root is exact too.
    let root = ((fraction * SCALE as f32) as u64).isqrt() as u32;
    (root + (1 << (MORE_BITS - 1))) >> MORE_BITS
}
