//! The optional parts of a texture: what they cost, and what they bring that no spectrum shows.
//!
//! They are a choice beside structure, order and interval: they add instructions to the tick or the update, and bytes
//! to the library. They bring nearness to a held-out recording in kurtosis, modulation and levels, against Gaussian
//! noise through the same filter. The structures are compared without them, because the variants that are not shipped
//! do not play them.

use model_format::{Library, MillimetresPerSecond, Newton, PartsSpec, SAMPLE_RATE_HZ, Texture};
use rayon::prelude::*;
use serde::Serialize;
use stylus_kernel::scene::Plan;
use stylus_kernel::scene::cost::FEED;

use crate::dsp::spectrum;
use crate::evaluation::evaluate::WARM_UP_S;
use crate::evaluation::liveliness::{Role, Signals, Summary, TrialLiveliness, summaries};
use crate::evaluation::played;
use crate::evaluation::tables::number;
use crate::playing::motion::MotionPath;
use crate::playing::render::render;
use crate::support::error::{Error, Result};
use crate::texture::grid::Grid;
use crate::texture::library::library_of;
use crate::texture::parts::{Between, on_grid};

use super::Options;
use super::prepared::Prepared;

/// A choice of parts, with its costs and what it plays.
#[derive(Clone, Debug, Serialize)]
pub struct PartsRow {
    /// The parts that are played where a texture has them, in words.
    pub parts: String,
    /// Textures that have one of them.
    pub textures: usize,
    /// Instructions of a tick of a normalised lattice, of the dearest texture, as the device counts them.
    pub tick_instructions: u32,
    /// Instructions of the update per sample that make the excitation, at most.
    pub update_instructions_per_sample: u32,
    /// Bytes that they take in the library, of the texture with the most.
    pub library_bytes: usize,
    /// RMS error of third-octave bands at rest, dB.
    pub band_error_db: f64,
    /// The recordings, and what is played: medians over nodes.
    pub liveliness: Vec<Summary>,
    /// Samples at full scale.
    pub saturations: u32,
}

/// The headings of [`PartsRow::cells`].
pub(super) const PARTS_COLUMNS: [&str; 10] = [
    "parts",
    "textures",
    "tick, instructions",
    "update, instructions per sample",
    "library, bytes",
    "bands, dB",
    "kurtosis off, log2",
    "modulation off, dB",
    "levels off, dB",
    "line's range, dB",
];

impl PartsRow {
    /// The choice as a table's row, under [`PARTS_COLUMNS`].
    pub(super) fn cells(&self) -> Vec<String> {
        let played = self.liveliness.iter().find(|s| s.role == Role::Synthesis);
        let of =
            |pick: fn(&Summary) -> Option<f64>, decimals| number(played.and_then(pick), decimals);
        vec![
            self.parts.clone(),
            self.textures.to_string(),
            self.tick_instructions.to_string(),
            self.update_instructions_per_sample.to_string(),
            self.library_bytes.to_string(),
            format!("{:.2}", self.band_error_db),
            of(|s| s.differences.kurtosis_octaves, 2),
            of(|s| s.differences.modulation_db, 1),
            of(|s| s.differences.level_spread_db, 1),
            of(|s| s.median.line_range_db, 1),
        ]
    }
}

/// A choice of a texture's parts.
type Choice = fn(&PartsSpec) -> PartsSpec;

const CHOICES: [Choice; 5] = [
    |_| PartsSpec::default(),
    |all| PartsSpec {
        modulation: all.modulation.clone(),
        ..PartsSpec::default()
    },
    |all| PartsSpec {
        excitation: all.excitation.clone(),
        ..PartsSpec::default()
    },
    |all| PartsSpec {
        lines: None,
        ..all.clone()
    },
    PartsSpec::clone,
];

/// One node's synthesis, measured.
struct Node {
    liveliness: TrialLiveliness,
    band_square_db: f64,
    saturations: u32,
}

/// Returns each choice that plays something else than those before it: the parts of every texture of `grids`.
pub(super) fn choices(grids: &[Grid]) -> Vec<Vec<PartsSpec>> {
    let mut choices: Vec<Vec<PartsSpec>> = Vec::new();
    for choice in CHOICES {
        let chosen = grids.iter().map(|grid| choice(&grid.parts)).collect();
        if !choices.contains(&chosen) {
            choices.push(chosen);
        }
    }
    choices
}

impl Prepared {
    /// Plays every held-out node with each choice of parts, telling `progress` of each.
    ///
    /// # Errors
    /// A grid that makes no library.
    pub(super) fn parts(
        &self,
        options: &Options,
        progress: &(impl Fn() + Sync),
    ) -> Result<Vec<PartsRow>> {
        let rows = choices(&self.with_parts).into_iter();
        rows.map(|chosen| self.row(&chosen, options, progress))
            .collect()
    }

