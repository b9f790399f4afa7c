//! What accuracy costs in time: every structure, order and interval of updates, with its error and its cycles, and which of
//! them no other beats in both.
//!
//! **At rest** ([`still`]): the nodes of textures, played by the kernel and its variants, against recordings that the fit has
//! not seen. **In motion** ([`moving`]): a hand that rubs over the grid, against float64 at every sample. **Hard cases**
//! ([`hard`]): those of `stylus stress`, with models cut to the order. **Time** ([`costs`]): instructions counted on QEMU, and
//! cycles of the Cortex-M4's published timings, from `cargo tasks costs`.
//!
//! The error of a choice is the root of the sum of squares of its error at rest and its error in motion, in third-octave
//! bands: the one is of the models, the other of following the hand, and they do not know of each other. Its time is a
//! sample's and its share of an update's.

pub mod costs;
pub mod hard;
mod material;
pub mod moving;
mod pareto;
mod players;
pub mod still;
mod structure;

use model_format::{Library, Provenance, TextureSpec, encode_uncertified};
use rayon::prelude::*;
use serde::Serialize;
use stylus_costs::Peer;

use crate::dsp::MODEL_RATE_HZ;
use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::evaluation::stress::cases::{Case, Length, suite};
use crate::fit;
use crate::fit::Order;
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};
use crate::texture::certificate;
use crate::texture::grid::Grid;
use crate::texture::quantise::{StructureChoice, nodes as quantised_nodes};

use costs::{Core, Cost, Costs};
use hard::{HardCases, Verdict};
use moving::{Frames, Moving};
use still::{Node, Playing, Still};

pub use material::Material;
pub use structure::{FilterStructure, Voice};

/// Orders that are the same for all nodes.
pub const ORDERS: [usize; 6] = [10, 20, 50, 100, 200, 400];

/// Intervals of updates, samples: 0.2 (every sample) to 10 ms at 5 kHz.
pub const INTERVALS: [usize; 6] = [1, 2, 5, 10, 25, 50];

/// Clocks that a sample's time is shown for, Hz.
pub const CLOCKS_HZ: [f64; 3] = [80e6, 168e6, 480e6];

/// How often the material is fitted: at the highest order, and with orders by two criteria.
pub const FITS: usize = 3;

/// Nodes judged at rest, at most; of more recordings evenly spaced ones are taken.
const MAX_NODES: usize = 96;

/// What must be gained for more time to be worth a word: less is the scatter of the measurement.
mod worth {
    /// Of C.
    pub const COST: f64 = 0.005;
    /// Of errors in bands, dB.
    pub const BAND_DB: f64 = 0.05;
}

/// How to compare.
#[derive(Clone, Debug)]
pub struct Options {
    /// Orders that are the same for all nodes.
    pub orders: Vec<usize>,
    /// From three axes to one.
    pub reduction: Reduction,
    /// Width of C's smoothing, Hz.
    pub smoothing_hz: f64,
    /// How long each synthesis at rest is, s.
    pub synthesis_s: f64,
    /// Of the noise.
    pub seed: u64,
    /// The hard cases that are played, at least one.
    pub cases: Vec<Case>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            orders: ORDERS.to_vec(),
            reduction: Reduction::Pca,
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 4.0,
            seed: 1,
            cases: suite(Length::Short),
        }
    }
}

/// What a structure at an order costs and achieves.
#[derive(Clone, Debug, Serialize)]
pub struct Filter {
    /// The structure.
    pub structure: FilterStructure,
    /// How the order was chosen.
    pub order: Order,
    /// The highest order of any node, which a sample's time goes by.
    pub highest_order: usize,
    /// Accuracy at rest.
    pub still: Still,
    /// The hard cases at the highest order.
    pub hard: HardCases,
    /// Textures that `fit` would refuse in this structure, of all.
    pub refused_textures: Vec<String>,
    /// On a Cortex-M4.
    pub m4: Cost,
    /// On a Cortex-M7: instructions counted, cycles bounded by the Cortex-M4's.
    pub m7: Cost,
    /// Flash that a node takes in a library, bytes.
    pub library_bytes_a_node: usize,
    /// RAM for two frames' coefficients and the state, bytes.
    pub ram_bytes: usize,
    /// Whether nothing cheaper has as low a C, all nodes being held.
    pub on_cost_front: bool,
}

impl Filter {
    /// The order in a word: where each node has its own, the criterion and the highest.
    pub fn order_text(&self) -> String {
        match self.order {
            Order::Fixed(order) => order.to_string(),
            Order::Auto => format!("BIC,\u{a0}≤\u{a0}{}", self.highest_order),
            Order::AtMost(_) => format!("AIC,\u{a0}≤\u{a0}{}", self.highest_order),
        }
    }
}

