//! A set that is prepared for the removed-node test: its models and its signals.

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::model::Model;
use stylus_fit::fit::blocks::Part;
use stylus_fit::fit::lines::Lines;
use stylus_fit::fit::{self, FittedTexture, Recorded};
use stylus_fit::texture::grid::{Grid, is_recorded};
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::{Error, Result};

use crate::perception::ScoringRange;

use super::Options;

/// A set that is prepared for the test: its models and its signals.
pub struct Prepared<'a> {
    pub(super) set: &'a RecordingSet,
    pub(super) signals: Vec<Vec<f64>>,
    /// Frequencies at which each trial can be judged.
    pub(super) ranges: Vec<Option<ScoringRange>>,
    pub(super) textures: Vec<PreparedTexture>,
    pub(super) simulated: bool,
}

pub(super) struct PreparedTexture {
    pub(super) name: String,
    pub(super) grid: Grid,
}

/// A node to be removed: the trial it is compared with, its texture and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Target {
    pub(super) trial: usize,
    pub(super) texture: usize,
    pub(super) place: (usize, usize),
}

/// Frequencies at which the trial `own` can be judged, if any.
fn scoring_range(own: &Recorded<'_>) -> Option<ScoringRange> {
    // A file of a higher rate is judged in the models' band only.
    let rate_hz = own.analysis.source_rate_hz.min(f64::from(SAMPLE_RATE_HZ));
    ScoringRange::of_filtered(rate_hz, own.samples().len(), own.analysis.slow.cut_hz)
}

impl<'a> Prepared<'a> {
    /// Reads and fits `set`.
    ///
    /// # Errors
    /// An error of [`fit::fit`], or a set without any inner node.
    pub fn new(set: &'a RecordingSet, options: &Options) -> Result<Self> {
        let fit_options = fit::Options {
            order: options.order,
            conditioning: options.judging.conditioning,
            // A removed node is predicted as a whole, the lines of its surface included.
            lines: Lines::None,
            ..fit::Options::default()
        };
        let recordings = fit::read(set, &fit_options, Part::Whole, usize::MAX, &|_| ())?;
        let fit = fit::models(set, &recordings, &fit_options)?;
        let prepared = |texture: FittedTexture| PreparedTexture {
            name: texture.name,
            grid: texture.grid,
        };
        let textures = fit.textures.into_iter().map(prepared).collect();
        let mut trials: Vec<Recorded<'_>> = recordings.into_iter().flat_map(|own| own.trials).collect();
        // Recordings were read texture by texture. Targets find them by their places in the set.
        trials.sort_by_key(|own| own.number);
        let ranges = trials.iter().map(scoring_range).collect();
        let signals = trials
            .into_iter()
            // Every signal is held, so that none is missing and each keeps its trial's index.
            .filter_map(|own| Some(own.signal?.samples))
            .collect();
        let prepared = Self {
            set,
            signals,
            ranges,
            textures,
            simulated: set.is_simulated(),
        };
        if prepared.targets().is_empty() {
            return Err(Error::Request(
                "no node can be removed: a texture needs three speeds (or forces) in contact at least, so that one is \
                 between two others"
                    .into(),
            ));
        }
        Ok(prepared)
    }

    /// Returns the number of nodes that will be removed.
    pub fn count(&self) -> usize {
        self.targets().len()
    }

    pub(super) fn targets(&self) -> Vec<Target> {
        self.set
            .trials
            .iter()
            .enumerate()
            .filter_map(|(index, trial)| {
                let texture = self.textures.iter().position(|t| t.name == trial.texture)?;
                let place = self.textures[texture].place(trial)?;
                // A recording on which nothing can be judged is not used.
                self.ranges[index].as_ref()?;
                let neighbours = self.textures[texture].neighbours(place);
                (!neighbours.is_empty()).then_some(Target {
                    trial: index,
                    texture,
                    place,
                })
            })
            .collect()
    }
}

impl PreparedTexture {
    pub(super) fn model(&self, (speed, force): (usize, usize)) -> &Model {
        &self.grid.models[self.grid.index(speed, force)]
    }

    /// Returns the place of a trial's node, if it is an inner node.
    fn place(&self, trial: &Trial) -> Option<(usize, usize)> {
        let (speed, force) = self.at(trial)?;
        let is_inner = |axis: &[f32], index: usize| axis.len() <= 2 || (index > 0 && index + 1 < axis.len());
        let along_speed = is_inner(&self.grid.speeds_mm_s, speed);
        let along_force = is_inner(&self.grid.forces_n, force);
        (along_speed && along_force && self.sounds((speed, force))).then_some((speed, force))
    }

    /// Indices of a trial's speed and force on the grid.
    fn at(&self, trial: &Trial) -> Option<(usize, usize)> {
        let at = |axis: &[f32], value: f64| axis.iter().position(|&v| v == value as f32);
        Some((
            at(&self.grid.speeds_mm_s, trial.speed_mm_s)?,
            at(&self.grid.forces_n, trial.force_n)?,
        ))
    }

    /// Returns whether a node was recorded and is not silent.
    fn sounds(&self, place: (usize, usize)) -> bool {
        is_recorded(self.model(place).flags)
    }

    /// Returns the neighbours from which the node at `place` is predicted, with their weights.
    pub(super) fn neighbours(&self, (speed, force): (usize, usize)) -> Vec<(f64, &Model)> {
        let along_speed = self.pair(speed, &self.grid.speeds_mm_s, |at| (at, force));
        let along_force = self.pair(force, &self.grid.forces_n, |at| (speed, at));
        let pairs: Vec<[(f64, &Model); 2]> = along_speed.into_iter().chain(along_force).collect();
        let share = 1.0 / pairs.len().max(1) as f64;
        let neighbours = pairs.into_iter().flatten();
        neighbours.map(|(weight, model)| (share * weight, model)).collect()
    }

    /// Returns the nodes before and after `at` on an axis, if neither is silent.
    fn pair(&self, at: usize, axis: &[f32], place: impl Fn(usize) -> (usize, usize)) -> Option<[(f64, &Model); 2]> {
        let (before, after) = (at.checked_sub(1)?, at + 1);
        if after >= axis.len() || !self.sounds(place(before)) || !self.sounds(place(after)) {
            return None;
        }
        let share = f64::from((axis[at] - axis[before]) / (axis[after] - axis[before]));
        Some([
            (1.0 - share, self.model(place(before))),
            (share, self.model(place(after))),
        ])
    }
}
