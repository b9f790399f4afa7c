//! Linear prediction: the Levinson-Durbin recursion, conversions of its parameters, and the choice of the order.
//!
//! Conventions: A(z) = 1 + Σ a(i) z⁻ⁱ. The reflection coefficient is k(m) = -(r(m) + Σ a(i) r(m-i)) / E(m-1), so that
//! k(1) = -r(1)/r(0). The model is y(n) = e(n) - Σ a(i) y(n-i). The paper's predictor coefficients are h(i) = -a(i).

use crate::sums::dot_inlined;
use crate::wide;

/// White-noise correction: the fraction by which r(0) is raised before the recursion. It corresponds to noise 90 dB
/// below the signal.
///
/// The correction bounds the condition number of the normal equations, so that signals of a few lines or of no
/// bandwidth also have models with |k| < 1. To the spectra of other signals it only adds that noise.
pub const WHITE_NOISE_CORRECTION: f64 = 1e-9;

/// Linear predictors of every order up to the highest, computed by the Levinson-Durbin recursion.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Reflection coefficients k(1), k(2) ...; the predictor of order m consists of the first m.
    pub reflection: Vec<f64>,
    /// Power of the prediction error at order 0, 1 ...: one value more than there are reflection coefficients.
    pub error_power: Vec<f64>,
}

impl Prediction {
    /// Solves the normal equations of the autocorrelation `lags`, r(0) first, for all orders up to `max_order` or up to
    /// the last lag.
    ///
    /// Stops at the last order that is numerically reliable. Where round-off exceeds the power of the error, |k| would
    /// be one or more, and such a coefficient is never returned. Silence has order 0 and no power.
    pub fn levinson_durbin(lags: &[f64], max_order: usize) -> Self {
        wide(
            #[inline(always)]
            || Self::recursion(lags, max_order),
        )
    }

    /// See [`Self::levinson_durbin`].
    #[inline(always)]
    fn recursion(lags: &[f64], max_order: usize) -> Self {
        let max_order = max_order.min(lags.len().saturating_sub(1));
        let power = lags.first().copied().unwrap_or(0.0).max(0.0);
        let mut error = power;
        let mut result = Self {
            reflection: Vec::with_capacity(max_order),
            error_power: vec![error],
        };
        let mut predictor = Growing::up_to(max_order);
        for m in 0..max_order {
            if error <= 0.0 {
                break;
            }
            // The sum of the products of a(1) .. a(m) with r(m) .. r(1) equals that of the reversed a with r(1) ..
            // r(m).
            let k = -(lags[m + 1] + dot_inlined(predictor.reversed(), &lags[1..=m])) / error;
            if !k.is_finite() || k.abs() >= 1.0 {
                break;
            }
            predictor.step_up(k);
            // This form keeps the digits that 1 - k² loses where |k| is near one, as for a narrow line.
            error *= (1.0 - k) * (1.0 + k);
            result.reflection.push(k);
            result.error_power.push(error);
        }
        result
    }

    /// Returns the highest order.
    pub fn max_order(&self) -> usize {
        self.reflection.len()
    }

    /// Returns the order m of the Bayesian information criterion for a signal of N = `samples` samples: the minimum of
    /// N ln E(m) + m ln N.
    pub fn bayesian_order(&self, samples: usize) -> usize {
        let n = samples.max(1) as f64;
        self.order_by(samples, n.ln())
    }

    /// Returns the order m of Akaike's criterion for a signal of N = `samples` samples: the minimum of N ln E(m) + 2 m,
    /// at which the expected prediction error for another signal of the same kind is least (Akaike 1974).
    pub fn akaike_order(&self, samples: usize) -> usize {
        self.order_by(samples, 2.0)
    }

    /// Returns the order m with the least N ln E(m) + `penalty` m.
    fn order_by(&self, samples: usize, penalty: f64) -> usize {
        let n = samples.max(1) as f64;
        let criterion = |m: usize| n * self.error_power[m].ln() + m as f64 * penalty;
        (0..self.error_power.len())
            // The logarithm of no power would win against every other order.
            .filter(|&m| self.error_power[m] > 0.0)
            .min_by(|&a, &b| criterion(a).total_cmp(&criterion(b)))
            .unwrap_or(0)
    }
}

