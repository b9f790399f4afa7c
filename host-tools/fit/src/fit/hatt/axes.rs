//! Choice of a grid's speeds and forces from those of a file's models and from others between them.
//!
//! A file's models are scattered. Each has a speed and a force that few others share, so a grid of all these speeds and
//! forces has some ten times as many nodes as models. That grid would hold every model at its own position. Between the
//! models the file interpolates over triangles, and the grid over rectangles. So the search begins with all speeds and
//! forces of the models, the middles of wide gaps, and values below the lowest model. It then removes speeds and forces
//! (lines of nodes) one by one, always the one whose loss costs least per byte. Lines that are not the models' own go
//! first, as long as the error between models is tolerable; then any line goes, until the grid is small enough. The
//! cost is the error against the file's definition at the models' own positions and, with less weight, within
//! triangles.

use model_format::limits;
use rayon::prelude::*;
use stylus_dsp::fourier::Complex;
use stylus_dsp::linear_prediction::error_share;
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::band_edges_hz;

use super::between::{self, density, stage};
use super::toolkit::Toolkit;

/// Positions within a triangle, as the weights of its corners: the rule of three points that is exact for quadratic
/// functions (Strang and Fix, 1973).
const INSIDE: [[f64; 3]; 3] = {
    const NEAR: f64 = 2.0 / 3.0;
    const FAR: f64 = 1.0 / 6.0;
    [[NEAR, FAR, FAR], [FAR, NEAR, FAR], [FAR, FAR, NEAR]]
};

/// Weight of a position within a triangle relative to that of a model's own position.
const INSIDE_WEIGHT: f64 = 0.1;

/// Mean cost of positions within triangles up to which lines that are not the models' own are removed, dB².
const TOLERABLE: f64 = 0.15;

/// Narrowest gap that gets a line in its middle, relative to the highest model.
const NARROWEST_GAP: f64 = 0.02;

/// Largest error that counts, dB; larger ones count as this. A lost position then does not outweigh several that are
/// preserved.
const MOST_DB: f64 = 6.0;

/// Largest number of third octaves of a file: from 20 Hz to 4 kHz.
pub(super) const MOST_BANDS: usize = 24;

/// Number of frequencies per third octave at which the cost is computed.
const PER_BAND: usize = 5;

/// Bytes of a node's record in a library, without its coefficients, which take two bytes each.
const NODE_RECORD_BYTES: usize = 16;

/// Bounds of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Largest number of speeds.
    pub speeds: usize,
    /// Largest number of forces.
    pub forces: usize,
    /// Largest number of bytes of nodes, coefficients and axes.
    pub bytes: usize,
}

/// Lines from which a grid is chosen, ascending: speeds, mm/s, and forces, N.
#[derive(Clone, Debug)]
pub struct Candidates(pub [Vec<Line>; 2]);

/// A speed or a force of a grid, above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    value: f32,
    /// True if a model has this speed or force.
    is_own: bool,
}

/// A chosen grid: its axes, and its models, all forces of the first speed first.
pub(super) struct Chosen {
    pub speeds_mm_s: Vec<f32>,
    pub forces_n: Vec<f32>,
    pub models: Vec<Model>,
}

impl Candidates {
    /// Returns the speeds and forces of the models of `toolkit` and others between them, at most as many per axis as a
    /// library can hold.
    pub fn of(toolkit: &Toolkit) -> Self {
        let models = || toolkit.models.iter();
        // Above the highest speed and force, the file defines what it does at the highest.
        let (speeds, forces) = (models().map(|m| m.speed_mm_s), models().map(|m| m.force_n));
        Self([
            lines(speeds.map(|speed| speed.min(toolkit.max_speed_mm_s))),
            lines(forces.map(|force| force.min(toolkit.max_force_n))),
        ])
    }

    /// Returns the number of speeds and forces that are the models' own.
    pub fn own(&self) -> usize {
        let lines = self.0.iter().flatten();
        lines.filter(|line| line.is_own).count()
    }
}

