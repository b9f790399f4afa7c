//! The comparison itself: every structure at every order, at rest, in motion and on the hard cases.

use model_format::PartsSpec;
use rayon::prelude::*;
use stylus_fit::texture::grid::Grid;
use stylus_fit::texture::library::{decoded, library_of};
use stylus_support::{Error, Result};

use super::costs::{Core, Cost, Costs};
use super::hard::{self, HardCases, Verdict};
use super::moving::{self, Frames, Moving};
use super::players::{library_bytes_per_node, predictors, ram_bytes};
use super::prepared::{Fitted, Prepared};
use super::results::{Filter, Frontier, Point, mark_fronts};
use super::still::{self, Node, Playing, Still};
use super::{INTERVALS, Options};
use stylus_costs::Structure;

fn known_cost(structure: Structure, order: usize, core: Core) -> Result<Cost> {
    let known = Costs::measured().at(structure, 4, core, order);
    known.ok_or_else(|| {
        Error::Request(format!(
            "no cost is known of a {structure} of order {order} on a {core}"
        ))
    })
}

impl Prepared {
    /// Number of pieces of work that [`Prepared::run`] does.
    pub fn work(&self) -> usize {
        let filters = Structure::ALL.len() * self.fitted.len();
        let references = self.fitted.len() * self.names.len();
        let moving = self.names.len() * INTERVALS.len();
        references + filters * (self.held_out.len() + moving + self.cases.len())
    }

