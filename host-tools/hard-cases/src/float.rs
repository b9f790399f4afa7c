//! The kernel's lattice in float64, and how far a signal is from it.

use std::vec;
use std::vec::Vec;

use stylus_kernel::rotation::Rotation;

/// A normalised lattice in float64.
pub struct FloatLattice {
    /// (cos, sin) of each stage.
    rotations: Vec<(f64, f64)>,
    backward: Vec<f64>,
}

impl FloatLattice {
    /// A lattice of `stages` stages at rest.
    pub fn new(stages: usize) -> Self {
        Self {
            rotations: vec![(1.0, 0.0); stages],
            backward: vec![0.0; stages + 1],
        }
    }

    /// Replaces the backward signals by `backward`, `g[0]` first.
    pub fn begin(&mut self, backward: &[i32]) {
        for (own, &given) in self.backward.iter_mut().zip(backward) {
            *own = f64::from(given);
        }
    }

    /// Sets the rotations of the stages to the kernel's, exactly.
    pub fn rotate_by(&mut self, rotations: &[Rotation]) {
        const UNIT: f64 = (1u64 << 31) as f64;
        for (to, from) in self.rotations.iter_mut().zip(rotations) {
            *to = (f64::from(from.cos) / UNIT, f64::from(from.sin) / UNIT);
        }
    }

    /// Sets the rotations of the stages to those of reflection coefficients.
    pub fn reflect_by(&mut self, reflection: &[f64]) {
        for (to, k) in self.rotations.iter_mut().zip(reflection) {
            // The product keeps the digits near |k| = 1 that 1 - k² loses.
            *to = (((1.0 - k) * (1.0 + k)).sqrt(), *k);
        }
    }

    /// Sets the rotations of the stages to these angles, rad.
    pub fn turn_by(&mut self, thetas: &[f64]) {
        for (to, theta) in self.rotations.iter_mut().zip(thetas) {
            let (sin, cos) = theta.sin_cos();
            *to = (cos, sin);
        }
    }

    /// Filters one sample of `excitation`, and returns the output.
    pub fn filter(&mut self, excitation: f64) -> f64 {
        let mut f = excitation;
        // From the last stage down, each value of the sample before is read before it is replaced.
        for (stage, &(cos, sin)) in self.rotations.iter().enumerate().rev() {
            let g = self.backward[stage];
            self.backward[stage + 1] = sin * f + cos * g;
            f = cos * f - sin * g;
        }
        self.backward[0] = f;
        f
    }
}

/// The difference of a signal from its reference.
#[derive(Default)]
pub struct Deviation {
    signal: f64,
    error: f64,
    actual: f64,
}

impl Deviation {
    /// Adds one sample of the reference and one of the signal.
    pub fn add(&mut self, reference: f64, actual: f64) {
        self.signal += reference * reference;
        self.actual += actual * actual;
        self.error += (actual - reference).powi(2);
    }

    /// Signal to noise ratio, dB.
    pub fn snr_db(&self) -> f64 {
        10.0 * (self.signal / self.error).log10()
    }

    /// Level relative to the reference, dB.
    pub fn level_db(&self) -> f64 {
        10.0 * (self.actual / self.signal).log10()
    }
}