/// Returns the `places` of models above zero, and others: half the lowest, and the middles of the gaps from zero on,
/// those of the widest gaps first.
fn lines(places: impl Iterator<Item = f64>) -> Vec<Line> {
    let mut own: Vec<f32> = places.map(|place| place as f32).filter(|&place| place > 0.0).collect();
    own.sort_by(f32::total_cmp);
    own.dedup();
    while own.len() > limits::MAX_AXIS_LEN {
        // The value next to the narrowest gap is the one that its neighbour stands in for best.
        let gap = |index: &usize| own[*index] - own[index - 1];
        let narrowest = (1..own.len()).min_by(|a, b| gap(a).total_cmp(&gap(b)));
        own.remove(narrowest.expect("there are more than the limit"));
    }
    let (Some(&lowest), Some(&highest)) = (own.first(), own.last()) else {
        return Vec::new();
    };
    let half = 0.5 * lowest;
    let ends: Vec<f32> = [0.0, half].into_iter().chain(own.iter().copied()).collect();
    let mut gaps: Vec<(f32, f32)> = ends.windows(2).map(|pair| (pair[0], pair[1])).collect();
    gaps.retain(|(low, high)| f64::from(high - low) > NARROWEST_GAP * f64::from(highest));
    gaps.sort_by(|a, b| (b.1 - b.0).total_cmp(&(a.1 - a.0)));
    let middles = gaps.into_iter().map(|(low, high)| 0.5 * (low + high));
    let room = limits::MAX_AXIS_LEN - own.len();
    let others = std::iter::once(half).chain(middles);
    let others = others.filter(|&value| value > 0.0).take(room);
    let line = |is_own| move |value| Line { value, is_own };
    let mut all: Vec<Line> = others.map(line(false)).collect();
    all.extend(own.into_iter().map(line(true)));
    all.sort_by(|a, b| a.value.total_cmp(&b.value));
    all
}

/// Returns the bytes of a node in a library.
fn node_bytes(model: &Model) -> usize {
    NODE_RECORD_BYTES + 2 * model.reflection.len()
}

/// Chooses the grid within `bounds`.
pub(super) fn choose(toolkit: &Toolkit, candidates: &Candidates, bounds: Bounds) -> Chosen {
    let mut search = Search::new(toolkit, candidates);
    let most = TOLERABLE * search.weight_inside();
    while let Some(loss) = search.cheapest([true, true], |line| !line.is_own) {
        if search.cost_inside() + loss.rise > most {
            break;
        }
        search.take_away(loss);
    }
    while let Some(axes) = search.excess(bounds) {
        // Only the last line of an axis cannot go; then the bound cannot be met.
        let Some(loss) = search.cheapest(axes, |_| true) else {
            break;
        };
        search.take_away(loss);
    }
    search.chosen()
}

/// A frequency at which the cost is computed, its bandwidth, and its band; the ends of the spectrum belong to no band.
struct Probe {
    frequency_hz: f64,
    width_hz: f64,
    band: Option<usize>,
    turn: Complex<f64>,
}

/// A position at which the cost is computed.
struct Spot {
    place: [f64; 2],
    /// Wanted levels of the bands, and of all frequencies together, dB.
    wanted_db: [f64; MOST_BANDS + 1],
    weight: f64,
}

struct Search<'a> {
    candidates: &'a Candidates,
    /// Sample rate of the playback, Hz.
    rate_hz: f64,
    /// Models of the grid of all candidates: angles θ and power.
    thetas: Vec<(Vec<f64>, f64)>,
    models: Vec<Model>,
    probes: Vec<Probe>,
    spots: Vec<Spot>,
    /// Indices of the speeds and forces that remain.
    left: [Vec<usize>; 2],
    /// Cost of each spot.
    costs: Vec<f64>,
}

/// Axes from which a line may be removed: speeds, forces.
type Axes = [bool; 2];

/// The effect of removing a line.
struct Loss {
    axis: usize,
    /// Index among the remaining lines.
    line: usize,
    /// New costs of the spots whose cost changes.
    changed: Vec<(usize, f64)>,
    /// Sum of the changes of cost.
    rise: f64,
}