/// Applies [`WHITE_NOISE_CORRECTION`] to `lags`.
#[must_use]
pub fn corrected(mut lags: Vec<f64>) -> Vec<f64> {
    if let Some(power) = lags.first_mut() {
        *power *= 1.0 + WHITE_NOISE_CORRECTION;
    }
    lags
}

/// Step-up recursion: a(1) .. a(M) of A(z) from the reflection coefficients.
pub fn step_up(reflection: &[f64]) -> Vec<f64> {
    wide(
        #[inline(always)]
        || {
            let mut predictor = Growing::up_to(reflection.len());
            reflection.iter().for_each(|&k| predictor.step_up(k));
            predictor.forward
        },
    )
}

/// A predictor that grows by one order at a time. It is stored in both directions, so that no step needs to reverse it.
struct Growing {
    /// a(1) to a(m), followed by zeros.
    forward: Vec<f64>,
    /// Zeros, followed by a(m) to a(1).
    backward: Vec<f64>,
    /// The order m.
    order: usize,
}

impl Growing {
    /// Creates the predictor of order 0, which can grow up to `max_order`.
    #[inline(always)]
    fn up_to(max_order: usize) -> Self {
        Self {
            forward: vec![0.0; max_order],
            backward: vec![0.0; max_order],
            order: 0,
        }
    }

    /// Returns a(m) to a(1).
    #[inline(always)]
    fn reversed(&self) -> &[f64] {
        &self.backward[self.backward.len() - self.order..]
    }

    /// Adds the stage whose reflection coefficient is `k`.
    #[inline(always)]
    fn step_up(&mut self, k: f64) {
        let m = self.order;
        let first = self.backward.len() - m;
        for (a, b) in self.forward[..m].iter_mut().zip(&mut self.backward[first..]) {
            (*a, *b) = (*a + k * *b, *b + k * *a);
        }
        self.forward[m] = k;
        self.backward[first - 1] = k;
        self.order = m + 1;
    }
}

/// Step-down recursion: reflection coefficients from a(1) .. a(M). Returns `None` if the magnitude of a coefficient is
/// one or more. Then 1/A(z) is unstable, or so near to instability that double precision cannot decide, because
/// round-off grows as the product of (1 + |k|) / (1 - |k|).
pub fn step_down(predictor: &[f64]) -> Option<Vec<f64>> {
    let mut rest = predictor.to_vec();
    let mut reflection = Vec::with_capacity(rest.len());
    while let Some(k) = rest.pop() {
        if k.is_nan() || k.abs() >= 1.0 {
            return None;
        }
        // Near |k| = 1 the factors keep the digits that 1 - k² loses.
        let scale = 1.0 / ((1.0 - k) * (1.0 + k));
        let reversed: Vec<f64> = rest.iter().rev().copied().collect();
        for (a, b) in rest.iter_mut().zip(reversed) {
            *a = (*a - k * b) * scale;
        }
        reflection.push(k);
    }
    reflection.reverse();
    Some(reflection)
}

