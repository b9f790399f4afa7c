//! Spectra of the recorded nodes of a texture, and what they predict at other speeds and forces.

use std::sync::{Arc, OnceLock};

use crate::dsp::log_spectrum::LogSpectrum;
use crate::recording::Trial;
use crate::texture::grid::{Grid, as_written, is_recorded};

mod surface_and_tool;

use surface_and_tool::{FEWEST_SPEEDS, SurfaceAndTool};

/// The spectra of a texture's recorded nodes: all trials of a node together, from the `signals` of the texture's
/// trials. Silent nodes have none.
pub fn recorded_spectra(grid: &Grid, signals: &[(&Trial, &[f64])]) -> RecordedSpectra {
    let nodes: Vec<_> = grid.nodes().collect();
    let spectra = nodes.iter().map(|(speed, force, model)| {
        if !is_recorded(model.flags) {
            return None;
        }
        let is_of_node =
            |trial: &Trial| trial.speed_mm_s as f32 == *speed && trial.force_n as f32 == *force;
        let of_node = signals.iter().filter(|(trial, _)| is_of_node(trial));
        let of_node: Vec<&[f64]> = of_node.map(|(_, signal)| *signal).collect();
        LogSpectrum::estimate(&of_node)
    });
    let as_written = |axis: &[f32]| axis.iter().map(|&value| as_written(value)).collect();
    RecordedSpectra::new(
        as_written(&grid.speeds_mm_s),
        as_written(&grid.forces_n),
        spectra.collect(),
    )
}

/// The recorded spectra of one texture.
#[derive(Clone, Debug)]
pub struct RecordedSpectra {
    /// Tangential speeds, mm/s, ascending.
    pub speeds_mm_s: Vec<f64>,
    /// Normal forces, N, ascending.
    pub forces_n: Vec<f64>,
    /// Speed-major; none where nothing was recorded, or silence.
    spectra: Vec<Option<LogSpectrum>>,
    /// Surface and tool of every force with enough speeds, taken apart when first asked for: thousands of places may be
    /// asked for, and each would take them apart again.
    apart: Vec<Arc<OnceLock<SurfaceAndTool>>>,
}

/// A node by the indices of its speed and its force.
pub type NodeIndex = (usize, usize);

impl RecordedSpectra {
    /// The field of `spectra`, speed-major, none where nothing was recorded or silence, at ascending speeds, mm/s, and
    /// forces, N.
    /// Panics if there is not one spectrum, or none, for each node.
    pub fn new(
        speeds_mm_s: Vec<f64>,
        forces_n: Vec<f64>,
        spectra: Vec<Option<LogSpectrum>>,
    ) -> Self {
        assert_eq!(spectra.len(), speeds_mm_s.len() * forces_n.len());
        Self {
            apart: forces_n.iter().map(|_| Arc::default()).collect(),
            speeds_mm_s,
            forces_n,
            spectra,
        }
    }

    /// The spectrum at a node, if it was recorded.
    pub fn spectrum(&self, (speed, force): NodeIndex) -> Option<&LogSpectrum> {
        self.spectra[speed * self.forces_n.len() + force].as_ref()
    }

    /// The spectrum at a speed, mm/s, from those recorded at one force, node `without` left out. `None` if the speed is
    /// not between two of them.
    ///
    /// Of enough speeds surface and tool are taken apart; of few, the neighbours are warped whole.
    pub fn along_speed(
        &self,
        speed_mm_s: f64,
        force: usize,
        without: Option<NodeIndex>,
    ) -> Option<LogSpectrum> {
        let members = self.row(force, without);
        let above = members.partition_point(|member| member.0 < speed_mm_s);
        let (low, high) = (members.get(above.checked_sub(1)?)?, members.get(above)?);
        if members.len() >= FEWEST_SPEEDS {
            let apart = || SurfaceAndTool::of(&members);
            return Some(match without {
                None => self.apart[force].get_or_init(apart).at(speed_mm_s),
                Some(_) => apart().at(speed_mm_s),
            });
        }
        let share = (speed_mm_s - low.0) / (high.0 - low.0);
        Some(LogSpectrum::mean(&[
            (1.0 - share, &low.1.warped(low.0, speed_mm_s)),
            (share, &high.1.warped(high.0, speed_mm_s)),
        ]))
    }