impl<'a> Search<'a> {
    fn new(toolkit: &Toolkit, candidates: &'a Candidates) -> Self {
        let [speeds, forces] = &candidates.0;
        // A node's model does not depend on the lines that remain, so all are computed once.
        let models = (0..speeds.len() * forces.len()).into_par_iter();
        let models = models.map(|index| {
            let places = [&speeds[index / forces.len()], &forces[index % forces.len()]];
            let [speed, force] = places.map(|line| f64::from(line.value));
            between::model(toolkit, (speed, force))
        });
        let models: Vec<Model> = models.collect();
        let angles = |model: &Model| model.reflection.iter().map(|k| k.asin()).collect();
        let probes = probes(toolkit);
        let mut search = Self {
            candidates,
            rate_hz: toolkit.play_rate_hz(),
            thetas: models.iter().map(|model| (angles(model), model.output_power)).collect(),
            models,
            spots: spots(toolkit, &probes),
            probes,
            left: [speeds, forces].map(|lines| (0..lines.len()).collect()),
            costs: Vec::new(),
        };
        search.costs = search
            .spots
            .iter()
            .map(|spot| search.cost(spot, &search.left))
            .collect();
        search
    }

    fn value(&self, axis: usize, index: usize) -> f64 {
        f64::from(self.candidates.0[axis][index].value)
    }

    /// Returns the spots within triangles, with their costs.
    fn inside(&self) -> impl Iterator<Item = (&Spot, f64)> {
        let all = self.spots.iter().zip(self.costs.iter().copied());
        // Spots at the models' own positions have a weight of 1.
        all.filter(|(spot, _)| spot.weight < 1.0)
    }

    fn weight_inside(&self) -> f64 {
        self.inside().map(|(spot, _)| spot.weight).sum()
    }

    fn cost_inside(&self) -> f64 {
        self.inside().map(|(_, cost)| cost).sum()
    }

    fn index(&self, speed: usize, force: usize) -> usize {
        speed * self.candidates.0[1].len() + force
    }

    fn bytes(&self) -> usize {
        let [speeds, forces] = &self.left;
        let nodes = speeds
            .iter()
            .flat_map(|&speed| forces.iter().map(move |&force| (speed, force)));
        let nodes: usize = nodes.map(|(s, f)| node_bytes(&self.models[self.index(s, f)])).sum();
        nodes + size_of::<f32>() * (speeds.len() + forces.len())
    }

    /// Returns the axes that must lose a line; `None` if the grid is within its bounds.
    fn excess(&self, bounds: Bounds) -> Option<Axes> {
        let over = [self.left[0].len() > bounds.speeds, self.left[1].len() > bounds.forces];
        if over.contains(&true) {
            return Some(over);
        }
        (self.bytes() > bounds.bytes).then_some([true, true])
    }

    /// Returns the loss with the least cost per byte, among the lines of the `axes` that `may` be removed; `None` if
    /// there is none. The last line of an axis stays.
    fn cheapest(&self, axes: Axes, may: impl Fn(&Line) -> bool) -> Option<Loss> {
        let lines: Vec<(usize, usize)> = (0..2)
            .filter(|&axis| axes[axis] && self.left[axis].len() > 1)
            .flat_map(|axis| (0..self.left[axis].len()).map(move |line| (axis, line)))
            .filter(|&(axis, line)| may(&self.candidates.0[axis][self.left[axis][line]]))
            .collect();
        let tried = lines.into_par_iter().map(|(axis, line)| {
            let loss = self.without(axis, line);
            // A line whose removal costs nothing, or lowers the cost, is removed whatever its size.
            let price = if loss.rise > 0.0 {
                loss.rise / self.line_bytes(axis, line) as f64
            } else {
                loss.rise
            };
            (price, loss)
        });
        // Ties go to the first line, so that the number of threads does not change the grid.
        let order = |loss: &Loss| (loss.axis, loss.line);
        let cheapest = tried.min_by(|(a, x), (b, y)| a.total_cmp(b).then(order(x).cmp(&order(y))));
        cheapest.map(|(_, loss)| loss)
    }