    /// Plays everything, and calls `progress` after each piece of work. The result does not depend on the number of
    /// threads.
    ///
    /// # Errors
    /// A lattice that cannot be encoded as a library, or an order whose cost is not known.
    pub fn run(&self, options: &Options, progress: impl Fn() + Sync) -> Result<Frontier> {
        let references = self.references(options.seed, &progress)?;
        let choices: Vec<(Structure, usize)> = Structure::ALL
            .into_iter()
            .flat_map(|structure| (0..self.fitted.len()).map(move |order| (structure, order)))
            .collect();
        let (mut filters, mut points) = (Vec::new(), Vec::new());
        // One choice after the other: each plays in parallel, and the libraries of one choice are in memory.
        for (structure, order) in choices {
            let fitted = &self.fitted[order];
            let still = self.still(structure, fitted, options, &progress)?;
            let hard = self.hard(structure, fitted.highest_order, &progress)?;
            let libraries = self.libraries(structure, fitted);
            let refused = libraries
                .iter()
                .zip(&self.names)
                .filter(|(library, _)| library.is_none());
            let cost = |core| known_cost(structure, fitted.highest_order, core);
            let filter = Filter {
                structure,
                order: fitted.order,
                highest_order: fitted.highest_order,
                still,
                hard,
                refused_textures: refused.map(|(_, name)| name.clone()).collect(),
                m4: cost(Core::M4)?,
                m7: cost(Core::M7)?,
                library_bytes_per_node: library_bytes_per_node(structure, fitted.highest_order),
                ram_bytes: ram_bytes(structure, fitted.highest_order),
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
            llvm_mca: Costs::measured().table().llvm_mca.clone(),
            peers: Costs::measured().table().peers.clone(),
            filters,
            points,
        };
        mark_fronts(&mut frontier);
        Ok(frontier)
    }

    /// Computes the levels of the float64 reference during each texture's rub, by choice of the order.
    fn references(&self, seed: u64, progress: &(impl Fn() + Sync)) -> Result<Vec<Vec<Frames>>> {
        let of = |fitted: &Fitted| {
            (0..self.names.len())
                .into_par_iter()
                .map(|texture| {
                    let bytes = self.library(fitted, texture)?;
                    let library = decoded(&bytes)?;
                    let texture = library.textures().next().expect("one was encoded");
                    let frames = moving::reference(&texture, seed);
                    progress();
                    Ok(frames)
                })
                .collect::<Result<Vec<Frames>>>()
        };
        self.fitted.iter().map(of).collect()
    }

    fn still(
        &self,
        structure: Structure,
        fitted: &Fitted,
        options: &Options,
        progress: &(impl Fn() + Sync),
    ) -> Result<Still> {
        let nodes = self.held_out.par_iter().enumerate().map(|(index, held_out)| {
            let (texture, node, recording) = held_out;
            let grid = &fitted.grids[*texture];
            let (speed_mm_s, force_n, model) = grid.nodes().nth(*node).expect("the node was found in it");
            let alone = Grid {
                speeds_mm_s: vec![speed_mm_s],
                forces_n: vec![force_n],
                models: vec![model.clone()],
                laws: grid.laws,
                // Without parts, so that Gaussian noise excites all structures alike.
                parts: PartsSpec::default(),
            };
            let playing = Playing {
                smoothing_hz: options.smoothing_hz,
                synthesis_s: options.synthesis_s,
                seed: options.seed.wrapping_add(index as u64),
            };
            let played = library_of(&self.names[*texture], &alone)
                .and_then(|bytes| still::play(structure, &bytes, recording, &playing));
            progress();
            played
        });
        let nodes = nodes.collect::<Result<Vec<Option<Node>>>>()?;
        Ok(still::summarise(&nodes))
    }

    fn hard(&self, structure: Structure, order: usize, progress: &(impl Fn() + Sync)) -> Result<HardCases> {
        let verdicts = self
            .cases
            .par_iter()
            .map(|case| {
                let verdict = hard::play(&hard::of_order(case, order), structure);
                progress();
                verdict
            })
            .collect::<Result<Vec<Verdict>>>()?;
        let named: Vec<(&str, Verdict)> = self.cases.iter().map(|case| case.name.as_str()).zip(verdicts).collect();
        Ok(hard::summarise(&named))
    }

    /// Returns each texture's library; none for a texture that `structure` cannot hold.
    fn libraries(&self, structure: Structure, fitted: &Fitted) -> Vec<Option<Vec<u8>>> {
        let textures = (0..self.names.len()).into_par_iter();
        let libraries = textures.map(|texture| {
            // The references were made of the same libraries, so none of them fails here.
            let bytes = self.library(fitted, texture).ok()?;
            decoded(&bytes)
                .is_ok_and(|library| {
                    let mut textures = library.textures();
                    textures.all(|texture| predictors(structure, &texture).is_ok())
                })
                .then_some(bytes)
        });
        libraries.collect()
    }

    fn library(&self, fitted: &Fitted, texture: usize) -> Result<Vec<u8>> {
        library_of(&self.names[texture], &fitted.grids[texture])
    }
}

/// Returns a filter's choices: each interval of updates, played during the rub over every texture that the filter
/// holds.
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
    let moved = runs
        .map(|(interval, texture)| {
            let moved = match &libraries[texture] {
                None => Ok(None),
                Some(bytes) => decoded(bytes).map(|library| {
                    let played = library.textures().next().expect("one was encoded");
                    let reference = &references[texture];
                    moving::play(filter.structure, played, reference, interval, seed).ok()
                }),
            };
            progress();
            moved
        })
        .collect::<Result<Vec<Option<Moving>>>>()?;
    // Parallel iterators keep the order, so the textures of an interval follow each other.
    Ok(moved
        .chunks(libraries.len())
        .zip(INTERVALS)
        .map(|(moved, interval)| {
            let moved = moved.iter().flatten().copied().reduce(Moving::and);
            let error_db = moved.map_or(f64::NAN, |moved| moved.band_error_db());
            Point {
                filter: index,
                interval,
                motion_error_db: error_db,
                motion_within_jnd: moved.map_or(f64::NAN, |moved| moved.bands_within_jnd()),
                total_error_db: error_db.hypot(filter.still.band_error_db),
                saturations: moved.map_or(0, |moved| moved.saturations),
                cycles: cycles(&filter.m7, moved.as_ref(), interval),
                on_front: false,
                on_safe_front: false,
            }
        })
        .collect())
}

/// Returns the cycles per sample, including updates. An update that stays in its cell takes a fraction of the cycles of
/// the most expensive update. The fraction is the ratio of their instructions.
fn cycles(cost: &Cost, moved: Option<&Moving>, interval: usize) -> f64 {
    let (same, new) = match moved {
        Some(moved) => moved.updates_per_sample(),
        None => (1.0 / interval as f64, 0.0),
    };
    let least = cost.update.instructions_least / cost.update.instructions_most;
    cost.sample.cycles + (same * least + new) * cost.update.cycles
}
