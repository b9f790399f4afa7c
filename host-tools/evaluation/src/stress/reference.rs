//! The kernel's lattice in float64, and statistics of what is played.

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

/// The mean of a correlated signal, and its standard error from the scatter of the means of batches.
pub struct Mean {
    batch: usize,
    sum: f64,
    in_batch: usize,
    means: Vec<f64>,
}

impl Mean {
    /// Batches that a signal is divided into.
    const BATCHES: usize = 64;

    /// An empty mean for a signal of `samples` samples.
    pub fn of(samples: usize) -> Self {
        Self {
            batch: (samples / Self::BATCHES).max(1),
            sum: 0.0,
            in_batch: 0,
            means: Vec::with_capacity(Self::BATCHES),
        }
    }

    /// Adds the next sample.
    pub fn add(&mut self, sample: f64) {
        self.sum += sample;
        self.in_batch += 1;
        if self.in_batch == self.batch {
            self.means.push(self.sum / self.batch as f64);
            (self.sum, self.in_batch) = (0.0, 0);
        }
    }

    /// The mean's magnitude in standard errors; zero for silence.
    pub fn in_standard_errors(&self) -> f64 {
        let count = self.means.len() as f64;
        let mean = self.means.iter().sum::<f64>() / count;
        let scatter: f64 = self.means.iter().map(|batch| (batch - mean).powi(2)).sum();
        // The error follows from the means of batches, because the samples of a correlated signal are not independent.
        // A batch is longer than the signal's correlation, unless a narrow line rings for longer.
        let error = (scatter / (count - 1.0) / count).sqrt();
        if error > 0.0 { mean.abs() / error } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::noise;

    #[test]
    fn a_mean_that_is_not_zero_is_seen_and_one_that_is_is_not() {
        let errors = |offset: f64| {
            let mut mean = Mean::of(64_000);
            noise(3, 64_000).iter().for_each(|x| mean.add(x + offset));
            mean.in_standard_errors()
        };
        // The standard error is 1/253.
        assert!(errors(0.0) < 4.0);
        assert!((6.0..14.0).contains(&errors(0.04)), "{}", errors(0.04));
    }
}