    fn take_away(&mut self, loss: Loss) {
        self.left[loss.axis].remove(loss.line);
        for (spot, cost) in loss.changed {
            self.costs[spot] = cost;
        }
    }

    fn line_bytes(&self, axis: usize, line: usize) -> usize {
        let here = self.left[axis][line];
        let bytes = |&other: &usize| {
            let (speed, force) = if axis == 0 { (here, other) } else { (other, here) };
            node_bytes(&self.models[self.index(speed, force)])
        };
        self.left[1 - axis].iter().map(bytes).sum()
    }

    fn without(&self, axis: usize, line: usize) -> Loss {
        let mut left = self.left.clone();
        left[axis].remove(line);
        let end = |line: Option<usize>, otherwise: f64| {
            line.and_then(|line| self.left[axis].get(line))
                .map_or(otherwise, |&index| self.value(axis, index))
        };
        let (low, high) = (
            end(line.checked_sub(1), f64::NEG_INFINITY),
            end(Some(line + 1), f64::INFINITY),
        );
        let mut rise = 0.0;
        let near = self.spots.iter().enumerate();
        let near = near.filter(|(_, spot)| spot.place[axis] > low && spot.place[axis] < high);
        let changed = near
            .map(|(index, spot)| {
                let cost = self.cost(spot, &left);
                rise += cost - self.costs[index];
                (index, cost)
            })
            .collect();
        Loss {
            axis,
            line,
            changed,
            rise,
        }
    }

    /// Returns the mean squared error of the bands plus the squared error of the level, dB², times the spot's weight.
    fn cost(&self, spot: &Spot, left: &[Vec<usize>; 2]) -> f64 {
        let played = self.played_db(spot.place, left);
        let square = |band: usize| (played[band] - spot.wanted_db[band]).clamp(-MOST_DB, MOST_DB).powi(2);
        // A band beyond the file's highest frequency has no power and no wanted level.
        let bands: Vec<usize> = (0..MOST_BANDS)
            .filter(|&band| spot.wanted_db[band].is_finite())
            .collect();
        let mean = bands.iter().map(|&band| square(band)).sum::<f64>() / bands.len().max(1) as f64;
        spot.weight * (mean + square(MOST_BANDS))
    }

    /// Returns the levels that a grid plays, by the device's rule: means of θ and of power, and proportional power
    /// below the grid.
    fn played_db(&self, place: [f64; 2], left: &[Vec<usize>; 2]) -> [f64; MOST_BANDS + 1] {
        let [speeds, forces] = [0, 1].map(|axis| self.position(axis, &left[axis], place[axis]));
        let mut thetas = Vec::new();
        let mut power = 0.0;
        for (speed, speed_weight) in speeds.nodes {
            for (force, force_weight) in forces.nodes {
                let weight = speed_weight * force_weight;
                if weight <= 0.0 {
                    continue;
                }
                let (node, node_power) = &self.thetas[self.index(speed, force)];
                // Orders differ between nodes. A stage that a node lacks has θ = 0.
                thetas.resize(node.len().max(thetas.len()), 0.0);
                for (sum, theta) in thetas.iter_mut().zip(node) {
                    *sum += weight * theta;
                }
                power += weight * node_power;
            }
        }
        let reflection: Vec<f64> = thetas.into_iter().map(f64::sin).collect();
        // One-sided density of an all-pole model: 2/fs · power · Π(1 - k²) / |A|².
        let scale = 2.0 / self.rate_hz * power * speeds.fade * forces.fade * error_share(&reflection);
        levels_db(&self.probes, |probe| scale / probe.inverse_gain(&reflection))
    }

    fn position(&self, axis: usize, left: &[usize], value: f64) -> Position {
        let above = left.partition_point(|&index| self.value(axis, index) <= value);
        let (below, above) = (above.saturating_sub(1), above.min(left.len() - 1));
        let (low, high) = (self.value(axis, left[below]), self.value(axis, left[above]));
        let share = if below == above {
            0.0
        } else {
            (value - low) / (high - low)
        };
        Position {
            nodes: [(left[below], 1.0 - share), (left[above], share)],
            fade: (value / self.value(axis, left[0])).min(1.0),
        }
    }

