//! The material of a codebook: the choice of stretches and trials.

use std::borrow::Cow;

use rayon::prelude::*;

use super::bound::limited;
use super::evidence::{KURTOSIS_SAMPLES, kurtosis_of};
use super::level::BESIDE_CODEBOOK;
use super::loudness::Loudest;
use super::power::local_rms;
use super::trace::Trace;
use crate::dsp::sums::mean_square;

/// Length of a stretch, samples: 0.2 s. A player takes pieces of 20 to 80 ms from it.
pub(super) const STRETCH_SAMPLES: usize = 1000;

/// Least number of stretches of a codebook: 0.8 s.
pub(super) const LEAST_STRETCHES: usize = 4;

/// Largest number of stretches of a codebook by the mu-law: 2 s. Longer codebooks come no closer to another take.
pub(super) const MOST_STRETCHES: usize = 10;

/// Largest number of stretches of a codebook in blocks: 5 s, which take about as many bytes.
pub(super) const MOST_STRETCHES_OF_MOMENTS: usize = 25;

/// Number of stretches that stay together if there is enough material to choose recorded snippets from: 1 s.
const TOGETHER: usize = 5;

/// What is done with the level of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    /// Divided out, because a track holds it.
    Apart,
    /// Steady enough to be left unchanged.
    Steady,
    /// Kept, because recorded snippets are played with their own level.
    OfMoments,
}

/// Power relative to the trial's below which a stretch does not count as the surface's, as when the tool stood still:
/// -12 dB.
const QUIET: f64 = 0.063;

/// A stretch of a trial.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    trace: usize,
    start: usize,
    /// Mean kurtosis of the stretch's windows of 10 ms, or, for recorded snippets, the stretch's power.
    rank: f64,
}

/// Material of a codebook.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    /// Samples of the stretches, one after the other.
    pub samples: Vec<f64>,
    /// Number of trials that the stretches come from.
    pub trials: usize,
}

/// Chooses at most `most` stretches of `traces`, limited to the `loudest` windows. `None` if fewer than
/// [`LEAST_STRETCHES`] are allowed, or are clean and, except for recorded snippets, not quiet.
///
/// The stretches are taken at equal ranks of their kurtosis, so that calm and lively ones are as frequent as in the
/// recordings. Those of recorded snippets are taken at equal ranks of their power.
pub(super) fn choose(traces: &[&Trace], level: Level, most: usize, loudest: Loudest) -> Option<Material> {
    let prepared = traces.par_iter();
    let prepared = prepared.map(|trace| limited(trace, levelled(&trace.residual, level), loudest));
    let prepared: Vec<Cow<'_, [f64]>> = prepared.collect();
    let of_length = |samples: usize| -> Vec<Stretch> {
        let own = traces.iter().enumerate();
        own.flat_map(|(trace, own)| {
            let prepared = &prepared[trace];
            clean(own, samples, level).map(move |start| {
                let stretch = &prepared[start..start + samples];
                let rank = match level {
                    Level::OfMoments => mean_square(stretch),
                    _ => mean_kurtosis(stretch),
                };
                Stretch { trace, start, rank }
            })
        })
        .collect()
    };
    let mut stretches = of_length(STRETCH_SAMPLES);
    let (mut length, mut count) = (STRETCH_SAMPLES, stretches.len().min(most));
    if count < LEAST_STRETCHES {
        return None;
    }
    if level == Level::OfMoments && stretches.len() > 2 * most {
        let longer = of_length(TOGETHER * STRETCH_SAMPLES);
        if longer.len() >= most / TOGETHER {
            (length, count) = (TOGETHER * STRETCH_SAMPLES, most / TOGETHER);
            stretches = longer;
        }
    }
    stretches.sort_by(|a, b| a.rank.total_cmp(&b.rank));
    // The middle of each of `count` equal ranges of ranks.
    let rank = |n: usize| (2 * n + 1) * stretches.len() / (2 * count);
    let mut chosen: Vec<Stretch> = (0..count).map(|n| stretches[rank(n)]).collect();
    // Keeps neighbours together.
    chosen.sort_by_key(|stretch| (stretch.trace, stretch.start));
    let samples = |stretch: &Stretch| prepared[stretch.trace][stretch.start..stretch.start + length].to_vec();
    let mut of: Vec<usize> = chosen.iter().map(|stretch| stretch.trace).collect();
    of.dedup();
    Some(Material {
        samples: chosen.iter().flat_map(samples).collect(),
        trials: of.len(),
    })
}

