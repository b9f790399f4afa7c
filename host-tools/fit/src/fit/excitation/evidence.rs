//! Tests at a stated level: whether the local kurtosis is above a Gaussian's, and whether levels vary more than those
//! of noise.

use serde::{Deserialize, Serialize};

use super::loudness::{Loudest, Ringing};
use crate::dsp::autocorrelation::Autocorrelation;
use crate::dsp::linear_prediction::{Prediction, corrected, step_up};
use crate::dsp::sums::{mean_square, sliding};
use crate::fit::blocks::{Blocks, lags_of_blocks};
use crate::fit::grid::SAMPLES_PER_COEFFICIENT;

/// Largest probability of a false alarm of each test.
pub(super) const LEVEL: f64 = 0.01;

/// Standard normal deviate that is exceeded with the probability [`LEVEL`].
const DEVIATE: f64 = 2.326_347_9;

/// Largest excess of the mean local kurtosis over a Gaussian's with which a residual still counts as Gaussian. Gaussian
/// noise whose level follows that of real recordings, with a resolution of 20 ms, reaches 0.31.
const KURTOSIS_MARGIN: f64 = 0.3;

/// Largest spread of 50 ms levels, in excess of that of steady noise, with which a level still counts as steady, dB. It
/// is less than half of the smallest change of level that is felt.
const SPREAD_MARGIN_DB: f64 = 1.0;

/// Least number of windows with which a test can be significant.
pub(super) const LEAST_WINDOWS: usize = 20;

/// Result of a test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// The statistic: mean kurtosis in windows of 10 ms, or standard deviation of the levels of 50 ms in dB.
    pub value: f64,
    /// Least significant value for this number of windows.
    pub needed: f64,
    /// Number of windows; for levels, less one per trial.
    pub windows: usize,
}

impl Evidence {
    /// Returns whether the test found a difference.
    pub fn is_significant(&self) -> bool {
        self.windows >= LEAST_WINDOWS && self.value > self.needed
    }
}

/// Sums of a quantity over windows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    pub count: f64,
    pub sum: f64,
    pub square: f64,
}

impl Sums {
    pub fn of(values: &[f64]) -> Self {
        values.iter().fold(Self::default(), |sums, value| Self {
            count: sums.count + 1.0,
            sum: sums.sum + value,
            square: sums.square + value * value,
        })
    }

    pub fn plus(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            square: self.square + other.square,
        }
    }

    /// Returns the mean; 0 if there are no windows.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    /// Returns the sum of the squared deviations from the mean.
    pub fn scatter(&self) -> f64 {
        (self.square - self.sum * self.mean()).max(0.0)
    }

    /// Returns the variance of the mean, estimated from the scatter of the values.
    pub fn variance_of_mean(&self) -> f64 {
        self.scatter() / (self.count - 1.0).max(1.0) / self.count.max(1.0)
    }
}

/// Returns the expected kurtosis of `samples` Gaussian samples about zero. It is 3 n / (n + 2) and not 3, because the
/// mean square in the denominator is computed from the same samples.
pub(super) fn gaussian_kurtosis(samples: usize) -> f64 {
    let n = samples as f64;
    3.0 * n / (n + 2.0)
}

/// Tests the mean local kurtosis of windows of `samples` samples: one-sided, at [`LEVEL`], with the scatter of the
/// windows. To be significant, it must be above a Gaussian's by at least [`KURTOSIS_MARGIN`].
pub(super) fn kurtosis(windows: Sums, samples: usize) -> Evidence {
    let limit = gaussian_kurtosis(samples) + KURTOSIS_MARGIN;
    Evidence {
        value: windows.mean(),
        needed: limit + DEVIATE * windows.variance_of_mean().sqrt(),
        windows: windows.count as usize,
    }
}

/// Levels of one trial's windows, and the variance that noise of its spectrum and local kurtosis would have.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Levels {
    /// Levels, dB.
    pub levels_db: Sums,
    /// Variance of the level of a window of steady noise, dB².
    pub steady_db2: f64,
}

/// Tests the spread of levels about the mean of each trial: one-sided, at [`LEVEL`], by the distribution of the
/// variance (chi-squared, by the cube root of Wilson and Hilferty, 1931).
pub(super) fn spread(trials: &[Levels]) -> Evidence {
    let freedom: f64 = trials.iter().map(|t| (t.levels_db.count - 1.0).max(0.0)).sum();
    let per_freedom = |of: &dyn Fn(&Levels) -> f64| trials.iter().map(of).sum::<f64>() / freedom.max(1.0);
    let variance = per_freedom(&|trial| trial.levels_db.scatter());
    let steady = per_freedom(&|t| t.steady_db2 * (t.levels_db.count - 1.0).max(0.0));
    // Chi-squared divided by its n degrees of freedom is close to the cube of a Gaussian of mean 1 - 2/9n and variance
    // 2/9n.
    let ninth = 2.0 / (9.0 * freedom.max(1.0));
    let quantile = (1.0 - ninth + DEVIATE * ninth.sqrt()).powi(3);
    Evidence {
        value: variance.sqrt(),
        needed: ((steady + SPREAD_MARGIN_DB.powi(2)) * quantile).sqrt(),
        windows: freedom as usize,
    }
}

