//! Everything that is fitted and read before anything is played.

use std::path::Path;

use model_format::{PartsSpec, SAMPLE_RATE_HZ};
use rayon::prelude::*;
use stylus_dsp::spectrum;
use stylus_dsp::sums::mean_square;
use stylus_fit::fit::blocks::Part;
use stylus_fit::fit::lines::Lines;
use stylus_fit::fit::{FittedTexture, Order};
use stylus_fit::texture::grid::Grid;
use stylus_hard_cases::Case;
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_signals::rig::RigFile;
use stylus_support::{Error, Result};

use super::Options;
use crate::held_out::is_same;
use stylus_fit::fit;
use stylus_signals::{recording, rig};

/// Largest number of nodes that are judged at rest. If there are more recordings, evenly spaced ones are used.
const MAX_NODES: usize = 96;

/// Models of all textures at one choice of order.
pub(super) struct Fitted {
    pub(super) order: Order,
    pub(super) highest_order: usize,
    /// The textures' grids, in the order of [`Prepared::names`].
    pub(super) grids: Vec<Grid>,
}

/// Fits and held-out recordings, before anything is played.
pub struct Prepared {
    pub(super) names: Vec<String>,
    /// Models without optional parts, one entry per choice of the order.
    pub(super) fitted: Vec<Fitted>,
    /// Recordings held out, each with its texture's and its node's index.
    pub(super) held_out: Vec<(usize, usize, Vec<f64>)>,
    pub(super) take_cost: f64,
    pub(super) take_band_error_db: f64,
    pub(super) cases: Vec<Case>,
    pub(super) material: String,
    pub(super) simulated: bool,
}

impl Prepared {
    /// Fits one half of `material` and reads the other. Calls `progress` after each analysed trial.
    ///
    /// # Errors
    /// A recording that cannot be used; material without a node that sounds.
    pub fn new(material: &Material, options: &Options, progress: impl Fn() + Sync) -> Result<Self> {
        let at = |order| fit::Options {
            order,
            conditioning: options.conditioning,
            // Filters are compared with the whole spectrum, including lines.
            lines: Lines::None,
            ..fit::Options::default()
        };
        // Recordings are read once, with the highest order: their lags serve every lower order. No signal is kept.
        let highest_order = at(Order::Fixed(model_format::limits::MAX_ORDER));
        let progress = |_| progress();
        let recordings = fit::read(&material.fit, &highest_order, Part::Whole, 0, &progress)?;
        let fit_at = |order| fit::models(&material.fit, &recordings, &at(order));
        let highest = fit_at(Order::Fixed(model_format::limits::MAX_ORDER))?;
        let names: Vec<String> = highest.textures.iter().map(|texture| texture.name.clone()).collect();
        let grids = |fit: &fit::Fit| -> Vec<Grid> {
            let without_parts = |texture: &FittedTexture| Grid {
                parts: PartsSpec::default(),
                ..texture.grid.clone()
            };
            fit.textures.iter().map(without_parts).collect()
        };
        let mut fitted: Vec<Fitted> = options
            .orders
            .iter()
            .map(|&order| {
                let mut grids = grids(&highest);
                // In the Levinson-Durbin recursion, a model of lower order is the first stages of a model of higher
                // order.
                grids
                    .iter_mut()
                    .flat_map(|grid| &mut grid.models)
                    .for_each(|model| model.reflection.truncate(order));
                Fitted::new(Order::Fixed(order), grids)
            })
            .collect();
        // These choose an order for each node, so that no cut of another fit has their models.
        for order in [Order::Bayesian, Order::Auto] {
            fitted.push(Fitted::new(order, grids(&fit_at(order)?)));
        }
        let mut prepared = Self {
            names,
            fitted,
            held_out: Vec::new(),
            take_cost: f64::NAN,
            take_band_error_db: f64::NAN,
            cases: options.cases.clone(),
            material: material.description.clone(),
            simulated: material.fit.is_simulated() || material.held_out.is_simulated(),
        };
        prepared.read_held_out(material, options)?;
        Ok(prepared)
    }