    /// The recorded spectra at one force, by their speeds.
    fn row(&self, force: usize, without: Option<NodeIndex>) -> Vec<(f64, &LogSpectrum)> {
        (0..self.speeds_mm_s.len())
            .filter(|&speed| without != Some((speed, force)) && self.speeds_mm_s[speed] > 0.0)
            .filter_map(|speed| Some((self.speeds_mm_s[speed], self.spectrum((speed, force))?)))
            .collect()
    }

    /// The spectrum at a force, N, from those recorded at one speed, node `without` left out: the mean of the nearest
    /// on both sides. `None` if there are none. Force moves no line, so nothing is warped.
    pub fn along_force(
        &self,
        speed: usize,
        force_n: f64,
        without: Option<NodeIndex>,
    ) -> Option<LogSpectrum> {
        let known = |force: usize| {
            let there = self.spectrum((speed, force))?;
            (without != Some((speed, force))).then_some((self.forces_n[force], there))
        };
        let above = self.forces_n.partition_point(|&known| known < force_n);
        let low = (0..above).rev().find_map(known)?;
        let high = (above..self.forces_n.len()).find_map(known)?;
        let share = (force_n - low.0) / (high.0 - low.0);
        Some(LogSpectrum::mean(&[(1.0 - share, low.1), (share, high.1)]))
    }

    /// The spectrum at any speed, mm/s, and force, N, between recorded ones: of the forces around it, each at that
    /// speed.
    pub fn at(&self, speed_mm_s: f64, force_n: f64) -> Option<LogSpectrum> {
        let row = |force: usize| {
            let same = |known: &f64| (known - speed_mm_s).abs() < 1e-6;
            let recorded = self.speeds_mm_s.iter().position(same);
            match recorded.and_then(|speed| self.spectrum((speed, force))) {
                Some(spectrum) => Some(spectrum.clone()),
                None => self.along_speed(speed_mm_s, force, None),
            }
        };
        let same = |known: &f64| (known - force_n).abs() < 1e-6;
        if let Some(force) = self.forces_n.iter().position(same) {
            return row(force);
        }
        let above = self.forces_n.partition_point(|&known| known < force_n);
        let below = above.checked_sub(1)?;
        let span = self.forces_n.get(above)? - self.forces_n[below];
        let share = (force_n - self.forces_n[below]) / span;
        Some(LogSpectrum::mean(&[
            (1.0 - share, &row(below)?),
            (share, &row(above)?),
        ]))
    }

    /// Predicts the spectrum of the node at `place` from all other nodes: the mean of the spectra along speed
    /// and along force, each with the weight that serves best elsewhere on the grid.
    pub fn without(&self, place: NodeIndex, both: &TwoWays) -> Option<LogSpectrum> {
        let (along_speed, along_force) = &both.0[place.0 * self.forces_n.len() + place.1];
        match (along_speed, along_force) {
            (Some(speed), Some(force)) => {
                let weight = both.weight_of_speed(self, place);
                Some(LogSpectrum::mean(&[(weight, speed), (1.0 - weight, force)]))
            }
            (Some(one), None) | (None, Some(one)) => Some(one.clone()),
            (None, None) => None,
        }
    }
}

/// Predictions of every node from the others along its row and along its column, speed-major.
#[derive(Clone, Debug)]
pub struct TwoWays(Vec<(Option<LogSpectrum>, Option<LogSpectrum>)>);

impl TwoWays {
    /// Of every node of `field`, recorded or not, itself left out.
    pub fn of(field: &RecordedSpectra) -> Self {
        use rayon::prelude::*;
        let forces = field.forces_n.len();
        let places = 0..field.spectra.len();
        let ways = places.into_par_iter().map(|index| {
            let place = (index / forces, index % forces);
            let speed = field.along_speed(field.speeds_mm_s[place.0], place.1, Some(place));
            let force = field.along_force(place.0, field.forces_n[place.1], Some(place));
            (speed, force)
        });
        Self(ways.collect())
    }

