//! The choice between recorded snippets (moments) and an excitation with a separate level, judged by blocks of the
//! residuals from which neither is made.
//!
//! Both excitations are made from every other block and played by the device's own feed. What is played is compared
//! with the other blocks by the levels of five octaves in windows of 50 ms, relative to the level of the window. The
//! reason is that a recording's spectrum changes with its level, which whitened pieces with a separate level do not
//! reproduce. The distance of two distributions is the mean distance of their quantiles, dB, averaged over the octaves.

use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

use model_format::{
    CodeSpec, ExcitationSpec, Library, MillimetresPerSecond, Newton, NodeSpec, PartsSpec, TextureSpec, encode,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use stylus_kernel::Motion;
use stylus_kernel::feed::{FED_FRACTION_BITS, Feed, Material};
use stylus_kernel::grid::GridPoint;

use super::evidence::LEVEL_SAMPLES;
use super::loudness::filtered;
use super::trace::Trace;
use crate::dsp::linear_prediction::{error_share, step_up};
use crate::dsp::sums::mean_square;

/// Least gain for which moments replace a track without a codebook, dB, because they take more bytes. Noise whose level
/// swells is by chance 0.2 dB away from its own synthesis. A codebook takes as many bytes as moments, so there the gain
/// may be any.
const LEAST_GAIN_DB: f64 = 0.25;

/// Samples that are played for a comparison by [`distance_db`]: 40 s. [`heard_db`] plays half of them.
const PLAYED: usize = 200_000;

/// Samples of a window in which the filtered output is compared: 20 ms.
const HEARD_SAMPLES: usize = 100;

/// Largest number of trials at whose nodes the filtered output is compared.
const HEARD: usize = 24;

/// Number of quantiles that are compared.
const QUANTILES: usize = 100;

/// Least power of a window, relative to the mean; lower ones count as this: -40 dB.
const LEAST_POWER: f64 = 1e-4;

/// Number of octaves, counted down from half the sample rate.
const OCTAVES: usize = 5;

/// Distances of two excitations from blocks from which neither is made, dB.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distances {
    /// Distance of moments, which keep their recorded level.
    pub moments_db: f64,
    /// Distance of an excitation with a separate level.
    pub apart_db: f64,
}

impl Distances {
    /// Returns whether moments are nearer by enough to be worth their bytes; `has_codebook` says whether they would
    /// replace a codebook.
    pub fn is_for_moments(&self, has_codebook: bool) -> bool {
        let least_db = if has_codebook { 0.0 } else { LEAST_GAIN_DB };
        self.moments_db + least_db < self.apart_db
    }
}

/// Returns the traces of the fitted blocks of `traces`, with the findings on the whole. Traces without power are left
/// out.
pub(super) fn fitted(traces: &[Trace]) -> Vec<Trace> {
    let half = |trace: &Trace| {
        let (mut residual, mut flaws) = (Vec::new(), Vec::new());
        for block in trace.inside(trace.blocks().fitted()) {
            // A flaw that reaches beyond the block ends with it.
            let moved = |at: usize| residual.len() + at.clamp(block.start, block.end) - block.start;
            let own = trace.flaws.iter().map(|flaw| moved(flaw.start)..moved(flaw.end));
            flaws.extend(own.filter(|flaw| !flaw.is_empty()));
            residual.extend_from_slice(&trace.residual[block]);
        }
        // All that is made of traces expects a mean square of 1.
        let scale = 1.0 / mean_square(&residual).sqrt();
        scale.is_normal().then(|| Trace {
            residual: residual.iter().map(|x| x * scale).collect(),
            flaws,
            ..trace.clone()
        })
    };
    traces.iter().filter_map(half).collect()
}

