//! A set made ready for the removed-node test: its models, its signals and its spectra.

use model_format::{NodeFlags, Provenance, SAMPLE_RATE_HZ};
use rayon::prelude::*;

use crate::dsp::model::Model;
use crate::evaluation::scoring_range::ScoringRange;
use crate::fit;
use crate::fit::densify::Direction;
use crate::fit::densify::{ECONOMY_DB, Filling, highest_order};
use crate::fit::lines::Lines;
use crate::fit::{Analysis, Fit};
use crate::recording::triage::{Kind, Verdict};
use crate::recording::{RecordingSet, Trial};
use crate::rig::is_of_the_papers_rig;
use crate::support::error::{Error, Result};
use crate::texture::domain::{Method, Neighbour};
use crate::texture::grid::{Grid, as_written};
use crate::texture::recorded_spectra::recorded_spectra;
use crate::texture::recorded_spectra::spectra::{RecordedSpectra, TwoWays};

use super::Options;

/// A set made ready for the test: its models, its signals and its spectra.
pub struct Prepared<'a> {
    pub(super) set: &'a RecordingSet,
    pub(super) signals: Vec<Vec<f64>>,
    /// Frequencies at which each trial can be judged.
    pub(super) ranges: Vec<Option<ScoringRange>>,
    pub(super) textures: Vec<PreparedTexture>,
    pub(super) simulated: bool,
    pub(super) papers_textures: Vec<String>,
}

pub(super) struct PreparedTexture {
    pub(super) name: String,
    pub(super) grid: Grid,
    pub(super) field: RecordedSpectra,
    pub(super) ways: TwoWays,
    /// The denser grid, if there is one to be tested.
    denser: Option<Filling>,
}

/// A node to be removed: the trial it is compared with, its texture and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Target {
    pub(super) trial: usize,
    pub(super) texture: usize,
    pub(super) place: (usize, usize),
}

/// A node of the denser grid next to one that is removed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surrounding {
    /// The axis along which it is next.
    along: Direction,
    /// 0 before the removed node, 1 after it.
    side: usize,
    speed_mm_s: f32,
    force_n: f32,
    /// Its weight, that of its opposite being the rest of 1.
    weight: f64,
    /// Its place between the recorded nodes around the removed one.
    share: f64,
    /// True if it is one of these.
    is_recorded: bool,
    /// True if it may be filled in.
    is_filled: bool,
}