/// Power of the prediction error as a fraction of the signal's power: Π (1 - k²).
pub fn error_share(reflection: &[f64]) -> f64 {
    reflection.iter().map(|k| (1.0 - k) * (1.0 + k)).product()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    /// `levinson_durbin` of statsmodels and `LEVINSON` of the spectrum package agree on these values.
    #[test]
    fn a_small_published_case_comes_out_to_all_its_digits() {
        let x = [1.0, 2.0, -1.0, 3.0, 0.5, -2.0, 1.5, 0.25];
        let lags = crate::autocorrelation::Autocorrelation::of(&x, 3).lags;
        let prediction = Prediction::levinson_durbin(&lags, 3);
        let a = step_up(&prediction.reflection);
        let expected = [0.207_990_120_250, -0.007_255_996_838, -0.482_420_838_654];
        for (got, want) in a.iter().zip(expected) {
            assert!((got - want).abs() < 1e-11, "{a:?}");
        }
        near(prediction.error_power[3], 1.922_487_402_383, 1e-11);
    }

    #[test]
    fn silence_has_no_order_and_no_power() {
        let prediction = Prediction::levinson_durbin(&[0.0; 50], 40);
        assert_eq!(prediction.max_order(), 0);
        assert_eq!(prediction.error_power, [0.0]);
        assert_eq!(prediction.bayesian_order(10_000), 0);
    }

    proptest! {
        /// Reference: the recursion's formula, a(i) + k a(m - i).
        #[test]
        fn a_step_up_is_that_of_its_formula_to_the_bit(reflection in prop::collection::vec(-0.95f64..0.95, 0..60)) {
            let mut expected: Vec<f64> = Vec::new();
            for &k in &reflection {
                let before = expected.clone();
                let terms = before.iter().zip(before.iter().rev());
                expected = terms.map(|(a, b)| a + k * b).chain([k]).collect();
            }
            prop_assert_eq!(step_up(&reflection), expected);
        }

        #[test]
        fn step_down_undoes_step_up(drawn in prop::collection::vec(-0.95f64..0.95, 0..40)) {
            // Round-off grows like the coefficients in the step-up recursion, and again in the step-down recursion: by
            // (1 + |k|) / (1 - |k|) per stage. Where the product approaches the inverse of a double's precision, a step
            // down may return `None` for a stable filter.
            let mut growth = 1.0;
            let mut reflection = Vec::new();
            for k in drawn {
                let grown = growth * (1.0 + k.abs()) / (1.0 - k.abs());
                if grown >= 1e10 {
                    break;
                }
                growth = grown;
                reflection.push(k);
            }
            let back = step_down(&step_up(&reflection));
            prop_assert!(back.is_some(), "no reflection coefficients of {reflection:?}");
            for (a, b) in reflection.iter().zip(back.unwrap()) {
                prop_assert!((a - b).abs() < 1e-15 * growth.max(100.0));
            }
        }

        #[test]
        fn models_of_any_finite_signal_are_stable(
            signal in prop::collection::vec(prop_oneof![Just(0.0), -1e3f64..1e3], 1..200),
            order in 0usize..=200,
        ) {
            let lags = crate::autocorrelation::Autocorrelation::of(&signal, order).lags;
            let prediction = Prediction::levinson_durbin(&corrected(lags), order);
            prop_assert!(prediction.reflection.iter().all(|k| k.abs() < 1.0));
            prop_assert!(prediction.error_power.iter().all(|e| e.is_finite() && *e >= 0.0));
            prop_assert!(prediction.error_power.windows(2).all(|pair| pair[1] <= pair[0]));
            prop_assert!(prediction.bayesian_order(signal.len()) <= prediction.max_order());
        }
    }

    #[test]
    fn an_unstable_polynomial_has_no_reflection_coefficients() {
        assert_eq!(step_down(&[-2.5, 1.0]), None);
        assert_eq!(step_down(&[f64::NAN]), None);
        assert!(step_down(&[-1.8, 0.81]).is_some());
    }

    proptest! {
        /// Both criteria compare nested models, so a larger penalty never gives a higher order.
        #[test]
        fn akaikes_order_is_never_below_the_bayesian_one(
            signal in prop::collection::vec(-1e3f64..1e3, 8..400),
        ) {
            let lags = crate::autocorrelation::Autocorrelation::of(&signal, 100).lags;
            let prediction = Prediction::levinson_durbin(&corrected(lags), 100);
            let (akaike, bayesian) = (prediction.akaike_order(signal.len()), prediction.bayesian_order(signal.len()));
            prop_assert!(bayesian <= akaike && akaike <= prediction.max_order());
        }
    }

    #[test]
    fn the_order_of_an_autoregressive_process_is_found() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let a = step_up(&[-0.9, 0.7, -0.3, 0.5]);
        let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
        let mut y: Vec<f64> = Vec::new();
        for n in 0..20_000 {
            let e: f64 = StandardNormal.sample(&mut rng);
            let past = a.iter().enumerate().filter(|(i, _)| *i < n);
            y.push(e - past.map(|(i, a)| a * y[n - 1 - i]).sum::<f64>());
        }
        let lags = crate::autocorrelation::Autocorrelation::of(&y, 400).lags;
        let prediction = Prediction::levinson_durbin(&corrected(lags), 400);
        assert_eq!(prediction.bayesian_order(y.len()), 4);
    }
}
