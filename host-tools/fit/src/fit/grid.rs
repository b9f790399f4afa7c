//! A texture's grid from its trials: a model for each (speed, force) that was recorded, and models filled in for the
//! others.

use model_format::{FadeLaw, Laws, LevelLaw, NodeFlags, PartsSpec, limits};
use rayon::prelude::*;
use stylus_dsp::linear_prediction::{Prediction, corrected};
use stylus_dsp::model::Model;
use stylus_dsp::sums::upper_median;
use stylus_signals::recording::Trial;
use stylus_support::{Error, Result};

use super::estimate::{BandLevel, Bands, pooled_lags};
use super::lines::{Findings, LineMember, lines_on};
use super::options::{Options, Order};
use super::reports::TrialReport;
use super::trial::Analysis;
use crate::texture::grid::Grid;

/// Least distance of a model's third-octave band from the recording's for which there is a note, dB.
const NOTABLE_MISS_DB: f64 = 3.0;

/// Ratio of a trial's power to the median of its node's trials above which the trial's power is reduced to the median:
/// 6 dB. Otherwise this trial would dominate the mean.
const LOUD: f64 = 4.0;

/// Least number of trials of a node for which a loud trial can be recognised by the median.
const FEWEST_FOR_MEDIAN: usize = 3;

/// Least number of samples for each coefficient of a model.
const SAMPLES_PER_COEFFICIENT: usize = 4;

/// A trial that a texture is fitted to.
#[derive(Clone, Copy)]
pub(super) struct Member<'a> {
    pub trial: &'a Trial,
    pub analysis: &'a Analysis,
    pub report: &'a TrialReport,
}

/// The model of all trials of one node.
struct NodeFit {
    model: Model,
    miss: Option<BandLevel>,
    loud: Vec<LoudTrial>,
}

/// A trial that is far louder than the others of its node and is reduced to their level.
#[derive(Clone, Debug)]
pub(super) struct LoudTrial {
    /// The file.
    pub file: String,
    /// Level relative to the median of the node's trials, dB.
    pub over_db: f64,
}

/// A texture's grid, and what the notes report about it.
pub(super) struct AssembledGrid {
    pub grid: Grid,
    /// Nodes whose model misses a band of the recording.
    pub misses: Vec<Miss>,
    /// Trials that are louder than the others of their nodes.
    pub loud: Vec<LoudTrial>,
}

/// A third-octave band in which a node's model is far from its recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Miss {
    /// Speed of the node, mm/s.
    pub speed_mm_s: f32,
    /// Force of the node, N.
    pub force_n: f32,
    /// The band, with the model's level relative to the recording's.
    pub band: BandLevel,
}