/// A filter with an interval of updates.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// Index of its filter.
    pub filter: usize,
    /// Samples from one update to the next.
    pub interval: usize,
    /// Error in motion, dB, over the textures that are not refused; not a number if all are.
    pub motion_error_db: f64,
    /// Share of bands in motion within the JND.
    pub motion_within_jnd: f64,
    /// Errors at rest and in motion together, dB.
    pub total_error_db: f64,
    /// Samples at full scale while rubbing.
    pub saturations: u32,
    /// Cycles a sample on a Cortex-M4, updates included, at best.
    pub best_cycles: f64,
    /// The same at worst.
    pub worst_cycles: f64,
    /// Whether nothing cheaper has as low an error, all textures being held.
    pub on_front: bool,
    /// Whether nothing cheaper that holds every hard case has as low an error.
    pub on_safe_front: bool,
}

impl Point {
    /// Share of a sample's time at each of [`CLOCKS_HZ`], at worst.
    pub fn shares(&self) -> [f64; 3] {
        CLOCKS_HZ.map(|clock_hz| share(self.worst_cycles, clock_hz))
    }

    /// The interval in ms.
    pub fn interval_ms(&self) -> f64 {
        interval_ms(self.interval)
    }
}

/// An interval of samples in ms.
pub fn interval_ms(samples: usize) -> f64 {
    1000.0 * samples as f64 / f64::from(MODEL_RATE_HZ)
}

/// `cycles` as a share of a sample's 200 µs.
pub fn share(cycles: f64, clock_hz: f64) -> f64 {
    cycles / (clock_hz / f64::from(MODEL_RATE_HZ))
}

/// Everything.
#[derive(Clone, Debug, Serialize)]
pub struct Frontier {
    /// What was fitted and what was held out.
    pub material: String,
    /// Whether any recording is simulated.
    pub simulated: bool,
    /// The textures.
    pub textures: Vec<String>,
    /// Nodes judged at rest.
    pub nodes: usize,
    /// C of one take against the other, with no model between them.
    pub take_cost: f64,
    /// RMS error in bands of one take against the other, dB.
    pub take_band_error_db: f64,
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// The compiler that built what was counted.
    pub rustc: String,
    /// The emulator that counted.
    pub qemu: String,
    /// Other implementations beside ours.
    pub peers: Vec<Peer>,
    /// Structures by orders.
    pub filters: Vec<Filter>,
    /// Filters by intervals.
    pub points: Vec<Point>,
}

/// Models of all textures at one choice of order.
struct Fitted {
    order: Order,
    highest_order: usize,
    /// In the order of [`Prepared::names`].
    grids: Vec<Grid>,
}

/// What is fitted and read, before anything is played.
pub struct Prepared {
    names: Vec<String>,
    fitted: Vec<Fitted>,
    /// Recordings held out, each with its texture's and its node's index.
    held_out: Vec<(usize, usize, Vec<f64>)>,
    take_cost: f64,
    take_band_error_db: f64,
    cases: Vec<Case>,
    material: String,
    simulated: bool,
}

