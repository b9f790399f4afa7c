//! Bursts of corrupted samples on one axis, for example because a sensor's queue slipped or a cable was knocked.
//!
//! Bursts are hidden below the peaks of a recording, but a linear predictor of the axis reveals them. A contact also
//! excites the other axes, rings through the filter that the predictor models, and occurs again. A burst does none of
//! this: the other axes stay calm; the surroundings are as predictable as usual when its samples are left out; and its
//! samples are white.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use stylus_dsp::linear_prediction::{Prediction, corrected, step_up};
use stylus_dsp::sums::{dot, energy, mean, sliding, upper_median};

use super::Axis;

/// Order of the predictor.
const ORDER: usize = 16;

/// Number of samples over which the energy of the prediction error is summed.
const WINDOW: usize = 8;

/// Shortest burst, samples. Fewer corrupted samples are spikes.
const SHORTEST: usize = 4;

/// Longest burst, samples.
const LONGEST: usize = 25;

/// Largest number of bursts on an axis.
const MOST: usize = 10;

/// Number of samples per block; only the highest energy in a block is a candidate.
const BLOCK: usize = 64;

/// Ratio to the median above which a window's energy is an event. Gaussian noise exceeds this ratio once in two million
/// windows.
const EVENT: f64 = 6.0;

/// Number of samples on either side that ring in a contact, and their least mean power in this case, relative to the
/// power of the axis about its mean.
const SHOULDER: usize = 32;
const LOUD_SHOULDER: f64 = 9.0;

/// Largest distance from one large error of a burst to the next, samples.
const PAUSE: usize = 6;

/// Number of errors on either side of a window among which a burst in it is looked at. They are computed anew for it,
/// because few windows need them, and those of whole axes take much memory. A burst, its pauses and the predictor reach
/// less far.
const AROUND: usize = 3 * LONGEST + PAUSE + ORDER;

/// Least ratio of a burst's energy to that of the next event, and least product of this ratio and [`Left::whiteness`].
#[derive(Clone, Copy)]
struct Bounds {
    ratio: f64,
    evidence: f64,
}

/// Bounds if other axes are witnesses. The evidence for natural events of four samples or more stays below 3 in 500
/// simulated trials and in one real recording. For shorter events it reaches 6.
const WITNESSED: Bounds = Bounds {
    ratio: 6.0,
    evidence: 12.0,
};

/// Bounds for an axis without witnesses. The evidence for natural events stays below 6 in 24 real takes, except in one
/// take that begins with a cut (43).
const ALONE: Bounds = Bounds {
    ratio: 10.0,
    evidence: 50.0,
};

/// Least RMS of a witness, as a fraction of the axis's RMS, because the noise of a dead axis is not evidence.
const WITNESS_SHARE: f64 = 0.03;

/// Corrupted samples on one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Burst {
    /// Number of the axis, from one.
    pub axis: usize,
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub seconds: f64,
    /// Ratio of the burst's prediction error to the largest elsewhere on the axis where no other axis has an event,
    /// both as RMS over 8 samples.
    pub ratio: f64,
}

/// Returns the bursts of all `axes`, in the order of the axes.
pub(super) fn bursts(axes: &[Axis<'_>], rate_hz: f64) -> Vec<Burst> {
    let errors: Vec<Option<Errors<'_>>> = axes.iter().map(Errors::of).collect();
    let events: Vec<Vec<bool>> = errors
        .iter()
        .map(|own| own.as_ref().map_or_else(Vec::new, Errors::near_events))
        .collect();
    let mut found = Vec::new();
    for (index, own) in errors.iter().enumerate() {
        let Some(own) = own else { continue };
        let least = WITNESS_SHARE * axes[index].deviation;
        let witnesses: Vec<&[bool]> = (0..axes.len())
            .filter(|&other| other != index && axes[other].deviation > least)
            .map(|other| events[other].as_slice())
            .filter(|events| !events.is_empty())
            .collect();
        let bounds = if witnesses.is_empty() { ALONE } else { WITNESSED };
        let (peaks, rest) = own.standing_out(&witnesses, bounds.ratio);
        let spans = peaks.iter().filter_map(|&(at, energy)| {
            let left = own.left_out(at, rest)?;
            let ratio = energy / rest;
            (ratio * left.whiteness >= bounds.evidence).then_some((left, ratio))
        });
        found.extend(spans.map(|(left, ratio)| Burst {
            axis: index + 1,
            start_s: left.first as f64 / rate_hz,
            seconds: left.count as f64 / rate_hz,
            ratio: ratio.sqrt(),
        }));
    }
    found
}

/// Samples that are left out, so that the remaining samples are as predictable as elsewhere.
struct Left {
    /// Index of the first sample that is left out.
    first: usize,
    /// Number of samples that are left out.
    count: usize,
    /// Ratio of the energy of the prediction error to the mean energy that white samples of the same magnitude would
    /// cause.
    whiteness: f64,
}

/// The prediction errors of an axis.
struct Errors<'a> {
    axis: &'a Axis<'a>,
    /// Mean of the axis. An offset, such as gravity, would otherwise be most of what is predicted.
    middle: f64,
    /// Coefficients of the predictor: 1, a(1) .. a(p).
    predictor: Vec<f64>,
    /// Energy of the errors in the window that begins at each sample.
    energy: Vec<f64>,
    /// Median of the energy.
    median: f64,
}