/// Window of the local kurtosis, samples: 10 ms at 5 kHz, in which levels hardly change. It lasts longer if the
/// residual of a recording at a lower rate was resampled to about that rate.
pub(super) const KURTOSIS_SAMPLES: usize = 50;

/// Window of a level, samples: 50 ms.
pub(super) const LEVEL_SAMPLES: usize = 250;

/// Power relative to the mean below which a window does not count for the kurtosis, because it holds mostly the noise
/// of the recording: -20 dB.
const QUIET: f64 = 1e-2;

/// Least power of a window, relative to the mean; lower ones count as this: -40 dB, so that digital silence is not
/// infinitely far away.
const LEAST_POWER: f64 = 1e-4;

/// Number of lags of the residual's autocorrelation that are included in the expected scatter of levels.
const LAGS: usize = 100;

/// Level of a window above all others, dB, from which on it counts as an event that happened once. Such an event is no
/// evidence of what a surface does repeatedly.
const LONE_DB: f64 = 6.0;

/// Power of a residual relative to the signal's below which the residual is round-off.
pub(super) const ROUND_OFF: f64 = 1e-12;

/// Statistics of a trial's residual.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Judged {
    /// Kurtosis of windows of 10 ms.
    pub kurtosis: Sums,
    /// Levels of windows of 50 ms.
    pub levels: Levels,
}

/// Judges `signal`, with models of at most the order `order`. Returns no evidence if the signal is too short or is
/// predicted down to its round-off. If `most` is given, the residual is limited until nothing in it is louder than that
/// behind the filter. A level is that of `level_samples` samples, 50 ms.
pub(super) fn held_out(signal: &[f64], order: usize, most: Option<Loudest>, level_samples: usize) -> Judged {
    let blocks = Blocks::of(signal.len());
    let fitted: Vec<&[f64]> = blocks.fitted().map(|block| &signal[block]).collect();
    let samples: usize = fitted.iter().map(|block| block.len()).sum();
    let order = order.min(samples / SAMPLES_PER_COEFFICIENT);
    if samples == 0 || mean_square(signal) <= 0.0 {
        return Judged::default();
    }
    let lags = lags_of_blocks(&fitted, order);
    if lags[0] <= 0.0 {
        return Judged::default();
    }
    let prediction = Prediction::levinson_durbin(&corrected(lags), order);
    let predictor = step_up(&prediction.reflection);
    let order = predictor.len();
    // The first judged block follows a fitted one, which is longer than the predictor.
    let mut parts: Vec<Vec<f64>> = blocks
        .judged()
        .map(|block| residual(&signal[block.start.saturating_sub(order)..block.end], &predictor))
        .collect();
    let ringing = Ringing::of(&prediction.reflection);
    let gains = most.and_then(|most| ringing.limit(&parts.concat(), &[], most));
    let samples = parts.iter_mut().flatten();
    samples
        .zip(gains.into_iter().flatten())
        .for_each(|(x, gain)| *x *= gain);
    of_parts(&parts, mean_square(signal), level_samples)
}

/// Returns the statistics of the parts of a residual; `power` is that of the signal.
fn of_parts(parts: &[Vec<f64>], power: f64, level_samples: usize) -> Judged {
    let all: Vec<f64> = parts.iter().flatten().copied().collect();
    let mean = mean_square(&all);
    if mean.is_nan() || mean <= ROUND_OFF * power {
        return Judged::default();
    }
    let windows = |samples: usize| parts.iter().flat_map(move |part| part.chunks_exact(samples));
    let local = |samples: usize| -> Vec<f64> {
        let loud = windows(samples).filter(|window| mean_square(window) > QUIET * mean);
        loud.map(kurtosis_of).collect()
    };
    let level = |window: &[f64]| 10.0 * (mean_square(window) / mean).max(LEAST_POWER).log10();
    let mut levels_db: Vec<f64> = windows(level_samples).map(level).collect();
    calm_lone_event(&mut levels_db);
    // The variance of a window's power, relative to the squared power, is (kurtosis - 1) / n for white noise. It grows
    // with the squared autocorrelation.
    let whole = Sums::of(&local(level_samples)).mean().max(3.0);
    let coloured = 2.0 * correlation(parts);
    let share = (whole - 1.0 + coloured) / level_samples as f64;
    Judged {
        kurtosis: Sums::of(&local(KURTOSIS_SAMPLES)),
        levels: Levels {
            levels_db: Sums::of(&levels_db),
            // A small relative change of power corresponds to 10 / ln 10 times as many dB.
            steady_db2: (10.0 / std::f64::consts::LN_10).powi(2) * share,
        },
    }
}

