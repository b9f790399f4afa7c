//! Spectra of the recorded nodes of a texture, and what they predict at other speeds and forces.

use std::sync::{Arc, OnceLock};

use crate::dsp::log_spectrum::LogSpectrum;
use crate::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use crate::recording::Trial;
use crate::texture::grid::{Grid, as_written, is_recorded};

mod surface_and_tool;

use surface_and_tool::{FEWEST_SPEEDS, SurfaceAndTool};

/// Returns the spectra of a texture's recorded nodes, from the `signals` of its trials. All trials of a node are
/// combined. Silent nodes have no spectrum.
pub fn recorded_spectra(grid: &Grid, signals: &[(&Trial, &[f64])]) -> RecordedSpectra {
    let nodes: Vec<_> = grid.nodes().collect();
    let spectra = nodes.iter().map(|(speed, force, model)| {
        if !is_recorded(model.flags) {
            return None;
        }
        // The grid's axes are these values in single precision, so equality is exact.
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
    /// Spectra of the nodes, speed-major; `None` where nothing, or only silence, was recorded.
    spectra: Vec<Option<LogSpectrum>>,
    /// Decomposition into surface and tool for every force with enough speeds, computed when first needed. It is kept
    /// because thousands of positions may be asked for.
    apart: Vec<Arc<OnceLock<SurfaceAndTool>>>,
}

/// A node, as the indices of its speed and its force.
pub type NodeIndex = (usize, usize);

impl RecordedSpectra {
    /// Creates the field of `spectra`, speed-major, at ascending speeds, mm/s, and forces, N. A spectrum is `None`
    /// where nothing, or only silence, was recorded.
    /// Panics if the number of spectra is not that of the nodes.
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

    /// Returns the spectrum at a node, if it was recorded.
    pub fn spectrum(&self, place: NodeIndex) -> Option<&LogSpectrum> {
        self.spectra[self.index(place)].as_ref()
    }

    /// Index of a node, speed-major.
    fn index(&self, (speed, force): NodeIndex) -> usize {
        speed * self.forces_n.len() + force
    }

    /// Returns all nodes, recorded or not, speed-major.
    fn places(&self) -> impl Iterator<Item = NodeIndex> {
        let forces = self.forces_n.len();
        (0..self.spectra.len()).map(move |index| (index / forces, index % forces))
    }

    /// Returns the spectrum at a speed, mm/s, from those recorded at one force, except the nodes `without`. `None` if
    /// the speed is not between two of them.
    ///
    /// With at least [`FEWEST_SPEEDS`] speeds, surface and tool are separated; with fewer, the neighbours' whole
    /// spectra are warped.
    fn along_speed(
        &self,
        speed_mm_s: f64,
        force: usize,
        without: &[NodeIndex],
    ) -> Option<AlongSpeed> {
        let members = self.row(force, without);
        let above = members.partition_point(|member| member.0 < speed_mm_s);
        let (low, high) = (members.get(above.checked_sub(1)?)?, members.get(above)?);
        let share = (speed_mm_s - low.0) / (high.0 - low.0);
        let between = |low: &LogSpectrum, high: &LogSpectrum| {
            LogSpectrum::mean(&[(1.0 - share, low), (share, high)])
        };
        let apart = || SurfaceAndTool::of(&members);
        let moved = if members.len() < FEWEST_SPEEDS {
            let warped = [low, high].map(|member| member.1.warped(member.0, speed_mm_s));
            between(&warped[0], &warped[1])
        } else if without.is_empty() {
            self.apart[force].get_or_init(apart).at(speed_mm_s)
        } else {
            apart().at(speed_mm_s)
        };
        Some(AlongSpeed {
            unmoved: between(low.1, high.1),
            moved,
        })
    }

    /// Returns the recorded spectra at one force, with their speeds, mm/s, except the nodes `without`.
    fn row(&self, force: usize, without: &[NodeIndex]) -> Vec<(f64, &LogSpectrum)> {
        // A spectrum at rest cannot be moved: ln 0 does not exist.
        (0..self.speeds_mm_s.len())
            .filter(|&speed| !without.contains(&(speed, force)) && self.speeds_mm_s[speed] > 0.0)
            .filter_map(|speed| Some((self.speeds_mm_s[speed], self.spectrum((speed, force))?)))
            .collect()
    }

    /// Returns the spectrum at a force, N, interpolated between the nearest spectra on both sides that were recorded at
    /// one speed, except node `without`. `None` if either side has none. Force moves no line, so nothing is warped.
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

    /// Returns the spectrum at a speed, mm/s, and force, N, within the recorded ones. It is interpolated between the
    /// two nearest forces, each first interpolated to the speed; `moving` is the weight of the spectrum whose surface
    /// part moves with the speed.
    pub fn at(&self, speed_mm_s: f64, force_n: f64, moving: f64) -> Option<LogSpectrum> {
        let row = |force: usize| {
            // Values that were written in decimals may differ in their last bits.
            let same = |known: &f64| (known - speed_mm_s).abs() < 1e-6;
            let recorded = self.speeds_mm_s.iter().position(same);
            match recorded.and_then(|speed| self.spectrum((speed, force))) {
                Some(spectrum) => Some(spectrum.clone()),
                None => Some(self.along_speed(speed_mm_s, force, &[])?.with(moving)),
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

    /// Predicts the spectrum of the node at `place` from all other nodes: the weighted mean of the spectra along speed
    /// and along force. The weights are those that predict the rest of the grid best.
    pub fn without(&self, place: NodeIndex, both: &TwoWays) -> Option<LogSpectrum> {
        let moving = both.weight_of_moved(self, Some(place));
        match &both.ways[self.index(place)] {
            (Some(speed), Some(force)) => {
                let weight = both.weight_of_speed(self, place, moving);
                let speed = speed.with(moving);
                Some(LogSpectrum::mean(&[
                    (weight, &speed),
                    (1.0 - weight, force),
                ]))
            }
            (Some(speed), None) => Some(speed.with(moving)),
            (None, force) => force.clone(),
        }
    }
}

/// The spectrum at a speed from those recorded at other speeds, in two versions: the plain mean of its neighbours, and
/// one in which the surface part is moved with the speed.
#[derive(Clone, Debug)]
struct AlongSpeed {
    unmoved: LogSpectrum,
    moved: LogSpectrum,
}

impl AlongSpeed {
    /// Returns the mean of the two versions; `moving` is the weight of the moved one.
    fn with(&self, moving: f64) -> LogSpectrum {
        LogSpectrum::mean(&[(1.0 - moving, &self.unmoved), (moving, &self.moved)])
    }
}

/// Predictions of every node from the others, along speed and along force.
#[derive(Clone, Debug)]
pub struct TwoWays {
    /// The two predictions of each node, speed-major.
    ways: Vec<(Option<AlongSpeed>, Option<LogSpectrum>)>,
    /// Weight of the moved version against the plain mean, chosen by all nodes.
    pub moving: f64,
}

impl TwoWays {
    /// Computes the predictions of every node of `field`, recorded or not, each without the node itself.
    pub fn of(field: &RecordedSpectra) -> Self {
        use rayon::prelude::*;
        let places: Vec<NodeIndex> = field.places().collect();
        let ways = places.into_par_iter().map(|place| {
            let speed = field.along_speed(field.speeds_mm_s[place.0], place.1, &[place]);
            let force = field.along_force(place.0, field.forces_n[place.1], Some(place));
            (speed, force)
        });
        let mut both = Self {
            ways: ways.collect(),
            moving: 0.0,
        };
        // The weight is chosen by the predictions, so these come first.
        both.moving = both.weight_of_moved(field, None);
        both
    }

    /// Returns the prediction along speed only.
    pub fn along_speed(&self, field: &RecordedSpectra, place: NodeIndex) -> Option<LogSpectrum> {
        let way = self.ways[field.index(place)].0.as_ref()?;
        Some(way.with(self.moving))
    }

    /// Returns the prediction along force only.
    pub fn along_force(&self, field: &RecordedSpectra, place: NodeIndex) -> Option<LogSpectrum> {
        self.ways[field.index(place)].1.clone()
    }

    /// Returns the weight of the moved version, in quarters: the one with the least total C over the recorded nodes,
    /// each predicted from the others at its force. Node `hidden` does not take part. Without any evidence, the weight
    /// is 0.
    fn weight_of_moved(&self, field: &RecordedSpectra, hidden: Option<NodeIndex>) -> f64 {
        const QUARTERS: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
        let mut errors = [0.0; QUARTERS.len()];
        for (place, way) in field.places().zip(&self.ways) {
            let Some(target) = field.spectrum(place).filter(|_| hidden != Some(place)) else {
                continue;
            };
            // Predictions that used the hidden node are computed once more without it.
            let again = hidden.filter(|hidden| hidden.1 == place.1).map(|hidden| {
                field.along_speed(field.speeds_mm_s[place.0], place.1, &[hidden, place])
            });
            let Some(way) = again.as_ref().unwrap_or(&way.0) else {
                continue;
            };
            for (error, moving) in errors.iter_mut().zip(QUARTERS) {
                *error += target.cost(&way.with(moving), DEFAULT_SMOOTHING_WIDTH_HZ);
            }
        }
        // Among equal errors the smallest weight stays: without evidence, nothing is moved.
        let least = (1..errors.len()).fold(0, |least, next| {
            if errors[next] < errors[least] {
                next
            } else {
                least
            }
        });
        QUARTERS[least]
    }

    /// Returns the weight of the prediction along speed against that along force, by least squares over all recorded
    /// nodes that share neither speed nor force with `place`, so that no prediction uses the recording at `place`. It
    /// is 0.5 if there are no such nodes.
    fn weight_of_speed(&self, field: &RecordedSpectra, place: NodeIndex, moving: f64) -> f64 {
        // Least squares for w in b + w (a - b), the mean of the predictions a and b.
        let (mut product, mut square) = (0.0, 0.0);
        for (other, ways) in field.places().zip(&self.ways) {
            let (Some(target), (Some(a), Some(b))) = (field.spectrum(other), ways) else {
                continue;
            };
            if other.0 == place.0 || other.1 == place.1 {
                continue;
            }
            let a = a.with(moving);
            for bin in judged_bins() {
                let difference = a.values()[bin] - b.values()[bin];
                product += (target.values()[bin] - b.values()[bin]) * difference;
                square += difference * difference;
            }
        }
        if square > 0.0 {
            // Beyond 0 and 1 it would be no mean of the two but an extrapolation.
            (product / square).clamp(0.0, 1.0)
        } else {
            0.5
        }
    }
}

/// Bins by which weights are chosen: sixty per decade from 18 to 1050 Hz, so that every band counts equally.
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
    use crate::dsp::log_spectrum::{BINS, STEP_HZ};
    use proptest::prelude::*;
    use test_helpers::near;

    /// Makes a field of constant levels: level(speed index, force index), in nepers of power.
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
        // Linear along force, jumping along speed.
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

    /// Spectra at six speeds and two forces; `of` is their log density over frequency, Hz, and speed, mm/s.
    fn of_density(of: impl Fn(f64, f64) -> f64) -> RecordedSpectra {
        let speeds: Vec<f64> = (2..8).map(|s| 20.0 * f64::from(s)).collect();
        let spectrum = |speed: f64| {
            let value = |bin: usize| of((bin as f64 * STEP_HZ).max(4.0), speed);
            Some(LogSpectrum::from_values((0..BINS).map(value).collect()))
        };
        let spectra = speeds
            .iter()
            .flat_map(|&speed| [spectrum(speed), spectrum(speed)]);
        RecordedSpectra::new(speeds.clone(), vec![0.4, 0.8], spectra.collect())
    }

    /// A peak of `height` at `centre_hz`, about a seventh of the frequency wide.
    fn peak(frequency_hz: f64, centre_hz: f64, height: f64) -> f64 {
        height * (-((frequency_hz / centre_hz).ln() / 0.15).powi(2)).exp()
    }

    /// Errors of the prediction of the left-out node in the middle, as densified and as the mean of its neighbours; and
    /// the weight.
    fn left_out(field: &RecordedSpectra) -> ([f64; 2], f64) {
        let ways = TwoWays::of(field);
        let place = (2, 0);
        let error = |spectrum: &LogSpectrum| {
            let recorded = field.spectrum(place).unwrap();
            recorded.cost(spectrum, DEFAULT_SMOOTHING_WIDTH_HZ)
        };
        let unmoved = &ways.ways[field.index(place)].0.as_ref().unwrap().unmoved;
        let densified = field.without(place, &ways).unwrap();
        ([error(&densified), error(unmoved)], ways.moving)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn a_moving_comb_gets_the_weight_and_comes_nearer_than_the_mean(
            pitch_mm in 0.5f64..2.0, resonance_hz in 150.0f64..900.0, height in 2.0f64..5.0,
        ) {
            let field = of_density(|frequency_hz, speed| {
                let comb = [1.0, 2.0, 3.0].map(|n| peak(frequency_hz, n * speed / pitch_mm, height));
                comb.iter().sum::<f64>() + peak(frequency_hz, resonance_hz, 3.0)
            });
            let ([densified, mean], moving) = left_out(&field);
            prop_assert!(moving >= 0.75, "{moving}");
            prop_assert!(densified < 0.5 * mean, "{densified} against {mean}");
        }

        #[test]
        fn what_does_not_move_gets_no_weight_and_loses_nothing(
            resonance_hz in 100.0f64..900.0, height in 2.0f64..5.0, growth in -0.01f64..0.01,
        ) {
            let field = of_density(|frequency_hz, speed| peak(frequency_hz, resonance_hz, height) + growth * speed);
            let ([densified, mean], moving) = left_out(&field);
            prop_assert!(moving <= 0.0, "{moving}");
            prop_assert!(densified <= mean + 1e-9, "{densified} against {mean}");
        }
    }

    #[test]
    fn beyond_the_recorded_nodes_there_is_no_way() {
        let field = field(|speed, force| (force > 0).then_some(speed as f64));
        let ways = TwoWays::of(&field);
        assert!(field.without((0, 0), &ways).is_none());
        assert!(ways.along_force(&field, (2, 1)).is_none());
        assert!(ways.along_speed(&field, (2, 1)).is_some());
        assert!(field.along_speed(500.0, 1, &[]).is_none());
    }
}