/// Builds the grid of texture `name` from its trials, of which there is at least one, and its lines.
pub(super) fn assemble(
    name: &str,
    members: &[Member<'_>],
    findings: &Findings,
    options: &Options,
) -> Result<AssembledGrid> {
    let speeds_mm_s = axis(name, "speeds", members.iter().map(|m| m.trial.speed_mm_s))?;
    let forces_n = axis(name, "forces", members.iter().map(|m| m.trial.force_n))?;
    let mut cells: Vec<Vec<Member<'_>>> = vec![Vec::new(); speeds_mm_s.len() * forces_n.len()];
    for &member in members {
        let speed = place(&speeds_mm_s, member.trial.speed_mm_s);
        let force = place(&forces_n, member.trial.force_n);
        cells[speed * forces_n.len() + force].push(member);
    }
    let measured: Vec<Option<NodeFit>> = cells.par_iter().map(|cell| measured_model(cell, options)).collect();
    let miss = |(index, node): (usize, &Option<NodeFit>)| {
        Some(Miss {
            speed_mm_s: speeds_mm_s[index / forces_n.len()],
            force_n: forces_n[index % forces_n.len()],
            band: node.as_ref()?.miss?,
        })
    };
    let misses = measured.iter().enumerate().filter_map(miss).collect();
    let loud = measured.iter().flatten().flat_map(|node| node.loud.clone()).collect();
    let models = measured.into_iter().map(|node| Some(node?.model));
    let filler = Filler::of(speeds_mm_s.len(), forces_n.len(), models.collect());
    let models: Vec<Model> = (0..filler.known.len()).map(|index| filler.model(index)).collect();
    let mut grid = Grid {
        speeds_mm_s,
        forces_n,
        laws: laws_of(&models),
        parts: PartsSpec::default(),
        models,
    };
    let lines = members.iter().map(|member| LineMember {
        speed_mm_s: member.trial.speed_mm_s,
        force_n: member.trial.force_n,
        is_silent: member.analysis.is_silent(),
        lines: &member.analysis.lines,
    });
    grid.parts.lines = lines_on(&grid, findings, &lines.collect::<Vec<_>>());
    Ok(AssembledGrid { grid, misses, loud })
}

/// Returns the laws of the level for a texture with these models.
///
/// Between nodes, the mean of the level in dB predicts removed nodes best. This holds for simulated recordings (the
/// removed-node test in `host-tools/manual/COSTS.md`) and for 582 published HaTT models, each predicted from the
/// triangle around it: between neighbours that differ by 6 to 12 dB, the mean power is 0.9 dB too loud and the mean in
/// dB is 0.1 dB too low. A silent node has no level in dB, so a texture with one uses the mean amplitude.
///
/// Below the grid, power is proportional to speed and force. For 525 pairs of the same HaTT models, at one force and at
/// speeds with a ratio of 1.5 to 4, the mean deviation from this law is -0.3 dB, and that from proportional amplitude
/// is -3.5 dB.
fn laws_of(models: &[Model]) -> Laws {
    let level = if models.iter().any(Model::is_silent) {
        LevelLaw::Amplitude
    } else {
        LevelLaw::Logarithm
    };
    let fade = FadeLaw::Power;
    Laws { level, fade }
}

pub(super) fn axis(name: &str, what: &str, values: impl Iterator<Item = f64>) -> Result<Vec<f32>> {
    // A library stores axes in 32 bits. Values that are equal there are one node.
    let mut axis: Vec<f32> = values.map(|value| value as f32).collect();
    axis.sort_by(f32::total_cmp);
    axis.dedup();
    if axis.len() > limits::MAX_AXIS_LEN {
        return Err(Error::Model(format!(
            "texture '{name}' has {} different {what}; a grid holds {}: give nominal values, not measured ones",
            axis.len(),
            limits::MAX_AXIS_LEN
        )));
    }
    Ok(axis)
}

/// Returns the index of the first of an axis's ascending values that is not below `value`.
pub(super) fn place(axis: &[f32], value: f64) -> usize {
    axis.partition_point(|&v| v < value as f32)
}

/// Returns the model of all trials of a node; `None` if there is no trial.
fn measured_model(cell: &[Member<'_>], options: &Options) -> Option<NodeFit> {
    let doubtful = |member: &Member<'_>| !member.analysis.is_silent() && member.report.is_doubtful();
    // Silence is a finding, too, but leaves no doubt about the node.
    let mut flags = NodeFlags::NONE;
    if cell.iter().any(doubtful) {
        flags = flags.with(NodeFlags::DOUBTFUL);
    }
    let heard: Vec<&Member<'_>> = cell.iter().filter(|member| !member.analysis.is_silent()).collect();
    if cell.is_empty() {
        return None;
    }
    if heard.is_empty() {
        return Some(NodeFit {
            model: Model::silent(),
            miss: None,
            loud: Vec::new(),
        });
    }
    let samples: usize = heard.iter().map(|member| member.analysis.samples).sum();
    let shares = shares(&heard.iter().map(|m| m.analysis.lags[0]).collect::<Vec<_>>());
    let loud: Vec<LoudTrial> = heard
        .iter()
        .zip(&shares)
        .filter(|(_, share)| **share < 1.0)
        .map(|(member, share)| LoudTrial {
            file: member.report.file.clone(),
            over_db: -10.0 * share.log10(),
        })
        .collect();
    if !loud.is_empty() {
        flags = flags.with(NodeFlags::DOUBTFUL);
    }
    let weighted = || {
        heard.iter().zip(&shares).map(|(member, share)| {
            // Longer trials are known better.
            let weight = member.analysis.samples as f64 / samples as f64;
            (share * weight, member.analysis)
        })
    };
    let lags = pooled_lags(weighted().map(|(weight, trial)| (weight, &trial.lags[..])));
    let recorded = Bands::mean(weighted().map(|(weight, trial)| (weight, &trial.bands)));
    let model = Model {
        flags,
        ..model_of(lags, &recorded, samples, options.order)
    };
    let miss = recorded.missed_by(&model, samples, NOTABLE_MISS_DB);
    Some(NodeFit { model, miss, loud })
}

/// Returns the factor with which each power of a node's trials counts. It is 1, except for a trial that is far louder
/// than the median, which it reduces to the median.
fn shares(powers: &[f64]) -> Vec<f64> {
    let median = upper_median(powers).unwrap_or(0.0);
    let is_loud = |power: f64| powers.len() >= FEWEST_FOR_MEDIAN && power > LOUD * median;
    let share = |&power: &f64| if is_loud(power) { median / power } else { 1.0 };
    powers.iter().map(share).collect()
}

/// Returns the model of a recording of `samples` samples with these lags and bands. Its order is chosen by `choice`.
pub(super) fn model_of(lags: Vec<f64>, recorded: &Bands, samples: usize, choice: Order) -> Model {
    // The level is that of the recording, before the white-noise correction raises lag 0.
    let output_power = lags[0];
    let max_order = choice.highest().min(samples / SAMPLES_PER_COEFFICIENT);
    let mut prediction = Prediction::levinson_durbin(&corrected(lags), max_order);
    let order = match choice {
        Order::Auto => prediction.akaike_order(samples),
        Order::Bayesian => prediction.bayesian_order(samples),
        Order::Fixed(order) => order.min(prediction.max_order()),
    };
    prediction.reflection.truncate(order);
    let mut model = Model::new(prediction.reflection, output_power);
    if choice == Order::Auto {
        let order = recorded.sufficient_order(&model, samples);
        model.reflection.truncate(order);
    }
    model
}

/// Fills holes only from nodes that were measured, so that the order of filling does not matter.
struct Filler {
    /// Number of speeds of the grid.
    speeds: usize,
    /// Number of forces of the grid.
    forces: usize,
    /// Measured models, all forces of the first speed first; `None` for holes.
    known: Vec<Option<Model>>,
}

impl Filler {
    /// Returns the filler of a grid with these numbers of speeds and forces, and its measured models, all forces of the
    /// first speed first.
    fn of(speeds: usize, forces: usize, known: Vec<Option<Model>>) -> Self {
        let mut own = Self { speeds, forces, known };
        // Towards a silent node the spectral shape of its surroundings stays the same; only the level falls to zero.
        let shaped = |(index, model): (usize, &Option<Model>)| {
            let mut model = model.clone()?;
            if model.is_silent() {
                let nearest = own.nearest((index / forces, index % forces), |m| !m.is_silent());
                model.reflection = nearest.reflection;
            }
            Some(model)
        };
        own.known = own.known.iter().enumerate().map(shaped).collect();
        own
    }

    /// Returns the model at node `index`: the measured one, or one filled in.
    fn model(&self, index: usize) -> Model {
        let filled = || self.filled((index / self.forces, index % self.forces));
        self.known[index].clone().unwrap_or_else(filled)
    }

    fn filled(&self, at: (usize, usize)) -> Model {
        let lines = [self.along_speed(at), self.along_force(at)];
        let pairs: Vec<_> = lines.into_iter().flatten().collect();
        if pairs.is_empty() {
            let nearest = self.nearest(at, |_| true);
            let flags = nearest.flags.with(NodeFlags::EXTRAPOLATED);
            return Model { flags, ..nearest };
        }
        // The error of a straight line between two points is proportional to the product of the distances to them.
        let weight = |pair: &Bracket<'_>| 1.0 / (pair.before.0 * pair.after.0) as f64;
        let total: f64 = pairs.iter().map(weight).sum();
        let mut terms = Vec::new();
        for pair in &pairs {
            let share = weight(pair) / total;
            let (before, after) = (pair.before.0 as f64, pair.after.0 as f64);
            terms.push((share * after / (before + after), pair.before.1));
            terms.push((share * before / (before + after), pair.after.1));
        }
        let mean = Model::mean(&terms, LevelLaw::Logarithm);
        let flags = mean.flags.with(NodeFlags::INTERPOLATED);
        Model { flags, ..mean }
    }

    fn along_speed(&self, (speed, force): (usize, usize)) -> Option<Bracket<'_>> {
        self.bracket(speed, self.speeds, |s| s * self.forces + force)
    }

    fn along_force(&self, (speed, force): (usize, usize)) -> Option<Bracket<'_>> {
        self.bracket(force, self.forces, |f| speed * self.forces + f)
    }

    /// Returns the nearest measured nodes on both sides of `at` on a line of `length` nodes.
    fn bracket(&self, at: usize, length: usize, index: impl Fn(usize) -> usize) -> Option<Bracket<'_>> {
        let known = |position: usize| self.known[index(position)].as_ref();
        let before = (0..at).rev().find_map(|p| Some((at - p, known(p)?)))?;
        let after = (at + 1..length).find_map(|p| Some((p - at, known(p)?)))?;
        Some(Bracket { before, after })
    }

    /// Returns the mean of the nearest measured nodes among those that are `wanted`, by the Euclidean distance in
    /// nodes; silence if there are none.
    fn nearest(&self, (speed, force): (usize, usize), wanted: impl Fn(&Model) -> bool) -> Model {
        let distance = |index: usize| {
            let (s, f) = (index / self.forces, index % self.forces);
            s.abs_diff(speed).pow(2) + f.abs_diff(force).pow(2)
        };
        let candidates = || {
            self.known
                .iter()
                .enumerate()
                .filter_map(|(index, model)| Some((distance(index), model.as_ref()?)))
                .filter(|(_, model)| wanted(model))
        };
        let Some(least) = candidates().map(|(distance, _)| distance).min() else {
            return Model::silent();
        };
        // All nodes at this distance count, so that no direction is preferred.
        let nearest: Vec<&Model> = candidates()
            .filter(|&(distance, _)| distance == least)
            .map(|(_, model)| model)
            .collect();
        let weight = 1.0 / nearest.len() as f64;
        let terms: Vec<_> = nearest.into_iter().map(|model| (weight, model)).collect();
        Model::mean(&terms, LevelLaw::Logarithm)
    }
}