    fn row(
        &self,
        chosen: &[PartsSpec],
        options: &Options,
        progress: &(impl Fn() + Sync),
    ) -> Result<PartsRow> {
        let of_texture = |(texture, parts): (usize, &PartsSpec)| {
            let grid = &self.with_parts[texture];
            let bytes = |parts: &PartsSpec| {
                let grid = Grid {
                    parts: parts.clone(),
                    ..grid.clone()
                };
                library_of(&self.names[texture], &grid)
            };
            let (with, without) = (bytes(parts)?, bytes(&PartsSpec::default())?);
            let (tick, update) = of_library(&with, |texture| {
                let tick = Plan::of_texture(texture).worst_case().instructions();
                Ok((tick, if texture.is_fed() { FEED } else { 0 }))
            })?;
            Ok((tick, update, with.len() - without.len()))
        };
        let costs = chosen.iter().enumerate().map(of_texture);
        let costs: Vec<(u32, u32, usize)> = costs.collect::<Result<_>>()?;
        let nodes = self.held_out.par_iter().enumerate().map(|(index, held)| {
            let seed = options.seed.wrapping_add(index as u64);
            let node = self.node(&chosen[held.0], held, options, seed);
            progress();
            node
        });
        let nodes: Vec<Node> = nodes.collect::<Result<_>>()?;
        let squares: f64 = nodes.iter().map(|node| node.band_square_db).sum();
        // The choice is named by all that any texture plays.
        let any = PartsSpec {
            excitation: chosen.iter().find_map(|parts| parts.excitation.clone()),
            modulation: chosen.iter().find_map(|parts| parts.modulation.clone()),
            lines: chosen.iter().find_map(|parts| parts.lines.clone()),
        };
        let has = |parts: &&PartsSpec| **parts != PartsSpec::default();
        Ok(PartsRow {
            parts: played::in_words(&any),
            textures: chosen.iter().filter(has).count(),
            tick_instructions: costs.iter().map(|cost| cost.0).max().unwrap_or(0),
            update_instructions_per_sample: costs.iter().map(|cost| cost.1).max().unwrap_or(0),
            library_bytes: costs.iter().map(|cost| cost.2).max().unwrap_or(0),
            band_error_db: (squares / nodes.len().max(1) as f64).sqrt(),
            liveliness: summaries(nodes.iter().map(|node| &node.liveliness)),
            saturations: nodes.iter().map(|node| node.saturations).sum(),
        })
    }

    /// Plays a held-out node with `parts` of its texture.
    fn node(
        &self,
        parts: &PartsSpec,
        (texture, node, recording): &(usize, usize, Vec<f64>),
        options: &Options,
        seed: u64,
    ) -> Result<Node> {
        let grid = &self.with_parts[*texture];
        let (speed_mm_s, force_n, model) =
            grid.nodes().nth(*node).expect("the node was found in it");
        let alone = Grid {
            speeds_mm_s: vec![speed_mm_s],
            forces_n: vec![force_n],
            models: vec![model.clone()],
            laws: grid.laws,
            parts: on_grid(parts, &[Between::at(*node)]),
        };
        let bytes = library_of(&self.names[*texture], &alone)?;
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let (synthesised, saturations) = of_library(&bytes, |texture| {
            let seconds = (recording.len() as f64 / rate_hz).max(options.synthesis_s) + WARM_UP_S;
            let motion = MotionPath::constant(MillimetresPerSecond(speed_mm_s), Newton(force_n))?;
            let rendered = render(texture, &motion, seconds, seed)?;
            let warm_up = (WARM_UP_S * rate_hz) as usize;
            let synthesised = rendered.accelerations_m_s2().split_off(warm_up);
            Ok((synthesised, rendered.saturations))
        })?;
        let errors = spectrum::band_errors_db(recording, &synthesised, rate_hz);
        let errors: Vec<f64> = errors.into_iter().flatten().collect();
        let squares: f64 = errors.iter().map(|error| error * error).sum();
        Ok(Node {
            liveliness: TrialLiveliness::of(&Signals {
                judged: std::slice::from_ref(recording),
                synthesised: &synthesised,
                parts: "",
                versions: &[],
                other: &[],
            }),
            band_square_db: squares / errors.len().max(1) as f64,
            saturations,
        })
    }
}

/// Calls `work` with the only texture of a library.
fn of_library<T>(bytes: &[u8], work: impl FnOnce(Texture<'_>) -> Result<T>) -> Result<T> {
    let library = Library::decode(bytes).map_err(|failure| Error::Model(failure.to_string()))?;
    work(library.textures().next().expect("one was encoded"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::model::Model;
    use model_format::{Laws, LineSpec, LinesSpec, ModulationSpec};

    fn grid(parts: PartsSpec) -> Grid {
        Grid {
            speeds_mm_s: vec![100.0],
            forces_n: vec![1.0],
            models: vec![Model::silent()],
            laws: Laws::default(),
            parts,
        }
    }

    #[test]
    fn choices_go_from_none_to_all_and_none_is_there_twice() {
        let modulation = PartsSpec {
            modulation: Some(ModulationSpec {
                step_samples: 100,
                entries: vec![0; 20],
            }),
            ..PartsSpec::default()
        };
        let all = PartsSpec {
            lines: Some(LinesSpec {
                lines: vec![LineSpec {
                    wavelength_mm: 1.0,
                    phase: 0,
                    amplitudes: vec![1.0],
                }],
            }),
            ..modulation.clone()
        };
        let none = PartsSpec::default();
        assert_eq!(choices(&[grid(none.clone())]), [vec![none.clone()]]);
        assert_eq!(
            choices(&[grid(all.clone()), grid(none.clone())]),
            [
                vec![none.clone(), none.clone()],
                vec![modulation, none.clone()],
                vec![all, none]
            ]
        );
    }
}
