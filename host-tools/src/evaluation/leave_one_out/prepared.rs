//! A set made ready for the removed-node test: its models, its signals and its spectra.

use model_format::{NodeFlags, Provenance, SAMPLE_RATE_HZ};
use rayon::prelude::*;

use crate::dsp::model::Model;
use crate::evaluation::scoring_range::ScoringRange;
use crate::fit;
use crate::fit::densify::ECONOMY_DB;
use crate::fit::lines::Lines;
use crate::fit::{Analysis, Fit};
use crate::recording::triage::Verdict;
use crate::recording::{RecordingSet, Trial};
use crate::rig::is_of_the_papers_rig;
use crate::support::error::{Error, Result};
use crate::texture::domain::Neighbour;
use crate::texture::grid::Grid;
use crate::texture::recorded_spectra::recorded_spectra;
use crate::texture::recorded_spectra::spectra::{RecordedSpectra, TwoWays};

use super::options::{Around, Options};

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
}

/// A node to be removed: the trial it is compared with, its texture and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Target {
    pub(super) trial: usize,
    pub(super) texture: usize,
    pub(super) place: (usize, usize),
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
            fit::analyse_with_signal(trial, &fit_options, fit_options.order.highest())
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
        if prepared.targets(options.around).is_empty() {
            return Err(Error::Request(
                "no node can be removed: a texture needs three speeds (or forces) in contact at least, so that one is \
                 between two others"
                    .into(),
            ));
        }
        Ok(prepared)
    }

    /// Returns the number of nodes that will be removed.
    pub fn count(&self, around: Around) -> usize {
        self.targets(around).len()
    }

    pub(super) fn targets(&self, around: Around) -> Vec<Target> {
        let trials = self.set.trials.iter().enumerate();
        trials
            .filter_map(|(index, trial)| {
                let texture = self.textures.iter().position(|t| t.name == trial.texture)?;
                let place = self.textures[texture].place(trial)?;
                // A recording that nothing can be judged on is no place of the test.
                self.ranges[index].as_ref()?;
                let neighbours = self.textures[texture].neighbours(place, around);
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
    let slow = verdicts.iter().map(|verdict| match verdict {
        Verdict::WrongRate { rate_hz } => *rate_hz,
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
    pub(super) fn neighbours(&self, place: (usize, usize), around: Around) -> Vec<Neighbour<'_>> {
        let (speed, force) = place;
        let (speeds, forces) = (&self.grid.speeds_mm_s, &self.grid.forces_n);
        let along_speed = (around != Around::Force)
            .then(|| self.pair(speed, speeds, |s| (s, force)))
            .flatten();
        let along_force = (around != Around::Speed)
            .then(|| self.pair(force, forces, |f| (speed, f)))
            .flatten();
        let pairs: Vec<_> = [along_speed, along_force].into_iter().flatten().collect();
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

    /// The node as a densified grid would have it.
    pub(super) fn densified(&self, place: (usize, usize), around: Around) -> Option<Model> {
        let spectrum = match around {
            Around::Both => self.field.without(place, &self.ways),
            Around::Speed => self.ways.along_speed(&self.field, place).cloned(),
            Around::Force => self.ways.along_force(&self.field, place).cloned(),
        };
        Some(spectrum?.economical_model(ECONOMY_DB))
    }
}
