//! Whether what a trial's model plays would be Gaussian noise: a test of the output in the bands that a hand feels.
//!
//! Three statistics of the output are compared with those of equally long stretches of Gaussian noise through the
//! trial's own filter: the spread of levels in windows of 50 ms at 20 to 60 Hz and at 60 to 500 Hz, and the kurtosis at
//! 20 to 1000 Hz. Nothing is fitted to them, so that all of the trial can be judged. The residual over all its band
//! would not do: what a hand feels is a fifth of it, and noise of the recording hides in the rest what varies there.
//!
//! What happens once is no evidence of what a surface does. Therefore the loudest window of each stretch, of the trial
//! and of noise alike, does not count, nor do its neighbours.

use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use model_format::limits::MAX_CODEBOOKS;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::linear_prediction::step_up;
use stylus_dsp::sums::{energy, mean_square};
use stylus_support::fnv::Fnv;

/// Least magnitude of a score that is significant. Of Gaussian trials of 0.5 s and more, at most 2 in 100 reach it.
const SIGNIFICANT: f64 = 3.5;

/// Least norm of the three scores that is significant. Together they tell a surface that none of them tells alone.
const SIGNIFICANT_TOGETHER: f64 = 4.0;

/// Least magnitude of the mean score of many trials that counts. In trials of 2 s it is a fifth of a spread of levels.
/// Over a hundred trials far less is significant, and no hand feels it.
const FELT: f64 = 2.0;

/// Duration below which less than a spread one and a half times that of noise may not be significant, s.
const FEW_S: f64 = 2.0;

/// Bands in which levels are measured, and the band of the kurtosis, Hz. Each has the number of samples by which its
/// output is computed in a window.
const BANDS: [([f64; 2], usize); 3] = [([20.0, 60.0], 10), ([60.0, 500.0], 50), ([20.0, HIGHEST_HZ], 100)];

/// Highest frequency of the bands, Hz.
const HIGHEST_HZ: f64 = 1000.0;

/// Samples of a window of 50 ms.
const WINDOW: usize = 250;

/// Number of stretches of noise of a trial that may be judged alone, and of one of [`MANY`] or more. With eight, a
/// score is less certain, but then mostly one of several that decide together. Alone it would be significant for 3 of
/// 100 trials of noise, which then take up bytes for snippets that sound the same.
const STRETCHES: [usize; 2] = [25, 8];

/// Number of a texture's trials from which on each needs fewer stretches: some six for each codebook.
const MANY: usize = 6 * MAX_CODEBOOKS;

/// Longest part of a trial that is judged, windows: 10 s.
const LONGEST: usize = 200;

/// Least number of windows that are judged: three are left out, and of fewer than two others there is no spread.
const LEAST: usize = 5;

/// Least power of a window, relative to the mean; lower ones count as this, so that silence is not infinitely far away.
const LEAST_POWER: f64 = 1e-4;

/// Deviations of an output from Gaussian noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Deviations of the spread of levels at 20 to 60 Hz, of that at 60 to 500 Hz, and of the kurtosis, in standard
    /// deviations of what noise has.
    pub scores: [f64; 3],
    /// Duration that was judged, s; 0 if there was nothing to judge.
    pub seconds: f64,
}

impl Evidence {
    /// Judges a `residual` behind a filter with these `reflection` coefficients, without its `flaws`, in the band
    /// `known_hz` that its recording holds. It is that of one of the `trials` of a texture.
    pub(super) fn of(
        residual: &[f64],
        flaws: &[Range<usize>],
        reflection: &[f64],
        known_hz: &Range<f64>,
        trials: usize,
    ) -> Self {
        let all = (residual.len() / WINDOW).min(LONGEST);
        let is_clean = |n: &usize| {
            flaws
                .iter()
                .all(|flaw| flaw.end <= n * WINDOW || (n + 1) * WINDOW <= flaw.start)
        };
        let windows: Vec<usize> = (0..all).filter(is_clean).collect();
        if windows.len() < LEAST {
            return Self::default();
        }
        let samples = all * WINDOW;
        // The outputs of all bands have quick lengths too.
        let length = 25 * fourier::quick_length(samples / 25);
        let mut whitening = vec![0.0; length];
        whitening[0] = 1.0;
        let predictor = step_up(reflection);
        whitening[1..=predictor.len()].copy_from_slice(&predictor);
        let bins = fourier::forward(&mut whitening);
        let bin_hz = f64::from(SAMPLE_RATE_HZ) / length as f64;
        let gain = |(bin, value): (usize, &Complex<f64>)| {
            let is_known = known_hz.contains(&(bin as f64 * bin_hz));
            if is_known { value.inv() } else { Complex::ZERO }
        };
        let filter: Vec<_> = bins[..=length / 5].iter().enumerate().map(gain).collect();
        let of = |excitation: &mut dyn Iterator<Item = Complex<f64>>| {
            let output: Vec<_> = excitation.zip(&filter).map(|(bin, filter)| bin * filter).collect();
            statistics(&output, &windows)
        };
        let mut circle: Vec<f64> = residual.iter().copied().cycle().take(length).collect();
        let own = of(&mut fourier::forward(&mut circle).into_iter());
        // Each trial has noise of its own: errors of the same noise would add up over trials. Last digits do not count,
        // because they depend on the system, and a trial has the same noise on all of them.
        let digits = residual[..samples]
            .iter()
            .step_by(samples / 8)
            .map(|x| (*x as f32).to_bits() >> 8);
        let hash = digits.fold(Fnv::default(), |hash, digits| hash.then(&digits.to_le_bytes()));
        let mut generator = Pcg64::seed_from_u64(hash.value());
        let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
        let mut bins = std::iter::repeat_with(|| Complex::new(normal(), normal()));
        let stretches = STRETCHES[usize::from(trials >= MANY)];
        let noise: Vec<[f64; 3]> = (0..stretches).map(|_| of(&mut bins)).collect();
        let score = |n: usize| {
            let count = stretches as f64;
            let mean = noise.iter().map(|of| of[n]).sum::<f64>() / count;
            let variance = noise.iter().map(|of| (of[n] - mean).powi(2)).sum::<f64>() / (count - 1.0);
            // The mean of the noise is uncertain, too.
            (own[n] - mean) / (variance * (1.0 + 1.0 / count)).sqrt().max(f64::MIN_POSITIVE)
        };
        Self {
            scores: [score(0), score(1), score(2)],
            seconds: (windows.len() * WINDOW) as f64 / f64::from(SAMPLE_RATE_HZ),
        }
    }