impl Prepared {
    /// Fits the one half of `material` and reads the other; `progress` is told of each trial analysed, [`FITS`] times.
    ///
    /// # Errors
    /// A recording that cannot be used; material without a node that sounds.
    pub fn new(material: &Material, options: &Options, progress: impl Fn() + Sync) -> Result<Self> {
        let fit_at = |order| {
            let options = fit::Options {
                order,
                reduction: options.reduction,
                ..fit::Options::default()
            };
            fit::fit(&material.fit, &options, &progress)
        };
        let highest = fit_at(Order::Fixed(model_format::limits::MAX_ORDER))?;
        let bayesian = fit_at(Order::Auto)?;
        let akaike = Order::AtMost(model_format::limits::MAX_ORDER);
        let names = highest.textures.iter().map(|texture| texture.name.clone());
        let names: Vec<String> = names.collect();
        let grids = |fit: &fit::Fit| -> Vec<Grid> {
            let grids = fit.textures.iter().map(|texture| texture.grid.clone());
            grids.collect()
        };
        let mut fitted: Vec<Fitted> = options
            .orders
            .iter()
            .map(|&order| {
                let mut grids = grids(&highest);
                // Levinson-Durbin's models of a lower order are the first stages of those of a higher one.
                let models = grids.iter_mut().flat_map(|grid| &mut grid.models);
                models.for_each(|model| model.reflection.truncate(order));
                Fitted::new(Order::Fixed(order), grids)
            })
            .collect();
        fitted.push(Fitted::new(Order::Auto, grids(&bayesian)));
        fitted.push(Fitted::new(akaike, grids(&fit_at(akaike)?)));
        let mut prepared = Self {
            names,
            fitted,
            held_out: Vec::new(),
            take_cost: f64::NAN,
            take_band_error_db: f64::NAN,
            cases: options.cases.clone(),
            material: material.description.clone(),
            simulated: material.is_simulated(),
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
        let rate_hz = f64::from(MODEL_RATE_HZ);
        let read = chosen
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|(index, (texture, node))| {
                let (signal, _) = fit::signal(&trials[index], options.reduction)?;
                let take = material.take_of(&trials[index]);
                let between = match take {
                    Some(take) => {
                        let (other, _) = fit::signal(take, options.reduction)?;
                        let cost =
                            spectrum::spectral_cost(&signal, &other, rate_hz, options.smoothing_hz);
                        let bands = spectrum::band_errors_db(&signal, &other, rate_hz);
                        let squares = bands
                            .iter()
                            .flatten()
                            .map(|error| error * error)
                            .sum::<f64>();
                        cost.map(|cost| {
                            (cost, squares / bands.iter().flatten().count().max(1) as f64)
                        })
                    }
                    None => None,
                };
                Ok(((texture, node, signal), between))
            });
        let read = read.collect::<Result<Vec<_>>>()?;
        let takes: Vec<(f64, f64)> = read.iter().filter_map(|(_, between)| *between).collect();
        let count = takes.len() as f64;
        self.take_cost = takes.iter().map(|take| take.0).sum::<f64>() / count;
        self.take_band_error_db = (takes.iter().map(|take| take.1).sum::<f64>() / count).sqrt();
        self.held_out = read.into_iter().map(|(held_out, _)| held_out).collect();
        Ok(())
    }

    /// Index of a trial's texture and node, if that node sounds.
    fn place(&self, set: &RecordingSet, index: usize) -> Option<(usize, usize)> {
        let trial = &set.trials[index];
        let texture = self.names.iter().position(|name| *name == trial.texture)?;
        let grid = &self.fitted[0].grids[texture];
        let node = grid.nodes().position(|(speed, force, model)| {
            let here = speed == trial.speed_mm_s as f32 && force == trial.force_n as f32;
            here && model.output_power > 0.0
        })?;
        Some((texture, node))
    }

    /// Pieces of work that [`Prepared::run`] does.
    pub fn work(&self) -> usize {
        let filters = FilterStructure::ALL.len() * self.fitted.len();
        let references = self.fitted.len() * self.names.len();
        let moving = self.names.len() * INTERVALS.len();
        references + filters * (self.held_out.len() + moving + self.cases.len())
    }

    /// Plays everything, telling `progress` of each piece of work done. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// A lattice that makes no library, or an order that no cost is known for.
    pub fn run(&self, options: &Options, progress: impl Fn() + Sync) -> Result<Frontier> {
        let references = self.references(options.seed, &progress)?;
        let choices: Vec<(FilterStructure, usize)> = FilterStructure::ALL
            .into_iter()
            .flat_map(|structure| (0..self.fitted.len()).map(move |order| (structure, order)))
            .collect();
        let (mut filters, mut points) = (Vec::new(), Vec::new());
        for (structure, order) in choices {
            let fitted = &self.fitted[order];
            let still = self.still(structure, fitted, options, &progress)?;
            let hard = self.hard(structure, fitted.highest_order, &progress)?;
            let libraries = self.libraries(structure, fitted);
            let held = libraries.iter().zip(&self.names);
            let refused = held.filter(|(library, _)| library.is_none());
            let cost = |core| {
                let known = Costs::measured().at(structure, 4, core, fitted.highest_order);
                known.ok_or_else(|| {
                    let order = fitted.highest_order;
                    Error::Request(format!(
                        "no cost is known of a {structure} of order {order} on a {core}"
                    ))
                })
            };
            let filter = Filter {
                structure,
                order: fitted.order,
                highest_order: fitted.highest_order,
                still,
                hard,
                refused_textures: refused.map(|(_, name)| name.clone()).collect(),
                m4: cost(Core::M4)?,
                m7: cost(Core::M7)?,
                library_bytes_a_node: structure.library_bytes_a_node(fitted.highest_order),
                ram_bytes: structure.ram_bytes(fitted.highest_order),
                on_cost_front: false,
            };
            let index = filters.len();
            points.extend(rubbed(
                index,
                &filter,
                &libraries,
                &references[order],
                options.seed,
                &progress,
            )?);
            filters.push(filter);
        }
        let mut frontier = Frontier {
            material: self.material.clone(),
            simulated: self.simulated,
            textures: self.names.clone(),
            nodes: self.held_out.len(),
            take_cost: self.take_cost,
            take_band_error_db: self.take_band_error_db,
            smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
            rustc: Costs::measured().table().rustc.clone(),
            qemu: Costs::measured().table().qemu.clone(),
            peers: Costs::measured().table().peers.clone(),
            filters,
            points,
        };
        frontier.mark_fronts();
        Ok(frontier)
    }

