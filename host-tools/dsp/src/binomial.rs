//! Exact interval of a proportion.
//!
//! Clopper and Pearson, Biometrika 26 (1934) 404: the interval holds the true proportion at least as often as it says,
//! for any number of trials. Its ends are the proportions at which a count as high, or as low, has half of the
//! remaining probability.

/// Halvings of an interval of 0 to 1 that end below the resolution of an f64.
const HALVINGS: u32 = 60;

/// Returns the Clopper-Pearson interval of a proportion, of which `successes` of `trials` were counted, at
/// `confidence`, such as 0.95. Without trials it is 0 to 1.
/// Panics with more successes than trials.
pub fn clopper_pearson(successes: u32, trials: u32, confidence: f64) -> (f64, f64) {
    assert!(
        successes <= trials,
        "{successes} successes of {trials} trials"
    );
    let tail = (1.0 - confidence) / 2.0;
    let low = if successes == 0 {
        0.0
    } else {
        halved(|proportion| at_least(successes, trials, proportion) < tail)
    };
    let failures = trials - successes;
    let high = if failures == 0 {
        1.0
    } else {
        // At most so many successes are at least so many failures.
        halved(|proportion| at_least(failures, trials, 1.0 - proportion) > tail)
    };
    (low, high)
}

/// The place between 0 and 1 at which `is_below` ends to hold.
fn halved(is_below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if is_below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high)
}

/// Probability of at least `least` successes in `trials` at a proportion between 0 and 1, both excluded.
fn at_least(least: u32, trials: u32, proportion: f64) -> f64 {
    let (log_success, log_failure) = (proportion.ln(), (-proportion).ln_1p());
    let mut log_ways = 0.0;
    let mut sum = 0.0;
    for count in 0..=trials {
        if count > 0 {
            log_ways += (f64::from(trials - count + 1) / f64::from(count)).ln();
        }
        if count >= least {
            let failures = f64::from(trials - count);
            sum += (log_ways + f64::from(count) * log_success + failures * log_failure).exp();
        }
    }
    sum
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
            (
                17,
                24,
                0.95,
                0.489_052_186_142_167_06,
                0.873_847_911_476_310_9,
            ),
            (1, 3, 0.9, 0.016_952_427_508_443_12, 0.864_649_637_828_416_2),
            (
                60,
                100,
                0.95,
                0.497_209_150_422_333_5,
                0.696_705_231_297_155_1,
            ),
            (
                777,
                1200,
                0.99,
                0.611_021_408_709_744_6,
                0.682_792_644_844_356_1,
            ),
            (1, 1, 0.95, 0.025, 1.0),
        ] {
            let found = clopper_pearson(successes, trials, confidence);
            near(found.0, low, 1e-9);
            near(found.1, high, 1e-9);
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
