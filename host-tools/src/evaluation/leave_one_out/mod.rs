//! The removed-node test of the paper's section IV: each inner node of a texture's grid is taken away, predicted from its
//! neighbours, played by the device's kernel, and compared with what was recorded there.
//!
//! A node is *inner* if it was recorded, sounds, and lies at no end of an axis of more than two values. Its neighbours
//! are the next nodes on both sides along speed and along force; an axis counts where both of them were recorded and
//! sound (at 0 N nothing touches, so that the lowest force in contact has neighbours along speed only). Within an axis
//! neighbours weigh by nearness, and both axes alike, for every method the same.
//!
//! A prediction that the device could not play (an unstable mean, or one too loud) counts with C = 1, which is what
//! silence scores.

mod play;
mod summary;

use model_format::{NodeFlags, Provenance};
use rayon::prelude::*;
use serde::Serialize;

use crate::dsp::linear_prediction::error_share;
use crate::dsp::model::Model;
use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::fit;
use crate::fit::densify::ECONOMY_DB;
use crate::fit::{Fit, Order};
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};
use crate::texture::domain::{Domain, Level, Method, Neighbour};
use crate::texture::grid::Grid;
use crate::texture::quantise::StructureChoice;
use crate::texture::recorded_spectra::recorded_spectra;
use crate::texture::recorded_spectra::spectra::{RecordedSpectra, TwoWays};

pub use play::{Judged, Voice, synthesis};
pub use summary::{PAPER_TABLE_I, PaperColumn, Summary, summarise};

/// Widths of the kernel that smooths amplitudes for C, Hz, over which its dependence is shown.
pub const SMOOTHING_WIDTHS_HZ: [f64; 7] = [0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0];

/// Which neighbours a removed node is predicted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Around {
    /// Those along speed and those along force.
    #[default]
    Both,
    /// Those along speed only, as if a whole speed had not been recorded.
    Speed,
    /// Those along force only.
    Force,
}

/// How to test.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// From three axes to one.
    pub reduction: Reduction,
    /// Order of the models; the paper's is 400 for all.
    pub order: Order,
    /// Which neighbours predict.
    pub around: Around,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, Hz.
    pub smoothing_hz: f64,
    /// How long each synthesis is at least, s.
    pub synthesis_s: f64,
    /// Seed of the syntheses; each trial has its own noise, the same for every method.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            reduction: Reduction::Pca,
            order: Order::Fixed(model_format::limits::MAX_ORDER),
            around: Around::Both,
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 5.0,
            seed: 1,
        }
    }
}

/// A row of the table: how the removed node was predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Not at all: the node's own model, as the best that its structure and order can do.
    Own,
    /// In one of the domains.
    Interpolated(Method),
    /// As `fit --densify` fills the place: log-spectra over f/v with surface and tool apart, refitted.
    Densified,
}

impl Row {
    /// Every row, in the table's order.
    pub fn all() -> Vec<Self> {
        let methods = Method::ALL.map(Self::Interpolated);
        [&methods[..], &[Self::Densified, Self::Own]].concat()
    }

    /// A name for tables.
    pub fn name(self) -> String {
        match self {
            Self::Own => "(not removed: its own model)".into(),
            Self::Interpolated(method) => method.name(),
            Self::Densified => "densified: f/v, surface and tool apart".into(),
        }
    }

    /// Whether the dependence of C on the smoothing is shown of it.
    fn is_followed(self) -> bool {
        [
            Self::Interpolated(Method::PAPER),
            Self::Interpolated(Method::DEVICE),
            Self::Densified,
            Self::Own,
        ]
        .contains(&self)
    }
}

impl Serialize for Row {
    fn serialize<S: serde::Serializer>(
        &self,
        serializer: S,
    ) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(&self.name())
    }
}

/// One removed node and what became of it in every row.
#[derive(Clone, Debug, Serialize)]
pub struct Removed {
    /// The recording it is compared with.
    pub file: String,
    /// Its texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// What each row of [`LeaveOneOut::rows`] comes to.
    pub outcomes: Vec<Outcome>,
}

/// How near a prediction comes to the recording.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The synthesis against the recording.
    #[serde(flatten)]
    pub judged: Judged,
    /// Whether the device could play the prediction.
    pub is_playable: bool,
    /// Order of the predicted model.
    pub order: usize,
    /// Variance of the predicted excitation less that fitted to the recording, (m/s²)²; none if not playable.
    pub excitation_error: Option<f64>,
}

/// What the test gives.
#[derive(Clone, Debug, Serialize)]
pub struct LeaveOneOut {
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// Order of the interpolated models.
    pub order: String,
    /// Which neighbours predicted.
    pub around: Around,
    /// Whether any recording behind it is simulated.
    pub simulated: bool,
    /// How nodes were predicted.
    pub rows: Vec<Row>,
    /// Widths, Hz, over which [`Judged::costs_by_width`] goes.
    pub smoothing_widths_hz: Vec<f64>,
    /// Every removed node, in the order of the set.
    pub removed: Vec<Removed>,
}