    fn read_held_out(&mut self, material: &Material, options: &Options) -> Result<()> {
        let trials = &material.held_out.trials;
        let places: Vec<(usize, (usize, usize))> = (0..trials.len())
            .filter_map(|index| Some((index, self.place(&material.held_out, index)?)))
            .collect();
        if places.is_empty() {
            return Err(Error::Request(
                "no recording sounds: there is nothing to compare; give recordings above the silence floor".into(),
            ));
        }
        let count = places.len().min(MAX_NODES);
        let chosen = (0..count).map(|n| places[n * places.len() / count]);
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let read = chosen
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(index, (texture, node))| {
                let signal = fit::signal(&trials[index], options.conditioning)?.samples;
                let take = material.take_of(&trials[index]);
                let between = match take {
                    Some(take) => {
                        let other = fit::signal(take, options.conditioning)?.samples;
                        let cost = spectrum::spectral_cost(&signal, &other, rate_hz, options.smoothing_hz);
                        let bands: Vec<f64> = spectrum::band_errors_db(&signal, &other, rate_hz)
                            .into_iter()
                            .flatten()
                            .collect();
                        cost.map(|cost| (cost, mean_square(&bands)))
                    }
                    None => None,
                };
                Ok(((texture, node, signal), between))
            })
            .collect::<Result<Vec<_>>>()?;
        let takes: Vec<(f64, f64)> = read.iter().filter_map(|(_, between)| *between).collect();
        let count = takes.len() as f64;
        self.take_cost = takes.iter().map(|take| take.0).sum::<f64>() / count;
        // Squares are averaged as over nodes at rest, so that both errors can be compared.
        self.take_band_error_db = (takes.iter().map(|take| take.1).sum::<f64>() / count).sqrt();
        self.held_out = read.into_iter().map(|(held_out, _)| held_out).collect();
        Ok(())
    }

    /// Index of a trial's texture and node, if that node sounds.
    fn place(&self, set: &RecordingSet, index: usize) -> Option<(usize, usize)> {
        let trial = &set.trials[index];
        let texture = self.names.iter().position(|name| *name == trial.texture)?;
        // The nodes and their powers are the same for every choice of the order.
        let grid = &self.fitted[0].grids[texture];
        let node = grid.nodes().position(|(speed, force, model)| {
            // A grid's axes are the trials' own values rounded to `f32`, so equal values compare as equal.
            let here = speed == trial.speed_mm_s as f32 && force == trial.force_n as f32;
            here && model.output_power > 0.0
        })?;
        Some((texture, node))
    }
}

impl Fitted {
    fn new(order: Order, grids: Vec<Grid>) -> Self {
        let highest = grids
            .iter()
            .flat_map(|grid| &grid.models)
            .map(|model| model.reflection.len())
            .max();
        Self {
            order,
            highest_order: highest.unwrap_or(0),
            grids,
        }
    }
}

/// Seeds of the two simulated takes.
const SEEDS: [u64; 2] = [1, 2];

/// Recordings to fit, and others of the same nodes to judge by.
#[derive(Clone, Debug)]
pub struct Material {
    /// Recordings to fit.
    pub fit: RecordingSet,
    /// Recordings to judge by.
    pub held_out: RecordingSet,
    /// Description of the recordings, in a sentence.
    pub description: String,
}

impl Material {
    /// Two takes of the paper's protocol by the rig simulator, written below `folder`.
    pub fn simulated(folder: &Path) -> Result<Self> {
        let paper = RigFile::paper();
        let [fit, held_out] = SEEDS.map(|seed| {
            let take = folder.join(format!("take-{seed}"));
            rig::simulate_to_folder(&paper, seed, &take, false)?;
            RecordingSet::open(&[take])
        });
        let description = format!(
            "SIMULATED: the paper's protocol by the rig simulator (simulate-rig), seed {} fitted, seed {}, other \
             pieces of the same surfaces, held out",
            SEEDS[0], SEEDS[1]
        );
        Ok(Self {
            fit: fit?,
            held_out: held_out?,
            description,
        })
    }

    /// The first half of each recording of `set` to fit, its second half to judge by.
    pub fn halves(set: &RecordingSet) -> Result<Self> {
        let mut material = Self {
            fit: set.clone(),
            held_out: set.clone(),
            description: "the first half of each recording fitted, its second half held out".to_owned(),
        };
        let halves = material.fit.trials.iter_mut().zip(&mut material.held_out.trials);
        for (first, second) in halves {
            let samples = recording::read(first)?.axes.first().map_or(0, Vec::len);
            // A recording is read at the models' rate, whatever the rate of its file.
            let half_s = samples as f64 / f64::from(SAMPLE_RATE_HZ) / 2.0;
            first.duration_s = Some(half_s);
            second.duration_s = Some(half_s);
            second.start_s += half_s;
        }
        Ok(material)
    }

    /// `set` to fit, and another take of the same nodes to judge by.
    ///
    /// # Errors
    /// No recording of `takes` is of a node of `set`.
    pub fn takes(set: RecordingSet, takes: RecordingSet) -> Result<Self> {
        let material = Self {
            description: "one take of each recording fitted, another held out".to_owned(),
            fit: set,
            held_out: takes,
        };
        let mut trials = material.held_out.trials.iter();
        if !trials.any(|trial| material.take_of(trial).is_some()) {
            return Err(Error::Request(
                "the takes have no texture, speed and force of the recordings; give takes of the same trials".into(),
            ));
        }
        Ok(material)
    }

    /// The fitted recording of the same node as `trial`.
    pub(super) fn take_of(&self, trial: &Trial) -> Option<&Trial> {
        self.fit.trials.iter().find(|other| is_same(trial, other))
    }
}