impl<'a> Errors<'a> {
    /// Returns the errors of `axis`; `None` if it is constant or too short.
    fn of(axis: &'a Axis<'a>) -> Option<Self> {
        let samples = axis.samples;
        if axis.deviation <= 0.0 || samples.len() < 10 * BLOCK {
            return None;
        }
        let middle = mean(samples);
        let centred: Vec<f64> = samples.iter().map(|x| x - middle).collect();
        let lag = |lag: usize| dot(&centred[lag..], &centred) / centred.len() as f64;
        let lags = corrected((0..=ORDER).map(lag).collect());
        let mut predictor = vec![1.0];
        predictor.extend(step_up(&Prediction::levinson_durbin(&lags, ORDER).reflection));
        let backward: Vec<f64> = predictor.iter().rev().copied().collect();
        let mut squares = sliding(&centred, &backward);
        drop(centred);
        squares.iter_mut().for_each(|error| *error *= *error);
        let energy = sliding(&squares, &[1.0; WINDOW]);
        drop(squares);
        let median = upper_median(&energy)?;
        // If most windows are predicted exactly, nothing can be compared with them.
        (median > 0.0).then_some(Self {
            axis,
            middle,
            predictor,
            energy,
            median,
        })
    }

    /// Order of the predictor.
    fn order(&self) -> usize {
        self.predictor.len() - 1
    }

    /// Returns the prediction errors in this range, of which the first is that of the p-th sample.
    fn of_samples(&self, range: Range<usize>) -> Vec<f64> {
        let samples = &self.axis.samples[range.start..range.end + self.order()];
        let centred: Vec<f64> = samples.iter().map(|x| x - self.middle).collect();
        let backward: Vec<f64> = self.predictor.iter().rev().copied().collect();
        sliding(&centred, &backward)
    }

    /// Returns, for each window, true if an event is near.
    fn near_events(&self) -> Vec<bool> {
        let mut near = vec![false; self.energy.len()];
        let end = near.len();
        for (at, energy) in self.energy.iter().enumerate() {
            if *energy > EVENT * self.median {
                near[at.saturating_sub(WINDOW)..(at + WINDOW + 1).min(end)].fill(true);
            }
        }
        near
    }

    /// Returns the windows without an event of a witness whose energy exceeds that of all other such windows by
    /// `ratio`, with their energies, and the largest energy of the others.
    fn standing_out(&self, witnesses: &[&[bool]], ratio: f64) -> (Vec<(usize, f64)>, f64) {
        let is_lone = |at: usize| !witnesses.iter().any(|events| events.get(at) == Some(&true));
        let mut blocks: Vec<(usize, f64)> = self
            .energy
            .chunks(BLOCK)
            .zip((0..).step_by(BLOCK))
            .map(|(block, first)| {
                (first..)
                    .zip(block)
                    .filter(|(at, _)| is_lone(*at))
                    .fold(
                        (first, 0.0),
                        |most, (at, &energy)| {
                            if energy > most.1 { (at, energy) } else { most }
                        },
                    )
            })
            .collect();
        // The ends have no surroundings by which they could be judged.
        let last = blocks.len() - 1;
        for end in [0, last - 1, last] {
            blocks[end].1 = 0.0;
        }
        let mut strongest: Vec<(usize, f64)> = Vec::with_capacity(MOST + 1);
        // One more than may be bursts, as the next event of the last burst.
        for _ in 0..=MOST {
            let largest = (0..blocks.len()).max_by(|&a, &b| blocks[a].1.total_cmp(&blocks[b].1));
            let Some(largest) = largest else { break };
            strongest.push(blocks[largest]);
            let near = largest.saturating_sub(1)..=(largest + 1).min(last);
            blocks[near].iter_mut().for_each(|block| block.1 = 0.0);
        }
        // If the axis rarely has events without a witness, these few show nothing.
        let rest = |count: usize| strongest[count].1.max(EVENT * self.median);
        let stands_out = |&count: &usize| strongest[count - 1].1 >= ratio * rest(count);
        // The largest number comes first, so that bursts of equal strength do not hide each other.
        let count = (1..strongest.len()).rev().find(stands_out).unwrap_or(0);
        let rest = rest(count);
        strongest.truncate(count);
        (strongest, rest)
    }