    /// Float64's levels along each texture's rubbing, by choice of order.
    fn references(&self, seed: u64, progress: &(impl Fn() + Sync)) -> Result<Vec<Vec<Frames>>> {
        let of = |fitted: &Fitted| {
            let frames = (0..self.names.len()).into_par_iter().map(|texture| {
                let bytes = self.library(fitted, texture, StructureChoice::Lattice)?;
                let library = decoded(&bytes)?;
                let texture = library.textures().next().expect("one was encoded");
                let frames = moving::reference(&texture, seed);
                progress();
                Ok(frames)
            });
            frames.collect::<Result<Vec<Frames>>>()
        };
        self.fitted.iter().map(of).collect()
    }

    fn still(
        &self,
        structure: FilterStructure,
        fitted: &Fitted,
        options: &Options,
        progress: &(impl Fn() + Sync),
    ) -> Result<Still> {
        let nodes = self
            .held_out
            .par_iter()
            .enumerate()
            .map(|(index, held_out)| {
                let (texture, node, recording) = held_out;
                let grid = &fitted.grids[*texture];
                let (speed_mm_s, force_n, model) =
                    grid.nodes().nth(*node).expect("the node was found in it");
                let alone = Grid {
                    speeds_mm_s: vec![speed_mm_s],
                    forces_n: vec![force_n],
                    models: vec![model.clone()],
                };
                let played = match encoded(&self.names[*texture], &alone, structure.stored_as()) {
                    Err(_) if structure.is_direct() => Ok(None),
                    Err(failure) => Err(failure),
                    Ok(bytes) => {
                        let playing = Playing {
                            smoothing_hz: options.smoothing_hz,
                            synthesis_s: options.synthesis_s,
                            seed: options.seed.wrapping_add(index as u64),
                        };
                        still::play(structure, &bytes, recording, &playing).map(Some)
                    }
                };
                progress();
                played
            });
        let nodes = nodes.collect::<Result<Vec<Option<Node>>>>()?;
        Ok(still::summarise(&nodes))
    }

    fn hard(
        &self,
        structure: FilterStructure,
        order: usize,
        progress: &(impl Fn() + Sync),
    ) -> Result<HardCases> {
        let verdicts = self.cases.par_iter().map(|case| {
            let verdict = hard::play(&hard::of_order(case, order), structure);
            progress();
            verdict
        });
        let verdicts = verdicts.collect::<Result<Vec<Verdict>>>()?;
        let names = self.cases.iter().map(|case| case.name.as_str());
        let named: Vec<(&str, Verdict)> = names.zip(verdicts).collect();
        Ok(hard::summarise(&named))
    }

    /// Each texture's library in a structure; none of a texture that `fit` refuses in it.
    fn libraries(&self, structure: FilterStructure, fitted: &Fitted) -> Vec<Option<Vec<u8>>> {
        let textures = (0..self.names.len()).into_par_iter();
        let libraries = textures.map(|texture| {
            let bytes = self.library(fitted, texture, structure.stored_as()).ok()?;
            let is_stable = |library: &Library<'_>| {
                let mut reports = library
                    .textures()
                    .map(|texture| certificate::certify(&texture));
                reports.all(|report| report.failures().is_empty())
            };
            let holds = decoded(&bytes).is_ok_and(|library| is_stable(&library));
            holds.then_some(bytes)
        });
        libraries.collect()
    }

    fn library(&self, fitted: &Fitted, texture: usize, stored: StructureChoice) -> Result<Vec<u8>> {
        encoded(&self.names[texture], &fitted.grids[texture], stored)
    }
}

impl Fitted {
    fn new(order: Order, grids: Vec<Grid>) -> Self {
        let models = grids.iter().flat_map(|grid| &grid.models);
        let highest = models.map(|model| model.reflection.len()).max();
        Self {
            order,
            highest_order: highest.unwrap_or(0),
            grids,
        }
    }
}