/// A set made ready for the test: its models, its signals and its spectra.
pub struct Prepared<'a> {
    set: &'a RecordingSet,
    signals: Vec<Vec<f64>>,
    textures: Vec<PreparedTexture>,
    simulated: bool,
}

struct PreparedTexture {
    name: String,
    grid: Grid,
    field: RecordedSpectra,
    ways: TwoWays,
}

/// A node to be removed: the trial it is compared with, its texture and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Target {
    trial: usize,
    texture: usize,
    place: (usize, usize),
}

impl<'a> Prepared<'a> {
    /// Reads and fits `set`.
    ///
    /// # Errors
    /// What [`fit::fit`] says, and a set without any inner node.
    pub fn new(set: &'a RecordingSet, options: &Options) -> Result<Self> {
        let fit_options = fit::Options {
            order: options.order,
            reduction: options.reduction,
            ..fit::Options::default()
        };
        let Fit { textures, .. } = fit::fit(set, &fit_options, || ())?;
        let signals = set
            .trials
            .par_iter()
            .map(|trial| Ok(fit::signal(trial, options.reduction)?.0))
            .collect::<Result<Vec<_>>>()?;
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
            textures,
            simulated: set
                .trials
                .iter()
                .any(|trial| trial.provenance == Provenance::Simulated),
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

    /// How many nodes will be removed.
    pub fn count(&self, around: Around) -> usize {
        self.targets(around).len()
    }

    fn targets(&self, around: Around) -> Vec<Target> {
        let trials = self.set.trials.iter().enumerate();
        trials
            .filter_map(|(index, trial)| {
                let texture = self.textures.iter().position(|t| t.name == trial.texture)?;
                let place = self.textures[texture].place(trial)?;
                let neighbours = self.textures[texture].neighbours(place, around);
                (!neighbours.is_empty()).then_some(Target {
                    trial: index,
                    texture,
                    place,
                })
            })
            .collect()
    }

    /// Removes and predicts every inner node in every one of `rows`, telling `progress` of each node done.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// A request that the kernel's renderer refuses.
    pub fn run(
        &self,
        rows: &[Row],
        options: &Options,
        progress: impl Fn() + Sync,
    ) -> Result<LeaveOneOut> {
        let removed = self
            .targets(options.around)
            .into_par_iter()
            .map(|target| {
                let outcome = self.remove(target, rows, options);
                progress();
                outcome
            })
            .collect::<Result<Vec<_>>>()?;
        Ok(LeaveOneOut {
            smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
            order: match options.order {
                Order::Auto => "chosen for each node (BIC)".into(),
                Order::AtMost(order) => format!("chosen for each node (AIC), at most {order}"),
                Order::Fixed(order) => order.to_string(),
            },
            around: options.around,
            simulated: self.simulated,
            rows: rows.to_vec(),
            smoothing_widths_hz: SMOOTHING_WIDTHS_HZ.to_vec(),
            removed,
        })
    }

    /// The recording at a removed node, and what is played there in `row`; none if it cannot be.
    ///
    /// # Errors
    /// A node that is not of this set, and a request that the kernel's renderer refuses.
    pub fn hear(
        &self,
        node: &Removed,
        row: Row,
        options: &Options,
    ) -> Result<Option<(Vec<f64>, Vec<f64>)>> {
        let is_it = |target: &&Target| {
            self.set.trials[target.trial].file.display().to_string() == node.file
        };
        let targets = self.targets(options.around);
        let Some(&target) = targets.iter().find(is_it) else {
            let problem = format!("{} is not one of the removed nodes", node.file);
            return Err(Error::Request(problem));
        };
        let mut removal = Removal::new(self, target, options);
        let Some((at, power)) = removal.voice(row)? else {
            return Ok(None);
        };
        let played = removal.voices[at]
            .1
            .as_ref()
            .and_then(|voice| voice.at_power(power));
        Ok(played.map(|played| (self.signals[target.trial].clone(), played)))
    }

    fn remove(&self, target: Target, rows: &[Row], options: &Options) -> Result<Removed> {
        let trial = &self.set.trials[target.trial];
        let mut removal = Removal::new(self, target, options);
        let outcomes = rows.iter().map(|&row| removal.outcome(row));
        Ok(Removed {
            outcomes: outcomes.collect::<Result<Vec<_>>>()?,
            file: trial.file.display().to_string(),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
        })
    }
}

/// What of a row makes its sound. The level is a gain behind the filter: methods that differ by it alone are one
/// synthesis, scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timbre {
    Own,
    Interpolated(Domain),
    Densified,
}