    /// Returns the samples that must be left out around the window `at` so that no energy is above `rest`; `None` if
    /// they are too few or too many for a burst, or if their surroundings are loud.
    fn left_out(&self, at: usize, rest: f64) -> Option<Left> {
        let begin = at.saturating_sub(AROUND);
        let end = (at + WINDOW + AROUND).min(self.axis.samples.len() - self.order());
        let errors = self.of_samples(begin..end);
        let at = at - begin;
        // Two such errors in a window would exceed `rest`.
        let is_large = |index: &usize| 2.0 * errors[*index] * errors[*index] > rest;
        let largest = (at..at + WINDOW).max_by(|&a, &b| errors[a].abs().total_cmp(&errors[b].abs()))?;
        let (mut first, mut last) = (largest, largest);
        while let Some(before) = (first.saturating_sub(PAUSE)..first).find(is_large) {
            first = before;
            // The errors of the longest burst last for LONGEST + ORDER samples, which is less.
            if last - first > 2 * LONGEST {
                return None;
            }
        }
        while let Some(after) = (last + 1..(last + 1 + PAUSE).min(errors.len())).rev().find(is_large) {
            last = after;
            if last - first > 2 * LONGEST {
                return None;
            }
        }
        // An error lasts as long as the burst is within the reach of the predictor.
        let least = (last + 1 - first).saturating_sub(self.order()).max(1);
        let (count, whiteness) =
            (least..=LONGEST).find_map(|count| Some((count, self.whiteness(&errors, first, count, rest)?)))?;
        let left = Left {
            first: begin + first + self.order(),
            count,
            whiteness,
        };
        (count >= SHORTEST && self.is_calm_around(&left)).then_some(left)
    }

    /// Returns the whiteness of `count` samples that cause `errors` from the index `first` on; `None` if an energy is
    /// still above `rest` without these samples.
    ///
    /// When they are left out, the errors become e - a∗d, where d, the deviation of the samples, is chosen for the
    /// least energy (Janssen, Veldhuis, Vries, IEEE ASSP 34, 1986). White d have on average the energy Σa² Σd².
    fn whiteness(&self, errors: &[f64], first: usize, count: usize, rest: f64) -> Option<f64> {
        let (a, p) = (&self.predictor, self.order());
        let errors = errors.get(first..first + count + p)?;
        // Beyond the predictor's order, its correlation is zero.
        let lag = |lag: usize| dot(&a[lag.min(p + 1)..], a);
        let lags: Vec<f64> = (0..count).map(lag).collect();
        let normal = DMatrix::from_fn(count, count, |row, column| lags[row.abs_diff(column)]);
        let right = DVector::from_iterator(count, (0..count).map(|at| dot(a, &errors[at..])));
        let wrong = normal.cholesky()?.solve(&right);
        let mut padded = vec![0.0; count + 2 * p];
        padded[p..p + count].copy_from_slice(wrong.as_slice());
        let backward: Vec<f64> = a.iter().rev().copied().collect();
        let explained = sliding(&padded, &backward);
        let left: Vec<f64> = errors.iter().zip(explained).map(|(e, d)| (e - d) * (e - d)).collect();
        left.windows(WINDOW)
            .all(|window| window.iter().sum::<f64>() <= rest)
            .then(|| energy(errors) / (energy(a) * wrong.norm_squared()))
    }