    /// The way along speed alone.
    pub fn along_speed(&self, field: &RecordedSpectra, place: NodeIndex) -> Option<&LogSpectrum> {
        self.0[place.0 * field.forces_n.len() + place.1].0.as_ref()
    }

    /// The way along force alone.
    pub fn along_force(&self, field: &RecordedSpectra, place: NodeIndex) -> Option<&LogSpectrum> {
        self.0[place.0 * field.forces_n.len() + place.1].1.as_ref()
    }

    /// The weight of the way along speed against that along force, by least squares over all recorded nodes that share
    /// neither speed nor force with `place`: what is recorded there has no part in it.
    fn weight_of_speed(&self, field: &RecordedSpectra, place: NodeIndex) -> f64 {
        let forces = field.forces_n.len();
        let (mut product, mut square) = (0.0, 0.0);
        for (index, ways) in self.0.iter().enumerate() {
            let (speed, force) = (index / forces, index % forces);
            let (Some(target), (Some(a), Some(b))) = (field.spectrum((speed, force)), ways) else {
                continue;
            };
            if speed == place.0 || force == place.1 {
                continue;
            }
            for bin in judged_bins() {
                let difference = a.values()[bin] - b.values()[bin];
                product += (target.values()[bin] - b.values()[bin]) * difference;
                square += difference * difference;
            }
        }
        if square > 0.0 {
            (product / square).clamp(0.0, 1.0)
        } else {
            0.5
        }
    }
}

/// Bins by which weights are chosen: sixty a decade from 18 to 1100 Hz, so that every band counts alike.
fn judged_bins() -> impl Iterator<Item = usize> {
    const COUNT: i32 = 107;
    (0..COUNT).map(|n| {
        let frequency_hz = 18.0 * 10f64.powf(f64::from(n) / 60.0);
        (frequency_hz / crate::dsp::log_spectrum::STEP_HZ).round() as usize
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::log_spectrum::BINS;
    use test_helpers::near;

    /// Levels over a grid: level(speed index, force index), in nepers of power.
    fn field(level: impl Fn(usize, usize) -> Option<f64>) -> RecordedSpectra {
        let (speeds, forces) = (6, 4);
        RecordedSpectra::new(
            (1..=speeds).map(|s| 20.0 * s as f64).collect(),
            (1..=forces).map(|f| 0.2 * f as f64).collect(),
            (0..speeds * forces)
                .map(|i| {
                    level(i / forces, i % forces).map(|l| LogSpectrum::from_values(vec![l; BINS]))
                })
                .collect(),
        )
    }

    #[test]
    fn the_way_that_serves_elsewhere_gets_the_weight() {
        // Straight along force, jumping along speed.
        let field = field(|speed, force| Some(0.3 * force as f64 + 5.0 * (speed % 2) as f64));
        let ways = TwoWays::of(&field);
        let there = field.without((2, 1), &ways).unwrap();
        near(there.values()[400], 0.3, 1e-6);
    }

    #[test]
    fn what_was_recorded_at_a_node_has_no_part_in_its_prediction() {
        let level = |speed: usize, force: usize| Some(0.7 * speed as f64 - (force as f64).powi(2));
        let plain = field(level);
        let odd = field(|speed, force| {
            if (speed, force) == (3, 2) {
                Some(40.0)
            } else {
                level(speed, force)
            }
        });
        let predicted =
            |field: &RecordedSpectra| field.without((3, 2), &TwoWays::of(field)).unwrap();
        assert_eq!(predicted(&plain), predicted(&odd));
    }

    #[test]
    fn beyond_the_recorded_nodes_there_is_no_way() {
        let field = field(|speed, force| (force > 0).then_some(speed as f64));
        let ways = TwoWays::of(&field);
        assert!(field.without((0, 0), &ways).is_none());
        assert!(ways.along_force(&field, (2, 1)).is_none());
        assert!(ways.along_speed(&field, (2, 1)).is_some());
        assert!(field.along_speed(500.0, 1, None).is_none());
    }
}