/// Returns the distance of the excitation of `parts` from the blocks of `traces` that were not fitted, dB; `forces` is
/// the number of forces of the grid. `None` if there is nothing to judge.
pub(super) fn distance_db(traces: &[Trace], forces: usize, parts: &PartsSpec) -> Option<f64> {
    let source = |trace: &Trace| source(trace, forces, parts);
    let mut sources: Vec<u8> = traces.iter().map(source).collect();
    sources.sort_unstable();
    sources.dedup();
    let (mut sum, mut count) = (0.0, 0.0);
    for number in sources {
        let own = traces.iter().filter(|trace| source(trace) == number);
        let judged = own.flat_map(|trace| {
            let blocks = trace.inside(trace.blocks().judged());
            let clean = blocks.filter(|block| trace.is_clean(block));
            clean.map(|block| &trace.residual[block])
        });
        let judged = Levels::of(judged);
        let windows = judged.0[0].len() as f64;
        if windows > 0.0 {
            let played = played(number, parts, PLAYED)?;
            sum += windows * judged.distance_db(&Levels::of(std::iter::once(&played[..])));
            count += windows;
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Returns the mean distance between the filtered excitation of `parts` and the filtered blocks of `traces` that were
/// not fitted, dB, at some nodes: that of the levels of octaves in windows of 20 ms. It shows where one node's residual
/// does not suit another node, which [`distance_db`] does not. `None` if there is nothing to judge.
pub(super) fn heard_db(traces: &[Trace], forces: usize, parts: &PartsSpec) -> Option<f64> {
    let mut sources: BTreeMap<u8, Vec<&Trace>> = BTreeMap::new();
    for trace in traces.iter().step_by(traces.len().div_ceil(HEARD).max(1)) {
        let source = source(trace, forces, parts);
        sources.entry(source).or_default().push(trace);
    }
    let of_source = |(number, own): (u8, Vec<&Trace>)| {
        let played = played(number, parts, PLAYED / 2)?;
        Some(
            own.into_iter()
                .filter_map(|trace| of_node(trace, &played))
                .collect::<Vec<f64>>(),
        )
    };
    let of_sources: Option<Vec<Vec<f64>>> = sources.into_par_iter().map(of_source).collect();
    let all = of_sources?.concat();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

/// Returns the distance between `played` and the trace's other blocks, both filtered by the trace's node, dB.
fn of_node(trace: &Trace, played: &[f64]) -> Option<f64> {
    let predictor = step_up(&trace.reflection);
    let scale = error_share(&trace.reflection).sqrt();
    let heard = |excitation: &[f64]| -> Vec<f64> {
        let signal = filtered(&excitation[..excitation.len() / 2 * 2], &predictor);
        signal.into_iter().map(|x| x * scale).collect()
    };
    let recorded = heard(&trace.residual);
    let blocks = trace.inside(trace.blocks().judged());
    // The filtered signal may lack the residual's last sample, because it has an even length.
    let blocks = blocks.filter(|block| trace.is_clean(block) && block.end <= recorded.len());
    let judged = Levels::heard(blocks.map(|block| &recorded[block]));
    let of_played = Levels::heard(std::iter::once(&heard(played)[..]));
    (!judged.0[0].is_empty()).then(|| judged.distance_db(&of_played))
}

/// Returns the number of the source of `parts` at the node of `trace`; 0 is Gaussian noise.
pub(super) fn source(trace: &Trace, forces: usize, parts: &PartsSpec) -> u8 {
    let node = trace.at.0 * forces + trace.at.1;
    (parts.excitation.as_ref()).map_or(0, |spec| spec.of_nodes[node])
}

/// Returns `samples` samples that the device's feed plays of the source `number` of `parts` at their level, standard
/// deviations.
pub(super) fn played(number: u8, parts: &PartsSpec, samples: usize) -> Option<Vec<f64>> {
    // Alone in a texture of one node, the source is all that the feed draws from.
    let codebook = parts.excitation.as_ref().zip(usize::from(number).checked_sub(1));
    let parts = PartsSpec {
        excitation: codebook.map(|(spec, index)| ExcitationSpec {
            codebooks: vec![spec.codebooks[index].clone()],
            of_nodes: vec![1],
            moment_samples: spec.moment_samples,
        }),
        modulation: parts.modulation.clone(),
        ..PartsSpec::default()
    };
    let node = NodeSpec::new(1.0, CodeSpec::lattice(Vec::new()));
    let spec = TextureSpec {
        parts,
        ..TextureSpec::new("excitation", &[1.0], &[1.0], vec![node])
    };
    let bytes = encode(&[spec]).ok()?;
    let library = Library::decode(&bytes).ok()?;
    let texture = library.textures().next()?;
    let motion = Motion::new(MillimetresPerSecond(1.0), Newton(1.0)).ok()?;
    let (material, point) = (Material::of(&texture), GridPoint::locate(&texture, motion));
    let mut feed = Feed::new(1);
    let unit = f64::from(1u32 << FED_FRACTION_BITS);
    let sample = || f64::from(feed.next_sample(&material, &point)) / unit;
    Some(std::iter::repeat_with(sample).take(samples).collect())
}

/// Levels of each octave in windows, dB, ascending.
struct Levels([Vec<f64>; OCTAVES]);

impl Levels {
    /// Measures in windows of 50 ms, relative to the levels of the windows.
    fn of<'a>(blocks: impl Iterator<Item = &'a [f64]>) -> Self {
        Self::against(blocks, LEVEL_SAMPLES, |level| level)
    }

    /// Measures in windows of 20 ms.
    fn heard<'a>(blocks: impl Iterator<Item = &'a [f64]>) -> Self {
        Self::against(blocks, HEARD_SAMPLES, |_| 0.0)
    }

    /// Measures in windows of `samples` samples, relative to `against` of the window's level.
    fn against<'a>(blocks: impl Iterator<Item = &'a [f64]>, samples: usize, against: impl Fn(f64) -> f64) -> Self {
        let db = |samples: &[f64]| 10.0 * mean_square(samples).max(LEAST_POWER).log10();
        let mut octaves = [const { Vec::new() }; OCTAVES];
        for window in blocks.flat_map(|block| block.chunks_exact(samples)) {
            let level = against(db(window));
            let mut below = window.to_vec();
            for octave in &mut octaves {
                // Haar's filters, which halve the rate.
                let pairs = below.as_chunks::<2>().0.iter();
                let (sums, differences): (Vec<f64>, Vec<f64>) =
                    pairs.map(|[a, b]| ((a + b) / SQRT_2, (a - b) / SQRT_2)).unzip();
                octave.push(db(&differences) - level);
                below = sums;
            }
        }
        for octave in &mut octaves {
            octave.sort_by(f64::total_cmp);
        }
        Self(octaves)
    }

    /// Returns the mean distance of the quantiles of all octaves, of which none may be empty.
    fn distance_db(&self, other: &Self) -> f64 {
        // The middles of equal ranges of ranks, so that the extremes, which are random, do not count.
        let quantile = |of: &[f64], n: usize| of[(2 * n + 1) * of.len() / (2 * QUANTILES)];
        let octave = |(a, b): (&Vec<f64>, &Vec<f64>)| -> f64 {
            let apart = |n| (quantile(a, n) - quantile(b, n)).abs();
            (0..QUANTILES).map(apart).sum()
        };
        let sum: f64 = self.0.iter().zip(&other.0).map(octave).sum();
        sum / (QUANTILES * OCTAVES) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::noise;

    fn trace(signal: &[f64]) -> Trace {
        Trace {
            residual: signal[40..].to_vec(),
            samples: signal.len(),
            order: 40,
            ..Trace::default()
        }
    }

    /// The value of each sample encodes its position.
    #[test]
    fn what_is_made_for_a_comparison_holds_no_sample_that_judges() {
        let signal: Vec<f64> = (0..20_000).map(|n| 1.0 + f64::from(n) / 1e5).collect();
        let whole = trace(&signal);
        let made = &fitted(&[Trace {
            flaws: vec![100..300, 3000..6000],
            ..whole.clone()
        }])[0];
        let scale = whole.residual[0] / made.residual[0];
        for x in &made.residual {
            let n = ((x * scale - 1.0) * 1e5).round() as usize;
            // The predictor looks back 40 samples.
            let is_within = |block: std::ops::Range<usize>| block.start + 40 <= n && n < block.end;
            assert!(whole.blocks().fitted().any(is_within), "{n}");
        }
        assert_eq!(made.residual.len(), 2 * (5000 - 40));
        assert_eq!(made.flaws, [100..300, 3000..4960]);
    }

    /// Noise whose spectrum tilts as its level swells, against white noise of the same levels.
    #[test]
    fn white_noise_is_near_to_white_noise_and_far_from_what_changes_its_colour() {
        let white = distance_db(&[trace(&noise(1, 60_000))], 1, &PartsSpec::default()).unwrap();
        let mut last = 0.0;
        let coloured = noise(2, 60_000).into_iter().enumerate().map(|(n, x)| {
            let tilt = (n as f64 / 1500.0).sin();
            let y = x + 0.9 * tilt * last;
            last = x;
            y / (1.0 + 0.81 * tilt * tilt).sqrt()
        });
        let coloured: Vec<f64> = coloured.collect();
        let far = distance_db(&[trace(&coloured)], 1, &PartsSpec::default()).unwrap();
        println!("{white:.2} dB, {far:.2} dB");
        assert!(white < 0.2 && far > 1.0, "{white} {far}");
        assert_eq!(distance_db(&[], 1, &PartsSpec::default()), None);
    }
}