/// A node that is being removed.
struct Removal<'p, 's> {
    prepared: &'p Prepared<'s>,
    target: Target,
    options: &'p Options,
    neighbours: Vec<Neighbour<'p>>,
    /// What was played so far.
    voices: Vec<(Timbre, Option<Voice>)>,
}

impl<'p, 's> Removal<'p, 's> {
    fn new(prepared: &'p Prepared<'s>, target: Target, options: &'p Options) -> Self {
        let texture = &prepared.textures[target.texture];
        Self {
            prepared,
            target,
            options,
            neighbours: texture.neighbours(target.place, options.around),
            voices: Vec::new(),
        }
    }

    fn texture(&self) -> &'p PreparedTexture {
        &self.prepared.textures[self.target.texture]
    }

    /// The model that is played for a timbre, and its structure.
    fn model(&self, timbre: Timbre) -> (Option<Model>, StructureChoice) {
        let (texture, place) = (self.texture(), self.target.place);
        match timbre {
            Timbre::Own => (Some(texture.model(place).clone()), StructureChoice::Lattice),
            Timbre::Densified => (
                texture.densified(place, self.options.around),
                StructureChoice::Lattice,
            ),
            Timbre::Interpolated(domain) => {
                let level = Level::Power;
                let speed_mm_s = self.prepared.set.trials[self.target.trial].speed_mm_s;
                let model = Method { domain, level }.predict(&self.neighbours, speed_mm_s);
                (model, domain.structure())
            }
        }
    }

    /// Index of the voice of `row`, and the power at which it is to be heard; none if the device cannot play it.
    fn voice(&mut self, row: Row) -> Result<Option<(usize, f64)>> {
        let timbre = match row {
            Row::Own => Timbre::Own,
            Row::Densified => Timbre::Densified,
            Row::Interpolated(method) => Timbre::Interpolated(method.domain),
        };
        let known = self.voices.iter().position(|(known, _)| *known == timbre);
        let at = known.unwrap_or(self.voices.len());
        if known.is_none() {
            let seed = self.options.seed.wrapping_add(self.target.trial as u64);
            let (model, structure) = self.model(timbre);
            let voice = model.map(|model| Voice::of(model, structure, self.options, seed));
            self.voices.push((timbre, voice.transpose()?.flatten()));
        }
        Ok(self.voices[at].1.as_ref().map(|voice| {
            let power = match row {
                Row::Interpolated(method) => method
                    .level
                    .power(&self.neighbours, &voice.model.reflection),
                Row::Own | Row::Densified => voice.model.output_power,
            };
            (at, power)
        }))
    }

    fn outcome(&mut self, row: Row) -> Result<Outcome> {
        let voice = self.voice(row)?;
        let widths: &[f64] = if row.is_followed() {
            &SMOOTHING_WIDTHS_HZ
        } else {
            &[]
        };
        let recorded = &self.prepared.signals[self.target.trial];
        let voice = voice.and_then(|(at, power)| Some((self.voices[at].1.as_ref()?, power)));
        let judged = voice.and_then(|(voice, power)| {
            let synthesised = voice.at_power(power)?;
            play::judge(recorded, &synthesised, self.options, widths)
        });
        let own = self.texture().model(self.target.place);
        let excitation_error = voice.filter(|_| judged.is_some()).map(|(voice, power)| {
            power * error_share(&voice.model.reflection)
                - own.output_power * error_share(&own.reflection)
        });
        Ok(Outcome {
            is_playable: judged.is_some(),
            order: voice.map_or(0, |(voice, _)| voice.model.reflection.len()),
            excitation_error,
            judged: judged.unwrap_or_else(|| Judged::silence(widths.len())),
        })
    }
}

impl PreparedTexture {
    fn model(&self, (speed, force): (usize, usize)) -> &Model {
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

    /// Whether a node was recorded and is not silent.
    fn sounds(&self, place: (usize, usize)) -> bool {
        let flags = self.model(place).flags;
        let without = [
            NodeFlags::SILENT,
            NodeFlags::INTERPOLATED,
            NodeFlags::EXTRAPOLATED,
        ];
        !without.iter().any(|&flag| flags.contains(flag)) && self.field.spectrum(place).is_some()
    }

    /// What the node at `place` is predicted from.
    fn neighbours(&self, place: (usize, usize), around: Around) -> Vec<Neighbour<'_>> {
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
    fn densified(&self, place: (usize, usize), around: Around) -> Option<Model> {
        let spectrum = match around {
            Around::Both => self.field.without(place, &self.ways),
            Around::Speed => self.ways.along_speed(&self.field, place).cloned(),
            Around::Force => self.ways.along_force(&self.field, place).cloned(),
        };
        Some(spectrum?.economical_model(ECONOMY_DB))
    }
}