/// Reduces an event that happened once to the level of the loudest other window. The event may lie in two neighbouring
/// windows.
fn calm_lone_event(levels_db: &mut [f64]) {
    let Some(loudest) = (0..levels_db.len()).max_by(|&a, &b| levels_db[a].total_cmp(&levels_db[b])) else {
        return;
    };
    let near = loudest.saturating_sub(1)..=(loudest + 1).min(levels_db.len() - 1);
    let others = (0..levels_db.len()).filter(|index| !near.contains(index));
    let Some(next) = others.map(|index| levels_db[index]).reduce(f64::max) else {
        return;
    };
    if levels_db[loudest] > next + LONE_DB {
        levels_db[near].iter_mut().for_each(|level| *level = level.min(next));
    }
}

/// Returns the kurtosis about zero of a window that is not silent.
pub(super) fn kurtosis_of(window: &[f64]) -> f64 {
    let square = mean_square(window);
    let fourth = window.iter().map(|x| x.powi(4)).sum::<f64>() / window.len() as f64;
    fourth / (square * square)
}

/// Returns the sum of the squared autocorrelations of `parts` at the lags 1 to [`LAGS`] of both signs, relative to that
/// at lag 0.
fn correlation(parts: &[Vec<f64>]) -> f64 {
    let mut lags = vec![0.0; LAGS + 1];
    for part in parts {
        let own = Autocorrelation::of(part, LAGS).lags;
        for (sum, lag) in lags.iter_mut().zip(own) {
            *sum += lag;
        }
    }
    2.0 * lags[1..].iter().map(|lag| (lag / lags[0]).powi(2)).sum::<f64>()
}

/// Returns the residual of `signal`, from the first sample that has enough samples before it for the predictor. It is
/// empty if the signal is not longer than the predictor.
pub(super) fn residual(signal: &[f64], predictor: &[f64]) -> Vec<f64> {
    let predicted_from = signal.get(..signal.len().max(1) - 1).unwrap_or_default();
    let newest_last: Vec<f64> = predictor.iter().rev().copied().collect();
    let predicted = sliding(predicted_from, &newest_last);
    let present = signal.iter().skip(predictor.len());
    present.zip(predicted).map(|(now, sum)| now + sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_give_mean_scatter_and_the_means_variance() {
        let sums = Sums::of(&[1.0, 2.0]).plus(Sums::of(&[3.0, 6.0]));
        assert_eq!((sums.mean(), sums.scatter()), (3.0, 14.0));
        assert!((sums.variance_of_mean() - 14.0 / 3.0 / 4.0).abs() < 1e-12);
        assert_eq!(Sums::default().mean(), 0.0);
        assert_eq!(Sums::default().variance_of_mean(), 0.0);
    }

    #[test]
    fn an_event_counts_for_the_level_only_if_it_comes_again() {
        let calmed = |events: &[usize], db: f64| {
            let mut levels_db = vec![0.0; 40];
            events.iter().for_each(|&at| levels_db[at] = db);
            calm_lone_event(&mut levels_db);
            levels_db.into_iter().fold(0.0, f64::max)
        };
        for once in [&[0][..], &[7], &[7, 8], &[39]] {
            assert_eq!(calmed(once, 20.0), 0.0, "{once:?}");
            assert_eq!(calmed(once, 5.0), 5.0, "{once:?}");
        }
        assert_eq!(calmed(&[7, 9], 20.0), 20.0);
        calm_lone_event(&mut []);
        calm_lone_event(&mut [9.0]);
    }

    #[test]
    fn few_windows_or_none_prove_nothing() {
        let none = kurtosis(Sums::default(), 50);
        assert!(!none.is_significant() && none.value == 0.0);
        assert!(!kurtosis(Sums::of(&[30.0; LEAST_WINDOWS - 1]), 50).is_significant());
        assert!(kurtosis(Sums::of(&[30.0; LEAST_WINDOWS]), 50).is_significant());
        assert!(!spread(&[]).is_significant());
        let one = Levels {
            levels_db: Sums::of(&[-20.0, 20.0]),
            steady_db2: 0.1,
        };
        assert!(!spread(&[one]).is_significant());
        assert!(spread(&[one; 40]).is_significant());
    }

    /// The 99 % quantiles of chi-squared in tables: 36.19 for 19 degrees of freedom, 134.64 for 99.
    #[test]
    fn the_spreads_bound_is_that_of_chi_squared() {
        for (freedom, quantile) in [(19, 36.19), (99, 134.64)] {
            let levels = Levels {
                levels_db: Sums::of(&vec![0.0; freedom + 1]),
                steady_db2: 3.0,
            };
            let needed = spread(&[levels]).needed;
            let exact = (4.0 * quantile / freedom as f64).sqrt();
            assert!((needed / exact - 1.0).abs() < 2e-3, "{needed} {exact}");
        }
    }
}