/// Measured nodes on both sides of a hole, each with its distance in nodes.
struct Bracket<'a> {
    before: (usize, &'a Model),
    after: (usize, &'a Model),
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    fn model(k: f64, power: f64) -> Model {
        Model::new(vec![k, -k / 2.0], power)
    }

    #[test]
    fn a_hole_between_two_nodes_is_their_mean_and_says_so() {
        let filler = Filler::of(3, 1, vec![Some(model(0.1, 1.0)), None, Some(model(0.5, 4.0))]);
        let filled = filler.model(1);
        let expected = f64::midpoint(0.1f64.asin(), 0.5f64.asin()).sin();
        near(filled.reflection[0], expected, 1e-12);
        near(filled.output_power, 2.0, 1e-12);
        assert_eq!(filled.flags, NodeFlags::INTERPOLATED);
    }

    #[test]
    fn beyond_the_last_node_the_nearest_is_taken_over_and_says_so() {
        let filler = Filler::of(1, 3, vec![Some(model(0.1, 1.0)), Some(model(0.5, 4.0)), None]);
        let filled = filler.model(2);
        near(filled.reflection[0], 0.5, 1e-12);
        assert_eq!(filled.flags, NodeFlags::EXTRAPOLATED);
    }

    #[test]
    fn a_silent_node_keeps_its_neighbours_timbre() {
        let filler = Filler::of(1, 2, vec![Some(Model::silent()), Some(model(0.5, 4.0))]);
        let silent = filler.model(0);
        assert!(silent.output_power.abs() <= 0.0 && silent.flags == NodeFlags::SILENT);
        near(silent.reflection[0], 0.5, 1e-12);
    }

    #[test]
    fn a_hole_beside_a_silent_node_has_half_the_power_and_the_timbre_of_the_other_neighbour() {
        let known = vec![Some(Model::silent()), None, Some(model(0.5, 4.0))];
        let filled = Filler::of(3, 1, known).model(1);
        near(filled.output_power, 2.0, 1e-12);
        near(filled.reflection[0], 0.5, 1e-12);
    }

    proptest! {
        #[test]
        fn one_loud_trial_of_several_moves_a_nodes_power_no_further_than_the_others_scatter(
            others in prop::collection::vec(0.5f64..1.5, 2..8),
            loud in 1e-3f64..1e6,
            at in 0usize..8,
        ) {
            let mut powers = others.clone();
            powers.insert(at.min(others.len()), loud);
            let counted: f64 = shares(&powers).iter().zip(&powers).map(|(share, power)| share * power).sum();
            prop_assert!(counted <= others.iter().sum::<f64>() + LOUD * 1.5);
            prop_assert!(shares(&others).iter().all(|share| *share >= 1.0));
            prop_assert_eq!(shares(&[1.0, loud]), [1.0, 1.0]);
        }

        #[test]
        fn every_filled_grid_is_whole_and_stable(
            known in prop::collection::vec(prop::option::of((-0.999f64..0.999, 0.0f64..10.0)), 24),
        ) {
            prop_assume!(known.iter().any(Option::is_some));
            let known: Vec<_> = known.into_iter().map(|node| node.map(|(k, power)| {
                if power < 1.0 { Model::silent() } else { model(k, power) }
            })).collect();
            let filler = Filler::of(6, 4, known.clone());
            for (index, known) in known.iter().enumerate() {
                let filled = filler.model(index);
                prop_assert!(filled.reflection.iter().all(|k| k.abs() < 1.0));
                prop_assert!(filled.output_power >= 0.0);
                prop_assert_eq!(filled.is_silent(), filled.output_power <= 0.0);
                if let Some(known) = known && !known.is_silent() {
                    prop_assert_eq!(&filled, known);
                }
            }
        }
    }
}
