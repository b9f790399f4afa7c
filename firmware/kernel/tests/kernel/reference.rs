//! The same filters in float64, and how far the kernel's signals are from theirs.

use stylus_kernel::rotation::Rotation;

/// 2³¹, the scale of a rotation.
const ROTATION_UNIT: f64 = (1u64 << 31) as f64;

/// A normalised lattice in float64.
pub struct FloatLattice {
    /// (cos, sin) of each stage.
    rotations: Vec<(f64, f64)>,
    backward: Vec<f64>,
}

impl FloatLattice {
    /// A lattice at rest with the rotations that the kernel uses, exactly.
    pub fn new(rotations: &[Rotation]) -> Self {
        let float = |rotation: &Rotation| {
            (
                f64::from(rotation.cos) / ROTATION_UNIT,
                f64::from(rotation.sin) / ROTATION_UNIT,
            )
        };
        Self {
            rotations: rotations.iter().map(float).collect(),
            backward: vec![0.0; rotations.len() + 1],
        }
    }

    /// Takes these backward signals over, `g[0]` first.
    pub fn begin(&mut self, backward: &[i32]) {
        for (own, &given) in self.backward.iter_mut().zip(backward) {
            *own = f64::from(given);
        }
    }

    pub fn filter(&mut self, excitation: f64) -> f64 {
        let mut f = excitation;
        for (stage, &(cos, sin)) in self.rotations.iter().enumerate().rev() {
            let g = self.backward[stage];
            self.backward[stage + 1] = sin * f + cos * g;
            f = cos * f - sin * g;
        }
        self.backward[0] = f;
        f
    }
}

/// Accumulates how far a signal is from its reference.
#[derive(Default)]
pub struct Deviation {
    signal: f64,
    error: f64,
}

impl Deviation {
    pub fn add(&mut self, reference: f64, actual: f64) {
        self.signal += reference * reference;
        self.error += (actual - reference).powi(2);
    }

    /// Signal to noise ratio, dB.
    pub fn snr_db(&self) -> f64 {
        10.0 * (self.signal / self.error).log10()
    }
}
