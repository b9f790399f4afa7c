//! The material of a codebook: which stretches of which trials.

use super::evidence::mean_square;
use super::evidence::{KURTOSIS_SAMPLES, kurtosis_of};
use super::level::{BESIDE_CODEBOOK, local_rms};
use super::trace::Trace;

/// Samples of a stretch: 0.2 s, of which pieces of 20 to 80 ms are taken.
pub(super) const STRETCH_SAMPLES: usize = 1000;

/// Fewest stretches of a codebook: 0.8 s.
pub(super) const LEAST_STRETCHES: usize = 4;

/// Most stretches of a codebook: 2 s. Longer ones come no closer to another take.
pub(super) const MOST_STRETCHES: usize = 10;

/// Stretches this much below their trial's power are none of the surface's, as where the tool stood still: 12 dB.
const QUIET: f64 = 0.063;

/// A stretch of a trial.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    trace: usize,
    start: usize,
    /// Mean kurtosis of its windows of 10 ms.
    kurtosis: f64,
}

/// Material of a codebook.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Material {
    /// Samples of the stretches, one after the other.
    pub samples: Vec<f64>,
    /// Number of trials that they are of.
    pub trials: usize,
}

/// Takes at most `most` stretches of `traces`, divided by their level if a level track is kept beside. `None` if there
/// are fewer than [`LEAST_STRETCHES`] that are clean and not quiet.
///
/// They are taken at equal ranks of their kurtosis, so that calm and lively stretches have the share that they have in
/// the recordings.
pub(super) fn choose(traces: &[&Trace], is_level_apart: bool, most: usize) -> Option<Material> {
    let prepared: Vec<Vec<f64>> = traces
        .iter()
        .map(|trace| {
            let residual = trace.residual.iter();
            if is_level_apart {
                let levels = local_rms(&trace.residual, BESIDE_CODEBOOK.smoothing);
                residual.zip(levels).map(|(x, level)| x / level).collect()
            } else {
                residual.copied().collect()
            }
        })
        .collect();
    let mut stretches: Vec<Stretch> = Vec::new();
    for (trace, own) in traces.iter().enumerate() {
        stretches.extend(clean(own).map(|start| Stretch {
            trace,
            start,
            kurtosis: mean_kurtosis(&prepared[trace][start..start + STRETCH_SAMPLES]),
        }));
    }
    let count = stretches.len().min(most);
    if count < LEAST_STRETCHES {
        return None;
    }
    stretches.sort_by(|a, b| a.kurtosis.total_cmp(&b.kurtosis));
    let rank = |n: usize| (2 * n + 1) * stretches.len() / (2 * count);
    let mut chosen: Vec<Stretch> = (0..count).map(|n| stretches[rank(n)]).collect();
    // Neighbours stay together.
    chosen.sort_by_key(|stretch| (stretch.trace, stretch.start));
    let samples = |stretch: &Stretch| {
        prepared[stretch.trace][stretch.start..stretch.start + STRETCH_SAMPLES].to_vec()
    };
    let mut of: Vec<usize> = chosen.iter().map(|stretch| stretch.trace).collect();
    of.dedup();
    Some(Material {
        samples: chosen.iter().flat_map(samples).collect(),
        trials: of.len(),
    })
}

/// First samples of the stretches of a trial that are clean and not quiet, and do not overlap.
fn clean(trace: &Trace) -> impl Iterator<Item = usize> {
    let mut start = 0;
    std::iter::from_fn(move || {
        while start + STRETCH_SAMPLES <= trace.residual.len() {
            let stretch = start..start + STRETCH_SAMPLES;
            let flaw = trace
                .flaws
                .iter()
                .find(|flaw| flaw.start < stretch.end && stretch.start < flaw.end);
            let is_loud = mean_square(&trace.residual[stretch.clone()]) > QUIET;
            start = flaw.map_or(stretch.end, |flaw| flaw.end.max(start + 1));
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
    use crate::fit::excitation::evidence::Judged;

    fn trace(samples: usize) -> Trace {
        // Each sample tells its place.
        Trace {
            at: (0, 0),
            residual: (0..samples).map(|n| 1.0 + n as f64 / 1e6).collect(),
            flaws: Vec::new(),
            judged: Judged::default(),
        }
    }

    #[test]
    fn flaws_and_quiet_stretches_are_not_taken() {
        let mut one = trace(12_000);
        one.flaws = vec![2500..2600, 2550..2580];
        one.residual[5000..6500].iter_mut().for_each(|x| *x *= 0.1);
        let material = choose(&[&one], false, MOST_STRETCHES).unwrap();
        assert_eq!((material.samples.len(), material.trials), (10_000, 1));
        for x in &material.samples {
            let place = ((x - 1.0) * 1e6).round();
            assert!(!(2500.0..2600.0).contains(&place), "{place}");
        }
        let quiet = material.samples.iter().filter(|&&x| x < 0.5).count();
        assert!(quiet <= 900, "half of a stretch at most: {quiet}");
        one.flaws = std::iter::once(0..8500).collect();
        assert_eq!(
            choose(&[&one], false, MOST_STRETCHES),
            None,
            "0.7 s are too little"
        );
        assert_eq!(choose(&[], true, MOST_STRETCHES), None);
        assert_eq!(
            choose(&[&trace(STRETCH_SAMPLES - 1)], true, MOST_STRETCHES),
            None
        );
    }

    #[test]
    fn calm_and_lively_stretches_have_the_share_that_they_have_in_the_recordings() {
        let mut one = trace(40_000);
        for n in (0..10_000).step_by(KURTOSIS_SAMPLES) {
            one.residual[n] = 20.0;
        }
        let material = choose(&[&one], false, 8).unwrap();
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
            let levels = samples
                .chunks_exact(250)
                .map(|w| 10.0 * mean_square(w).log10());
            levels.clone().fold(f64::MIN, f64::max) - levels.fold(f64::MAX, f64::min)
        };
        let [with, without] = [true, false].map(|apart| choose(&[&one], apart, 10).unwrap());
        assert!(level_db(&without.samples) > 8.0);
        assert!(level_db(&with.samples) < 1.5, "{}", level_db(&with.samples));
    }
}
