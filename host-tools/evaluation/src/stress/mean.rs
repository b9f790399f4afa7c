//! The mean of what is played.

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
