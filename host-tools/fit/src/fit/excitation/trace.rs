//! The residual of one trial: computed with the model of its node, and tested.

use std::fmt;
use std::ops::Range;

use model_format::{CodeSpec, SAMPLE_RATE_HZ};
use stylus_dsp::high_pass::lowest_hz;
use stylus_dsp::linear_prediction::step_up;
use stylus_dsp::sums::{mean_square, sliding};
use stylus_signals::recording::triage::{Kind, Verdict};

use super::evidence::Evidence;
use super::known_band::{ENDS, filled};
use super::loudness::{Loudest, Ringing, product};
use crate::fit::blocks::Blocks;
use crate::fit::estimate::carried_hz;
use crate::fit::trial::Signal;
use crate::texture::quantise::stored_reflection;

/// Power of a residual relative to the signal's below which the residual is round-off.
const ROUND_OFF: f64 = 1e-12;

/// Longest part of a trial that is used, samples: a minute, twelve times the length of a codebook.
const LONGEST: usize = 60 * SAMPLE_RATE_HZ as usize;

/// Samples after a flaw in which the residual is not the surface's: 20 ms. The predictor's memory is longer, but weak.
const AFTER_FLAW: usize = 100;

/// Largest ratio of a residual's expected loudness at the output to its signal's. The expected power of impulses equals
/// their actual power; an excess smaller than this is chance.
const MOST: f64 = 1.3;

/// Ratio of a limited level to the level before, below which there is a note: 6 dB.
const EVENT: f64 = 0.5;

/// A moment of a trial whose residual was limited.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Event {
    /// Index of the sample in the signal.
    at: usize,
    /// Gain at that sample, the smallest of the trial.
    gain: f64,
}

impl Event {
    /// Returns by how much the level was lowered, dB.
    pub fn limited_db(&self) -> f64 {
        -20.0 * self.gain.log10()
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.0} dB of its residual at {:.2} s of what is fitted are in no codebook: they would sound \
             louder than the recording does there, as a click's or a slipped axis's would; look there, and record it \
             again if they are none of the surface's",
            self.limited_db(),
            self.at as f64 / f64::from(SAMPLE_RATE_HZ),
        )
    }
}

/// A trial's residual, and the result of the test on it.
#[derive(Clone, Debug, Default)]
pub(super) struct Trace {
    /// Indices of its speed and force on the grid.
    pub at: (usize, usize),
    /// Reflection coefficients of the node.
    pub reflection: Vec<f64>,
    /// Loudest windows of the signal.
    pub loudest: Loudest,
    /// The moment that was limited most, if it deserves a note.
    pub event: Option<Event>,
    /// Residual computed with the node's stored coefficients, limited to the loudness of the signal, with a mean square
    /// of 1.
    pub residual: Vec<f64>,
    /// Stretches of the residual that do not come from the surface.
    pub flaws: Vec<Range<usize>>,
    /// Number of the signal's samples.
    pub samples: usize,
    /// Order of the predictor: the residual begins at the signal's sample with this index.
    pub order: usize,
    /// Deviations of the output from Gaussian noise.
    pub evidence: Evidence,
}

impl Trace {
    /// Returns the trace of one of the `trials` of a texture, `at` a node with these `codes`. It is limited so that
    /// its loudest windows are at most [`MOST`] times as loud at the output as the signal's. `None` if its residual
    /// does not come from the surface according to one of its `verdicts`, or if the trial is too short, silent, or
    /// predicted down to its round-off.
    pub fn of(
        signal: &Signal,
        at: (usize, usize),
        codes: &CodeSpec,
        verdicts: &[Verdict],
        trials: usize,
    ) -> Option<Self> {
        if !verdicts.iter().all(leaves_the_residual) {
            return None;
        }
        let samples = &signal.samples[..signal.samples.len().min(LONGEST)];
        let reflection = stored_reflection(codes);
        let predictor = step_up(&reflection);
        let order = predictor.len();
        let mut residual = residual(samples, &predictor);
        // Index 0 of the residual is sample `order` of the signal.
        let moved =
            |flaw: &Range<usize>| flaw.start.saturating_sub(order)..(flaw.end + AFTER_FLAW).saturating_sub(order);
        let mut flaws: Vec<Range<usize>> = signal.flaws.iter().map(moved).collect();
        let length = residual.len();
        let carried_hz = carried_hz(signal.source_rate_hz).filter(|_| length > 2 * ENDS);
        if carried_hz.is_some() {
            flaws.insert(0, 0..ENDS);
            flaws.push(length - ENDS..length);
        }
        let known_hz = signal.cut_hz.map_or(0.0, lowest_hz)..carried_hz.unwrap_or(f64::INFINITY);
        if carried_hz.is_some() || signal.cut_hz.is_some() {
            residual = filled(&residual, &known_hz);
        }
        let loudest = Loudest::of(samples, &signal.flaws);
        let most = loudest.times(MOST);
        let gains = Ringing::of(&reflection).limit(&residual, &flaws, most);
        if let Some(gains) = &gains {
            residual = product(&residual, gains);
        }
        let power = mean_square(&residual);
        if power.is_nan() || power <= ROUND_OFF * mean_square(samples) {
            return None;
        }
        let scale = 1.0 / power.sqrt();
        residual.iter_mut().for_each(|x| *x *= scale);
        let evidence = Evidence::of(&residual, &flaws, &reflection, &known_hz, trials);
        Some(Self {
            at,
            reflection,
            loudest,
            event: gains.and_then(|gains| event(&gains, order, &flaws)),
            residual,
            flaws,
            // Of the whole signal, because the fit divides that into blocks.
            samples: signal.samples.len(),
            order,
            evidence,
        })
    }