/// Returns `residual` with its level treated for this kind of material.
fn levelled(residual: &[f64], level: Level) -> Cow<'_, [f64]> {
    if level != Level::Apart {
        return residual.into();
    }
    let levels = local_rms(residual, BESIDE_CODEBOOK.smoothing);
    let even = residual.iter().zip(levels);
    even.map(|(x, level)| x / level).collect()
}

/// Returns the first sample of each stretch of this `length` in a trial. The stretches are clean and, except for
/// recorded snippets, not quiet, and they do not overlap.
fn clean(trace: &Trace, length: usize, level: Level) -> impl Iterator<Item = usize> {
    let mut start = 0;
    std::iter::from_fn(move || {
        while start + length <= trace.residual.len() {
            let stretch = start..start + length;
            let flaw = trace
                .flaws
                .iter()
                .find(|flaw| flaw.start < stretch.end && stretch.start < flaw.end);
            let is_loud = level == Level::OfMoments || mean_square(&trace.residual[stretch.clone()]) > QUIET;
            start = flaw.map_or(stretch.end, |flaw| flaw.end);
            if flaw.is_none() && is_loud {
                return Some(stretch.start);
            }
        }
        None
    })
}

fn mean_kurtosis(stretch: &[f64]) -> f64 {
    let windows = stretch.chunks_exact(KURTOSIS_SAMPLES);
    let loud = windows.filter(|window| mean_square(window) > 0.0);
    let (count, sum) = loud.fold((0.0, 0.0), |(count, sum), window| {
        (count + 1.0, sum + kurtosis_of(window))
    });
    sum / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANY: Loudest = Loudest([f64::INFINITY; 3]);

    fn trace(samples: usize) -> Trace {
        // The value of each sample encodes its position.
        Trace {
            residual: (0..samples).map(|n| 1.0 + n as f64 / 1e6).collect(),
            ..Trace::default()
        }
    }

    #[test]
    fn flaws_and_quiet_stretches_are_not_taken() {
        let mut one = trace(12_000);
        one.flaws = vec![2500..2600, 2550..2580];
        one.residual[5000..6500].iter_mut().for_each(|x| *x *= 0.1);
        let material = choose(&[&one], Level::Steady, MOST_STRETCHES, ANY).unwrap();
        assert_eq!((material.samples.len(), material.trials), (10_000, 1));
        for x in &material.samples {
            let place = ((x - 1.0) * 1e6).round();
            assert!(!(2500.0..2600.0).contains(&place), "{place}");
        }
        let quiet = material.samples.iter().filter(|&&x| x < 0.5).count();
        assert!(quiet <= 900, "half of a stretch at most: {quiet}");
        one.flaws = std::iter::once(0..8500).collect();
        assert_eq!(
            choose(&[&one], Level::Steady, MOST_STRETCHES, ANY),
            None,
            "0.7 s are too little"
        );
        assert_eq!(choose(&[], Level::Apart, MOST_STRETCHES, ANY), None);
        assert_eq!(
            choose(&[&trace(STRETCH_SAMPLES - 1)], Level::Apart, MOST_STRETCHES, ANY),
            None
        );
    }

    #[test]
    fn calm_and_lively_stretches_have_the_share_that_they_have_in_the_recordings() {
        let mut one = trace(40_000);
        for n in (0..10_000).step_by(KURTOSIS_SAMPLES) {
            one.residual[n] = 20.0;
        }
        let material = choose(&[&one], Level::Steady, 8, ANY).unwrap();
        let lively = material.samples.iter().filter(|&&x| x > 10.0).count();
        assert_eq!(lively, 2 * STRETCH_SAMPLES / KURTOSIS_SAMPLES);
    }

    #[test]
    fn material_beside_a_track_has_an_even_level() {
        let mut one = trace(20_000);
        for (n, x) in one.residual.iter_mut().enumerate() {
            *x *= (f64::from(n as u32) / 3.0).sin() * (1.0 + 0.9 * (n as f64 / 1000.0).sin());
        }
        let level_db = |samples: &[f64]| {
            let levels = samples.chunks_exact(250);
            let levels = levels.map(|w| 10.0 * mean_square(w).log10());
            levels.clone().fold(f64::MIN, f64::max) - levels.fold(f64::MAX, f64::min)
        };
        let [with, without] = [Level::Apart, Level::Steady].map(|level| choose(&[&one], level, 10, ANY).unwrap());
        assert!(level_db(&without.samples) > 8.0);
        assert!(level_db(&with.samples) < 1.5, "{}", level_db(&with.samples));
    }
}