    /// Returns whether the samples on either side are not loud.
    fn is_calm_around(&self, left: &Left) -> bool {
        let (samples, middle) = (self.axis.samples, self.middle);
        let (before, after) = (left.first, left.first + left.count);
        let sides = [
            &samples[before.saturating_sub(SHOULDER)..before],
            &samples[after..(after + SHOULDER).min(samples.len())],
        ];
        let loudest = LOUD_SHOULDER * self.axis.deviation.powi(2);
        sides.into_iter().all(|side| {
            let power: f64 = side.iter().map(|x| (x - middle) * (x - middle)).sum();
            power <= loudest * side.len() as f64
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::defects::Defects;
    use rand::{RngExt, SeedableRng};
    use test_helpers::noise;

    const RATE_HZ: f64 = 5000.0;

    /// `excitation` through a low-pass at 280 Hz and a resonance at 265 Hz.
    fn ringing(excitation: &[f64]) -> Vec<f64> {
        let (mut low, mut state) = (0.0, (0.0, 0.0));
        excitation
            .iter()
            .map(|e| {
                low = 0.7 * low + e;
                state = (low + 1.8 * state.0 - 0.91 * state.1, state.0);
                state.0
            })
            .collect()
    }

    /// Noise on three axes, each weaker than the previous one.
    fn texture(seed: u64) -> [Vec<f64>; 3] {
        [1.0, 0.4, 0.2].map(|gain| {
            let seed = 3 * seed + (10.0 * gain) as u64;
            let excitation: Vec<f64> = noise(seed, 10_000).iter().map(|e| gain * e).collect();
            ringing(&excitation)
        })
    }

    /// Corrupts `count` samples from `at` on: uniform random values of up to `strength` times the RMS.
    fn make_wild(axis: &mut [f64], at: usize, count: usize, strength: f64) {
        let most = strength * (energy(axis) / axis.len() as f64).sqrt();
        let mut random = rand_pcg::Pcg64::seed_from_u64(at as u64);
        axis[at..at + count].fill_with(|| random.random_range(-most..most));
    }

    fn found(axes: &[Vec<f64>]) -> Vec<Burst> {
        Defects::of(axes, RATE_HZ).bursts
    }

    /// Returns whether `burst`, with a margin of 8 samples, covers the `count` samples from `at` on.
    fn covers(burst: &Burst, at: usize, count: usize) -> bool {
        let first = (burst.start_s * RATE_HZ).round() as usize;
        let end = first + (burst.seconds * RATE_HZ).round() as usize;
        first <= at + 8 && at <= first + 8 && at + count <= end + 8
    }

    #[test]
    fn bursts_of_any_length_strength_and_axis_are_found_where_they_are_and_nowhere_else() {
        let (mut all, mut right) = (0, 0);
        for seed in 0..4 {
            let clean = texture(seed);
            assert_eq!(found(&clean), []);
            for (number, count) in [5, 8, 12, 18, 25].into_iter().enumerate() {
                for strength in [3.0, 10.0, 39.0] {
                    for axis in 0..3 {
                        let at = 1000 + 1777 * number + 97 * axis + 13 * seed as usize;
                        let mut axes = clean.clone();
                        make_wild(&mut axes[axis], at, count, strength);
                        let defects = Defects::of(&axes, RATE_HZ);
                        let is_right = |b: &Burst| b.axis == axis + 1 && covers(b, at, count);
                        assert!(defects.bursts.iter().all(is_right), "{:?}", defects.bursts);
                        all += 1;
                        right += usize::from(!defects.bursts.is_empty() || !defects.spikes.is_empty());
                    }
                }
            }
        }
        assert!(20 * right >= 19 * all, "{right} of {all}");
    }

    #[test]
    fn on_an_axis_alone_strong_bursts_are_found_also_if_there_are_several() {
        let [mut axis, ..] = texture(7);
        for at in [1500, 4000, 8200] {
            make_wild(&mut axis, at, 15, 12.0);
        }
        let found = found(&[axis]);
        assert_eq!(found.len(), 3, "{found:?}");
    }

    #[test]
    fn events_that_ring_or_that_all_axes_have_are_none() {
        for strength in [5.0, 50.0, 500.0] {
            let mut excitation = noise(5, 10_000);
            excitation[5000] += strength;
            assert_eq!(found(&[ringing(&excitation)]), [], "{strength}");
            let [x, y, z] = texture(6);
            assert_eq!(found(&[ringing(&excitation), y.clone(), z]), [], "{strength}");
            let click = |axis: &[f64]| {
                let mut axis = axis.to_vec();
                for n in 0..25 {
                    let ring = (-0.2 * n as f64).exp() * (1.9 * n as f64).sin();
                    axis[5000 + n] += strength * ring;
                }
                axis
            };
            assert_eq!(found(&[click(&x), click(&y)]), [], "{strength}");
        }
        // With heavy tails, every sample is an event.
        for seed in 0..8 {
            let cubes: Vec<f64> = noise(seed, 20_000).iter().map(|e| e.powi(3)).collect();
            assert_eq!(found(&[ringing(&cubes)]), []);
            assert_eq!(found(&[cubes]), []);
        }
    }

    #[test]
    fn what_is_found_as_something_else_is_no_burst() {
        let [clean, other, _] = texture(8);
        let mut stuck = clean.clone();
        let value = stuck[3000] + 3.0;
        stuck[3000..3020].fill(value);
        let mut spiky = clean;
        spiky[3000] += 500.0;
        for axis in [stuck, spiky] {
            let defects = Defects::of(&[axis, other.clone()], RATE_HZ);
            assert_eq!(defects.bursts, []);
            assert_eq!(defects.holds.len() + defects.spikes.len(), 1);
        }
        assert_eq!(found(&[vec![0.0; 10_000], other]), []);
        assert_eq!(found(&[vec![1.0; 3]]), []);
    }
}