impl<'a> Prepared<'a> {
    /// Reads and fits `set`.
    ///
    /// # Errors
    /// Those of [`fit::fit`], and a set without any inner node.
    pub fn new(set: &'a RecordingSet, options: &Options) -> Result<Self> {
        let fit_options = fit::Options {
            order: options.order,
            reduction: options.reduction,
            // A removed node is predicted as a whole, the lines of its surface included.
            lines: Lines::None,
            ..fit::Options::default()
        };
        let read = set.trials.par_iter().map(|trial| {
            let highest = fit_options.order.highest();
            let (analysis, signal) = fit::analyse_with_signal(trial, &fit_options, highest)?;
            Ok((analysis, signal.samples))
        });
        let (analyses, signals): (Vec<_>, Vec<_>) =
            read.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let ranges =
            analyses
                .iter()
                .zip(&signals)
                .map(|(analysis, signal): (&Analysis, &Vec<f64>)| {
                    ScoringRange::of(source_rate_hz(&analysis.verdicts), signal.len())
                });
        let ranges = ranges.collect();
        let Fit { textures, .. } = fit::fit_analysed(set, &analyses, &fit_options)?;
        let textures = textures
            .into_iter()
            .map(|texture| {
                let field = recorded_spectra(&texture.name, &texture.grid, set, &signals);
                PreparedTexture {
                    ways: TwoWays::of(&field),
                    name: texture.name,
                    grid: texture.grid,
                    field,
                    denser: None,
                }
            })
            .collect();
        let prepared = Self {
            set,
            signals,
            ranges,
            textures,
            simulated: set
                .trials
                .iter()
                .any(|trial| trial.provenance == Provenance::Simulated),
            papers_textures: papers_textures(set),
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

    /// Takes denser grids, by the names of their textures, for [`Row::Denser`](super::Row::Denser).
    ///
    /// Returns the nodes, by their places in [`LeaveOneOut::removed`](super::LeaveOneOut::removed), that are predicted
    /// from other places of the denser grid than before. The others' outcomes stay the same.
    pub fn set_denser(&mut self, fillings: &[(String, Filling)]) -> Vec<usize> {
        let targets = self.targets();
        let surroundings = |prepared: &Self| -> Vec<_> {
            let of = |target: &Target| {
                let texture = &prepared.textures[target.texture];
                let denser = texture.denser.as_ref();
                denser.map(|denser| texture.surroundings(denser, target.place))
            };
            targets.iter().map(of).collect()
        };
        let before = surroundings(self);
        for texture in &mut self.textures {
            let of_it = fillings.iter().find(|(name, _)| *name == texture.name);
            texture.denser = of_it.map(|(_, filling)| filling.clone());
        }
        let after = surroundings(self);
        let others = before.iter().zip(&after).enumerate();
        let others = others.filter(|(_, (before, after))| before != after);
        others.map(|(index, _)| index).collect()
    }

    /// Returns the number of nodes that will be removed.
    pub fn count(&self) -> usize {
        self.targets().len()
    }

    pub(super) fn targets(&self) -> Vec<Target> {
        let trials = self.set.trials.iter().enumerate();
        trials
            .filter_map(|(index, trial)| {
                let texture = self.textures.iter().position(|t| t.name == trial.texture)?;
                let place = self.textures[texture].place(trial)?;
                // A recording that nothing can be judged on is no place of the test.
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

/// The sample rate of a recording's file as far as it bounds what can be judged, Hz.
fn source_rate_hz(verdicts: &[Verdict]) -> f64 {
    let slow = verdicts.iter().map(|verdict| match verdict.kind() {
        Kind::WrongRate { rate_hz } => rate_hz,
        _ => f64::INFINITY,
    });
    slow.fold(f64::from(SAMPLE_RATE_HZ), f64::min)
}

/// Names of the textures of which every trial was simulated by the paper's rig.
fn papers_textures(set: &RecordingSet) -> Vec<String> {
    let is_papers = |trial: &Trial| {
        trial.provenance == Provenance::Simulated
            && is_of_the_papers_rig(&trial.file, &trial.texture)
    };
    // One recording of a folder tells for all; a set has hundreds.
    let mut known = std::collections::HashMap::new();
    let mut others = Vec::new();
    for trial in &set.trials {
        let key = (
            trial.file.parent(),
            &trial.texture,
            trial.provenance == Provenance::Simulated,
        );
        if !*known.entry(key).or_insert_with(|| is_papers(trial)) {
            others.push(trial.texture.as_str());
        }
    }
    let names = set.textures().into_iter();
    names
        .filter(|name| !others.contains(name))
        .map(str::to_owned)
        .collect()
}

impl PreparedTexture {
    pub(super) fn model(&self, (speed, force): (usize, usize)) -> &Model {
        &self.grid.models[self.grid.index(speed, force)]
    }

    /// The node of a trial, if it is an inner one.
    fn place(&self, trial: &Trial) -> Option<(usize, usize)> {
        let at = |axis: &[f32], value: f64| {
            let index = axis.iter().position(|&v| v == value as f32)?;
            let inner = axis.len() <= 2 || (index > 0 && index + 1 < axis.len());
            inner.then_some(index)
        };
        let speed = at(&self.grid.speeds_mm_s, trial.speed_mm_s)?;
        let force = at(&self.grid.forces_n, trial.force_n)?;
        self.sounds((speed, force)).then_some((speed, force))
    }

    /// Returns whether a node was recorded and is not silent.
    fn sounds(&self, place: (usize, usize)) -> bool {
        let flags = self.model(place).flags;
        let without = [
            NodeFlags::SILENT,
            NodeFlags::INTERPOLATED,
            NodeFlags::EXTRAPOLATED,
        ];
        !without.iter().any(|&flag| flags.contains(flag)) && self.field.spectrum(place).is_some()
    }

    /// Returns the neighbours that the node at `place` is predicted from.
    pub(super) fn neighbours(&self, place: (usize, usize)) -> Vec<Neighbour<'_>> {
        let directions = [Direction::Speed, Direction::Force].into_iter();
        let pairs = directions.filter_map(|along| self.pair_along(along, place));
        let pairs: Vec<[Neighbour<'_>; 2]> = pairs.collect();
        let share = 1.0 / pairs.len().max(1) as f64;
        let mut neighbours: Vec<Neighbour<'_>> = pairs.into_iter().flatten().collect();
        neighbours.iter_mut().for_each(|n| n.weight *= share);
        neighbours
    }

    /// The nodes before and after `at` on an axis, if both sound.
    fn pair(
        &self,
        at: usize,
        axis: &[f32],
        place: impl Fn(usize) -> (usize, usize),
    ) -> Option<[Neighbour<'_>; 2]> {
        let (before, after) = (at.checked_sub(1)?, at + 1);
        if after >= axis.len() || !self.sounds(place(before)) || !self.sounds(place(after)) {
            return None;
        }
        let share = f64::from((axis[at] - axis[before]) / (axis[after] - axis[before]));
        let neighbour = |index: usize, weight: f64| Neighbour {
            weight,
            speed_mm_s: f64::from(self.grid.speeds_mm_s[place(index).0]),
            model: self.model(place(index)),
        };
        Some([neighbour(before, 1.0 - share), neighbour(after, share)])
    }

    /// The nodes of the denser grid next to a place, on both sides and in both directions.
    fn surroundings(&self, denser: &Filling, place: (usize, usize)) -> Vec<Surrounding> {
        let (speeds, forces) = (&self.grid.speeds_mm_s, &self.grid.forces_n);
        let mut surroundings = Vec::new();
        for along in [Direction::Speed, Direction::Force] {
            let (recorded, denser_axis, at) = match along {
                Direction::Speed => (speeds, &denser.speeds_mm_s, place.0),
                Direction::Force => (forces, &denser.forces_n, place.1),
            };
            if self.pair_along(along, place).is_none() {
                continue;
            }
            let (ends, removed) = ([recorded[at - 1], recorded[at + 1]], recorded[at]);
            let below = denser_axis.iter().rev().find(|&&value| value < removed);
            let above = denser_axis.iter().find(|&&value| value > removed);
            let next = [
                below.map_or(ends[0], |&value| value.max(ends[0])),
                above.map_or(ends[1], |&value| value.min(ends[1])),
            ];
            for (side, value) in next.into_iter().enumerate() {
                let (speed_mm_s, force_n) = match along {
                    Direction::Speed => (value, forces[place.1]),
                    Direction::Force => (speeds[place.0], value),
                };
                let distance = f64::from((removed - value) / (next[1] - next[0])).abs();
                surroundings.push(Surrounding {
                    along,
                    side,
                    speed_mm_s,
                    force_n,
                    weight: 1.0 - distance,
                    share: f64::from((value - ends[0]) / (ends[1] - ends[0])),
                    is_recorded: value == ends[side],
                    is_filled: denser.allows(as_written(speed_mm_s), as_written(force_n)),
                });
            }
        }
        surroundings
    }

    /// The nodes before and after `place` along an axis, if both sound.
    fn pair_along(&self, along: Direction, place: (usize, usize)) -> Option<[Neighbour<'_>; 2]> {
        match along {
            Direction::Speed => self.pair(place.0, &self.grid.speeds_mm_s, |s| (s, place.1)),
            Direction::Force => self.pair(place.1, &self.grid.forces_n, |f| (place.0, f)),
        }
    }

    /// The node as the device interpolates over its place in the denser grid, where all that was filled in beside it is
    /// filled in anew without its recording.
    pub(super) fn in_denser_grid(&self, place: (usize, usize)) -> Option<Model> {
        let speed_mm_s = f64::from(self.grid.speeds_mm_s[place.0]);
        let Some(denser) = &self.denser else {
            return Method::DEVICE.predict(&self.neighbours(place), speed_mm_s);
        };
        let field = self.field.without_node(place);
        let surroundings = self.surroundings(denser, place);
        // Two of each direction.
        let directions = (surroundings.len() / 2) as f64;
        let model = |next: &Surrounding| {
            let mut pair = self.pair_along(next.along, place)?;
            let filled = || {
                denser.model_at(
                    &field,
                    as_written(next.speed_mm_s),
                    as_written(next.force_n),
                )
            };
            if next.is_recorded {
                return Some(pair[next.side].model.clone());
            }
            filled().or_else(|| {
                pair[0].weight = 1.0 - next.share;
                pair[1].weight = next.share;
                Method::DEVICE.predict(&pair, f64::from(next.speed_mm_s))
            })
        };
        let models = surroundings.iter().map(model);
        let models: Vec<Model> = models.collect::<Option<_>>()?;
        let neighbours = surroundings.iter().zip(&models);
        let neighbours: Vec<Neighbour<'_>> = neighbours
            .map(|(next, model)| Neighbour {
                weight: next.weight / directions,
                speed_mm_s: f64::from(next.speed_mm_s),
                model,
            })
            .collect();
        Method::DEVICE.predict(&neighbours, speed_mm_s)
    }

    /// The node as a densified grid would have it.
    pub(super) fn densified(&self, place: (usize, usize)) -> Option<Model> {
        let spectrum = self.field.without(place, &self.ways)?;
        Some(spectrum.economical_model(ECONOMY_DB, highest_order(&self.grid)))
    }
}
