//! Exact interval of a proportion.
//!
//! Clopper and Pearson, Biometrika 26 (1934) 404. For any number of trials, the interval contains the true proportion
//! with at least the stated probability. At the lower end, a count at least as high as the observed one has half of the
//! remaining probability; at the upper end, a count at most as high has it.

use statrs::distribution::{Beta, ContinuousCDF};

/// Returns the Clopper-Pearson interval, at `confidence` (such as 0.95), of the proportion of which `successes` were
/// counted in `trials`. Without trials, the interval is 0 to 1.
/// Panics if there are more successes than trials.
pub fn clopper_pearson(successes: u32, trials: u32, confidence: f64) -> (f64, f64) {
    assert!(successes <= trials, "{successes} successes of {trials} trials");
    let tail = (1.0 - confidence) / 2.0;
    // The probability of at least k successes in n trials at the proportion p is the cumulative distribution at p of
    // the beta distribution with parameters k and n - k + 1.
    let quantile = |k: u32, chance: f64| {
        Beta::new(f64::from(k), f64::from(trials - k + 1))
            .expect("both counts are above zero")
            .inverse_cdf(chance)
    };
    // If no trial is a success, or every trial, the end of the interval is 0 or 1: its beta distribution is not
    // defined.
    let low = if successes == 0 { 0.0 } else { quantile(successes, tail) };
    let high = if successes == trials {
        1.0
    } else {
        quantile(successes + 1, 1.0 - tail)
    };
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    /// SciPy 1.17: `stats.binomtest(k, n).proportion_ci(c, 'exact')`.
    #[test]
    fn intervals_are_those_of_scipy() {
        for (successes, trials, confidence, low, high) in [
            (0, 10, 0.95, 0.0, 0.308_497_107_818_762_94),
            (10, 10, 0.95, 0.691_502_892_181_237_1, 1.0),
            (17, 24, 0.95, 0.489_052_186_142_167_06, 0.873_847_911_476_310_9),
            (1, 3, 0.9, 0.016_952_427_508_443_12, 0.864_649_637_828_416_2),
            (60, 100, 0.95, 0.497_209_150_422_333_5, 0.696_705_231_297_155_1),
            (777, 1200, 0.99, 0.611_021_408_709_744_6, 0.682_792_644_844_356_1),
            (1, 1, 0.95, 0.025, 1.0),
        ] {
            let found = clopper_pearson(successes, trials, confidence);
            near(found.0, low, 1e-12);
            near(found.1, high, 1e-12);
        }
        assert_eq!(clopper_pearson(0, 0, 0.95), (0.0, 1.0));
    }

    proptest! {
        #[test]
        fn an_interval_holds_its_proportion_and_mirrors_that_of_failures(trials in 1u32..400, share in 0.0..=1.0f64) {
            let successes = (share * f64::from(trials)).round() as u32;
            let (low, high) = clopper_pearson(successes, trials, 0.95);
            let proportion = f64::from(successes) / f64::from(trials);
            prop_assert!(low <= proportion && proportion <= high);
            let (mirrored_low, mirrored_high) = clopper_pearson(trials - successes, trials, 0.95);
            prop_assert!((low + mirrored_high - 1.0).abs() < 1e-9);
            prop_assert!((high + mirrored_low - 1.0).abs() < 1e-9);
        }
    }
}