    fn chosen(mut self) -> Chosen {
        let [speeds, forces] = self.left.clone();
        let mut models = Vec::with_capacity(speeds.len() * forces.len());
        for &speed in &speeds {
            for &force in &forces {
                let index = self.index(speed, force);
                models.push(std::mem::replace(&mut self.models[index], Model::silent()));
            }
        }
        let values = |axis: usize| {
            let left = self.left[axis].iter();
            left.map(move |&index| self.candidates.0[axis][index].value)
        };
        Chosen {
            speeds_mm_s: values(0).collect(),
            forces_n: values(1).collect(),
            models,
        }
    }
}

struct Position {
    nodes: [(usize, f64); 2],
    fade: f64,
}

fn probes(toolkit: &Toolkit) -> Vec<Probe> {
    let (highest_hz, rate_hz) = (toolkit.highest_hz(), toolkit.play_rate_hz());
    let probe = |low: f64, high: f64, band| {
        let frequency_hz = 0.5 * (low + high);
        let omega = std::f64::consts::TAU * frequency_hz / rate_hz;
        Probe {
            frequency_hz,
            width_hz: high - low,
            band,
            turn: Complex::cis(-omega),
        }
    };
    let split = |low: f64, high: f64, band: Option<usize>| {
        let step = (high - low) / PER_BAND as f64;
        (0..PER_BAND).map(move |i| probe(low + step * i as f64, low + step * (i + 1) as f64, band))
    };
    let own: Vec<usize> = toolkit.bands().collect();
    let last = own.last().map_or(0.0, |&band| band_edges_hz(band).1);
    let lowest = own.first().map_or(0.0, |&band| band_edges_hz(band).0);
    let bands = own.iter().flat_map(|&band| {
        let (low, high) = band_edges_hz(band);
        split(low, high, Some(band))
    });
    bands
        .chain(split(0.0, lowest, None))
        .chain(split(last, highest_hz, None))
        .collect()
}

fn spots(toolkit: &Toolkit, probes: &[Probe]) -> Vec<Spot> {
    let frequencies_hz: Vec<f64> = probes.iter().map(|probe| probe.frequency_hz).collect();
    let mut own: Vec<(f64, f64)> = toolkit.model_places().collect();
    // Several models at one position are one spot, which would otherwise count several times.
    own.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    own.dedup();
    let inside = INSIDE
        .into_iter()
        .flat_map(|weights| toolkit.inside_triangles(weights))
        .map(|place| (place, INSIDE_WEIGHT));
    own.into_iter()
        .map(|place| (place, 1.0))
        .chain(inside)
        .filter_map(|(place, weight)| {
            // Where the file is silent there is no level in dB to compare with.
            let density = density(toolkit, place, &frequencies_hz)?;
            let mut densities = density.into_iter();
            let wanted_db = levels_db(probes, |_| densities.next().unwrap_or(0.0));
            Some(Spot {
                place: place.into(),
                wanted_db,
                weight,
            })
        })
        .collect()
}

fn levels_db(probes: &[Probe], mut density: impl FnMut(&Probe) -> f64) -> [f64; MOST_BANDS + 1] {
    let mut powers = [0.0; MOST_BANDS + 1];
    for probe in probes {
        let power = density(probe) * probe.width_hz;
        powers[MOST_BANDS] += power;
        if let Some(band) = probe.band {
            powers[band] += power;
        }
    }
    powers.map(|power: f64| 10.0 * power.log10())
}

impl Probe {
    /// Returns |A|² of the model with these reflection coefficients, by the recursion over its order.
    fn inverse_gain(&self, reflection: &[f64]) -> f64 {
        let begin = (Complex::from(1.0), Complex::from(1.0));
        let (a, _) = reflection.iter().fold(begin, |last, &k| stage(last, self.turn, k));
        a.norm_sqr()
    }
}