impl Frontier {
    /// Marks what nothing cheaper beats. Where a structure does not hold all nodes or textures it is not in the running.
    fn mark_fronts(&mut self) {
        let costs = self.filters.iter().map(|filter| {
            let holds = filter.still.refused == 0;
            let cost = if holds { filter.still.cost } else { f64::NAN };
            (filter.m4.sample.worst_cycles, cost)
        });
        let on_cost_front = pareto::front(&costs.collect::<Vec<_>>(), worth::COST);
        let front = |holds: fn(&Filter) -> bool| {
            let points = self.points.iter().map(|point| {
                let filter = &self.filters[point.filter];
                let is_played = filter.still.refused == 0 && filter.refused_textures.is_empty();
                let error = if is_played && holds(filter) {
                    point.total_error_db
                } else {
                    f64::NAN
                };
                (point.worst_cycles, error)
            });
            pareto::front(&points.collect::<Vec<_>>(), worth::BAND_DB)
        };
        let on_front = front(|_| true);
        let on_safe_front = front(|filter| filter.hard.held == filter.hard.cases);
        for (filter, on_front) in self.filters.iter_mut().zip(on_cost_front) {
            filter.on_cost_front = on_front;
        }
        let marks = on_front.into_iter().zip(on_safe_front);
        for (point, (on_front, on_safe_front)) in self.points.iter_mut().zip(marks) {
            (point.on_front, point.on_safe_front) = (on_front, on_safe_front);
        }
    }
}

/// A filter's choices: each interval of updates, played along every texture that it holds.
fn rubbed(
    index: usize,
    filter: &Filter,
    libraries: &[Option<Vec<u8>>],
    references: &[Frames],
    seed: u64,
    progress: &(impl Fn() + Sync),
) -> Result<Vec<Point>> {
    let runs = INTERVALS
        .into_par_iter()
        .flat_map_iter(|interval| (0..libraries.len()).map(move |texture| (interval, texture)));
    let moved = runs.map(|(interval, texture)| {
        let moved = match &libraries[texture] {
            None => Ok(None),
            Some(bytes) => decoded(bytes).map(|library| {
                let played = library.textures().next().expect("one was encoded");
                let reference = &references[texture];
                Some(moving::play(
                    filter.structure,
                    played,
                    reference,
                    interval,
                    seed,
                ))
            }),
        };
        progress();
        moved
    });
    let moved = moved.collect::<Result<Vec<Option<Moving>>>>()?;
    let of_intervals = moved.chunks(libraries.len());
    let points = of_intervals.zip(INTERVALS).map(|(moved, interval)| {
        let moved = moved.iter().flatten().copied().reduce(Moving::and);
        let error_db = moved.map_or(f64::NAN, |moved| moved.band_error_db());
        let (best_cycles, worst_cycles) = cycles(&filter.m4, moved.as_ref(), interval);
        Point {
            filter: index,
            interval,
            motion_error_db: error_db,
            motion_within_jnd: moved.map_or(f64::NAN, |moved| moved.bands_within_jnd()),
            total_error_db: error_db.hypot(filter.still.band_error_db),
            saturations: moved.map_or(0, |moved| moved.saturations),
            best_cycles,
            worst_cycles,
            on_front: false,
            on_safe_front: false,
        }
    });
    Ok(points.collect())
}

/// Cycles a sample, updates included, at best and at worst. At worst those that stay in their cell take that share of the dearest
/// which their instructions are; at best all are as cheap as the cheapest.
fn cycles(cost: &Cost, moved: Option<&Moving>, interval: usize) -> (f64, f64) {
    let (same, new) = match moved {
        Some(moved) => moved.updates_a_sample(),
        None => (1.0 / interval as f64, 0.0),
    };
    let least = cost.update.instructions_least / cost.update.instructions_most;
    (
        cost.sample.best_cycles + (same + new) * cost.update.best_cycles,
        cost.sample.worst_cycles + (same * least + new) * cost.update.worst_cycles,
    )
}

fn encoded(name: &str, grid: &Grid, stored: StructureChoice) -> Result<Vec<u8>> {
    let spec = TextureSpec {
        name: name.to_owned(),
        sample_rate_hz: MODEL_RATE_HZ,
        structure: stored.structure(),
        // It is never written anywhere.
        provenance: Provenance::Simulated,
        speed_axis_mm_s: grid.speeds_mm_s.clone(),
        force_axis_n: grid.forces_n.clone(),
        nodes: quantised_nodes(name, grid, stored)?,
        cell_margins: Vec::new(),
    };
    // Whether it is stable between its nodes is asked where it is moved.
    encode_uncertified(&[spec]).map_err(|failure| Error::Model(failure.to_string()))
}

fn decoded(bytes: &[u8]) -> Result<Library<'_>> {
    Library::decode_uncertified(bytes).map_err(|failure| Error::Model(failure.to_string()))
}