    /// Returns the deviations of several trials together: by Stouffer's sum, and significant only if their mean is at
    /// least [`FELT`].
    pub(super) fn of_all(trials: impl IntoIterator<Item = Self>) -> Self {
        let (mut sum, mut count) = (Self::default(), 0.0f64);
        for trial in trials.into_iter().filter(|trial| trial.seconds > 0.0) {
            for (sum, score) in sum.scores.iter_mut().zip(trial.scores) {
                *sum += score;
            }
            sum.seconds += trial.seconds;
            count += 1.0;
        }
        // With more than three trials the second bound is the higher one.
        let scale = count.sqrt().max(count * FELT / SIGNIFICANT).max(1.0);
        sum.scores.iter_mut().for_each(|score| *score /= scale);
        sum
    }

    /// Returns whether the output is known to be Gaussian noise, as far as a hand feels.
    pub fn is_gaussian(&self) -> bool {
        let is_small = |score: &f64| score.abs() <= SIGNIFICANT;
        self.seconds > 0.0 && self.scores.iter().all(is_small) && energy(&self.scores).sqrt() <= SIGNIFICANT_TOGETHER
    }
}

impl std::fmt::Display for Evidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [slow, fast, kurtosis] = self.scores;
        if self.seconds <= 0.0 {
            return f.write_str("too little to judge");
        }
        write!(
            f,
            "spread of 50 ms levels {slow:+.1} standard deviations from Gaussian noise's at 20-60 Hz, {fast:+.1} at \
             60-500 Hz, kurtosis {kurtosis:+.1}; more than {SIGNIFICANT} is significant, or {SIGNIFICANT_TOGETHER} \
             together"
        )?;
        if self.seconds < FEW_S {
            write!(f, "; {:.2} s are few to judge by", self.seconds)?;
        }
        Ok(())
    }
}

/// Returns the logarithms of the spreads of levels, and of the kurtosis, of the `windows` of the output with these bins
/// below 1 kHz.
fn statistics(output: &[Complex<f64>], windows: &[usize]) -> [f64; 3] {
    let last = output.len() - 1;
    let [slow, fast, felt] = BANDS.map(|(band_hz, in_window)| {
        let length = last * in_window / 50;
        let [low, high] = band_hz.map(|hz| (hz * last as f64 / HIGHEST_HZ).ceil() as usize);
        let mut bins = output[..=length / 2].to_vec();
        bins[..low].fill(Complex::default());
        bins[high..].fill(Complex::default());
        (fourier::inverse(&mut bins, length), in_window)
    });
    let power = |(signal, length): &(Vec<f64>, usize), n: usize| mean_square(&signal[n * length..][..*length]);
    let louder = |a: &&usize, b: &&usize| power(&felt, **a).total_cmp(&power(&felt, **b));
    let loudest = windows.iter().max_by(louder).copied().unwrap_or(0);
    let counted: Vec<usize> = windows.iter().copied().filter(|n| n.abs_diff(loudest) > 1).collect();
    let spread = |signal| {
        let powers: Vec<f64> = counted.iter().map(|&n| power(signal, n)).collect();
        let count = powers.len() as f64;
        let least = LEAST_POWER * powers.iter().sum::<f64>() / count;
        let levels: Vec<f64> = powers
            .iter()
            .map(|power| power.max(least).max(f64::MIN_POSITIVE).ln())
            .collect();
        let mean = levels.iter().sum::<f64>() / count;
        let variance = levels.iter().map(|level| (level - mean).powi(2)).sum::<f64>() / (count - 1.0);
        variance.max(f64::MIN_POSITIVE).ln() / 2.0
    };
    let samples = || counted.iter().flat_map(|&n| &felt.0[n * felt.1..][..felt.1]);
    let mean = |power: i32| samples().map(|x| x.powi(power)).sum::<f64>() / (counted.len() * felt.1) as f64;
    let kurtosis = mean(4) / mean(2).powi(2).max(f64::MIN_POSITIVE);
    [spread(&slow), spread(&fast), kurtosis.max(f64::MIN_POSITIVE).ln()]
}
