//! The material of a codebook: the choice of stretches and trials.

use std::borrow::Cow;

use rayon::prelude::*;
use stylus_dsp::sums::mean_square;

use super::bound::limited;
use super::loudness::Loudest;
use super::trace::Trace;

/// Length of a stretch, samples: 0.2 s.
pub(super) const STRETCH_SAMPLES: usize = 1000;

/// Least number of stretches of a codebook: 0.8 s.
pub(super) const LEAST_STRETCHES: usize = 4;

/// Largest number of stretches of a codebook: 5 s.
pub(super) const MOST_STRETCHES: usize = 25;

/// Number of stretches that stay together if there is enough material to choose from: 1 s.
const TOGETHER: usize = 5;

/// A stretch of a trial.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    trace: usize,
    start: usize,
    power: f64,
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
/// [`LEAST_STRETCHES`] are allowed, or are clean.
///
/// The stretches are taken at equal ranks of their power, so that calm and lively ones are as frequent as in the
/// recordings.
pub(super) fn choose(traces: &[&Trace], most: usize, loudest: Loudest) -> Option<Material> {
    let prepared: Vec<Cow<'_, [f64]>> = traces.par_iter().map(|trace| limited(trace, loudest)).collect();
    let of_length = |samples: usize| -> Vec<Stretch> {
        let own = traces.iter().enumerate();
        own.flat_map(|(trace, own)| {
            let prepared = &prepared[trace];
            clean(own, samples).map(move |start| {
                let power = mean_square(&prepared[start..start + samples]);
                Stretch { trace, start, power }
            })
        })
        .collect()
    };
    let mut stretches = of_length(STRETCH_SAMPLES);
    let (mut length, mut count) = (STRETCH_SAMPLES, stretches.len().min(most));
    if count < LEAST_STRETCHES {
        return None;
    }
    if stretches.len() > most {
        let longer = of_length(TOGETHER * STRETCH_SAMPLES);
        if longer.len() >= most / TOGETHER && most >= TOGETHER {
            (length, count) = (TOGETHER * STRETCH_SAMPLES, most / TOGETHER);
            stretches = longer;
        }
    }
    stretches.sort_by(|a, b| a.power.total_cmp(&b.power));
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

/// Returns the first sample of each stretch of this `length` in a trial. The stretches are clean and do not overlap.
fn clean(trace: &Trace, length: usize) -> impl Iterator<Item = usize> {
    let mut start = 0;
    std::iter::from_fn(move || {
        while start + length <= trace.residual.len() {
            let stretch = start..start + length;
            let flaw = trace
                .flaws
                .iter()
                .find(|flaw| flaw.start < stretch.end && stretch.start < flaw.end);
            start = flaw.map_or(stretch.end, |flaw| flaw.end);
            if flaw.is_none() {
                return Some(stretch.start);
            }
        }
        None
    })
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
    fn flaws_are_not_taken() {
        let mut one = trace(12_000);
        one.flaws = vec![2500..2600, 2550..2580];
        let material = choose(&[&one], MOST_STRETCHES, ANY).unwrap();
        assert_eq!((material.samples.len(), material.trials), (11_000, 1));
        for x in &material.samples {
            let place = ((x - 1.0) * 1e6).round();
            assert!(!(2500.0..2600.0).contains(&place), "{place}");
        }
        one.flaws = std::iter::once(0..8500).collect();
        assert_eq!(choose(&[&one], MOST_STRETCHES, ANY), None, "0.7 s are too little");
        assert_eq!(choose(&[], MOST_STRETCHES, ANY), None);
        assert_eq!(choose(&[&trace(STRETCH_SAMPLES - 1)], MOST_STRETCHES, ANY), None);
    }

    /// The first quarter is ten times as loud.
    #[test]
    fn calm_and_lively_stretches_have_the_share_that_they_have_in_the_recordings() {
        let mut one = trace(40_000);
        one.residual[..10_000].iter_mut().for_each(|x| *x *= 10.0);
        let material = choose(&[&one], 20, ANY).unwrap();
        let lively = material.samples.iter().filter(|&&x| x > 5.0).count();
        assert_eq!(lively, 5 * STRETCH_SAMPLES);
        // Stretches of a second stay whole.
        let steps = material
            .samples
            .windows(2)
            .filter(|pair| (pair[1] - pair[0]).abs() > 2e-5)
            .count();
        assert!(steps <= 3, "{steps}");
    }
}