    /// Returns the trace of the fitted blocks alone, with the findings on the whole; `None` if it has no power.
    pub fn fitted(&self) -> Option<Self> {
        let (mut residual, mut flaws) = (Vec::new(), Vec::new());
        // Of each block, the part of the residual that depends only on samples of the block.
        let inside = |block: Range<usize>| block.start..block.end.saturating_sub(self.order).min(self.residual.len());
        for block in Blocks::of(self.samples)
            .fitted()
            .map(inside)
            .filter(|block| !block.is_empty())
        {
            // A flaw that reaches beyond the block ends with it.
            let moved = |at: usize| residual.len() + at.clamp(block.start, block.end) - block.start;
            let own = self.flaws.iter().map(|flaw| moved(flaw.start)..moved(flaw.end));
            flaws.extend(own.filter(|flaw| !flaw.is_empty()));
            residual.extend_from_slice(&self.residual[block]);
        }
        // All that is made of traces expects a mean square of 1.
        let scale = 1.0 / mean_square(&residual).sqrt();
        residual.iter_mut().for_each(|x| *x *= scale);
        scale.is_normal().then(|| Self {
            residual,
            flaws,
            ..self.clone()
        })
    }
}

/// Returns the residual of `signal`, from the first sample that has enough samples before it for the predictor. It is
/// empty if the signal is not longer than the predictor.
fn residual(signal: &[f64], predictor: &[f64]) -> Vec<f64> {
    let predicted_from = signal.get(..signal.len().max(1) - 1).unwrap_or_default();
    let newest_last: Vec<f64> = predictor.iter().rev().copied().collect();
    let predicted = sliding(predicted_from, &newest_last);
    signal
        .iter()
        .skip(predictor.len())
        .zip(predicted)
        .map(|(now, sum)| now + sum)
        .collect()
}

/// Returns the moment outside `flaws` at which `gains` limit the residual most; `order` is that of its predictor.
fn event(gains: &[f64], order: usize, flaws: &[Range<usize>]) -> Option<Event> {
    let clean = (0..gains.len()).filter(|n| !flaws.iter().any(|flaw| flaw.contains(n)));
    let least = clean.min_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
    let (at, gain) = (least + order, gains[least]);
    (gain < EVENT).then_some(Event { at, gain })
}

/// Returns whether the residual of a trial with this verdict comes from the surface, apart from the verdict's spans and
/// from clipped peaks. That of a silent trial, a copy, or one with a converter's visible steps does not. Values that
/// were repeated are read once each, at their own rate.
fn leaves_the_residual(verdict: &Verdict) -> bool {
    !matches!(verdict.kind(), Kind::Silent | Kind::Coarse | Kind::Duplicate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::grid::Grid;
    use crate::texture::quantise::nodes;

    /// The residual of a model's output for an excitation is that excitation.
    #[test]
    fn the_residual_of_a_synthesis_is_its_excitation() {
        let model = stylus_dsp::model::Model::new(vec![-0.7, 0.5, -0.3], 1.0);
        let grid = Grid::new(vec![100.0], vec![1.0], vec![model]);
        let node = nodes("test", &grid).unwrap().remove(0);
        let a = step_up(&stored_reflection(&node.codes));
        let excitation: Vec<f64> = (0..200u32).map(|n| f64::from(n * n % 31) - 15.0).collect();
        let mut signal: Vec<f64> = Vec::new();
        for (n, e) in excitation.iter().enumerate() {
            let predicted: f64 = a
                .iter()
                .enumerate()
                .filter(|(i, _)| *i < n)
                .map(|(i, a)| -a * signal[n - 1 - i])
                .sum();
            signal.push(e + predicted);
        }
        let found = residual(&signal, &a);
        assert_eq!(found.len(), 197);
        for (found, e) in found.iter().zip(&excitation[3..]) {
            assert!((found - e).abs() < 1e-9);
        }
        assert_eq!(residual(&[1.0, 2.0], &[0.5, 0.5]), Vec::<f64>::new());
        assert_eq!(residual(&[1.0, 2.0], &[]), [1.0, 2.0]);
    }

    /// The value of each sample encodes its position.
    #[test]
    fn the_fitted_blocks_hold_no_sample_that_judges() {
        let signal: Vec<f64> = (0..20_000).map(|n| 1.0 + f64::from(n) / 1e5).collect();
        let whole = Trace {
            residual: signal[40..].to_vec(),
            flaws: vec![100..300, 3000..6000],
            samples: signal.len(),
            order: 40,
            ..Trace::default()
        };
        let made = whole.fitted().unwrap();
        let scale = whole.residual[0] / made.residual[0];
        for x in &made.residual {
            let n = ((x * scale - 1.0) * 1e5).round() as usize;
            // The predictor looks back 40 samples.
            let is_within = |block: Range<usize>| block.start + 40 <= n && n < block.end;
            assert!(Blocks::of(20_000).fitted().any(is_within), "{n}");
        }
        assert_eq!(made.residual.len(), 2 * (5000 - 40));
        assert_eq!(made.flaws, [100..300, 3000..4960]);
    }
}
