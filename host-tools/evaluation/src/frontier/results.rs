//! Results of a comparison: filters, and filters with an interval of updates.

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;
use stylus_costs::{Peer, Structure};
use stylus_dsp::spectrum::AMPLITUDE_JND_DB;
use stylus_fit::fit::Order;

use super::costs::Cost;
use super::hard::HardCases;
use super::still::Still;
use super::{CLOCKS_HZ, DEVICE_CLOCK_HZ};
use crate::table::{Table, percent};

/// A structure at an order, with its costs and errors.
#[derive(Clone, Debug, Serialize)]
pub struct Filter {
    /// The structure.
    pub structure: Structure,
    /// Choice of the order.
    pub order: Order,
    /// The highest order of any node, which determines the time of a sample.
    pub highest_order: usize,
    /// Accuracy at rest.
    pub still: Still,
    /// The hard cases at the highest order.
    pub hard: HardCases,
    /// Names of the textures that the structure cannot hold.
    pub refused_textures: Vec<String>,
    /// Cost on a Cortex-M4.
    pub m4: Cost,
    /// Cost on a Cortex-M7.
    pub m7: Cost,
    /// Flash that a node needs in a library, bytes.
    pub library_bytes_per_node: usize,
    /// RAM for two frames' coefficients and the state, bytes.
    pub ram_bytes: usize,
}

impl Filter {
    /// Returns the order as text. If each node has its own order, the text has the choice and the highest order.
    pub fn order_text(&self) -> String {
        let highest = self.highest_order;
        match self.order {
            Order::Fixed(order) => order.to_string(),
            Order::Bayesian => format!("BIC,\u{a0}≤\u{a0}{highest}"),
            Order::Auto => format!("auto,\u{a0}≤\u{a0}{highest}"),
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
    /// Fraction of bands in motion within the JND.
    pub motion_within_jnd: f64,
    /// Errors at rest and in motion together, dB.
    pub total_error_db: f64,
    /// Samples at full scale while rubbing.
    pub saturations: u32,
    /// Cycles per sample on the device's Cortex-M7, modelled, updates included.
    pub cycles: f64,
    /// True if the choice plays all textures, and its error is lower by more than 0.05 dB than those of all choices on
    /// this front that cost as much or less.
    pub on_front: bool,
    /// The same among the choices that also hold every hard case.
    pub on_safe_front: bool,
}

impl Point {
    /// Fraction of the time of a sample that the device needs.
    pub fn share(&self) -> f64 {
        share(self.cycles, DEVICE_CLOCK_HZ)
    }

    /// The interval in ms.
    pub fn interval_ms(&self) -> f64 {
        interval_ms(self.interval)
    }
}

/// An interval of samples in ms.
pub fn interval_ms(samples: usize) -> f64 {
    1000.0 * samples as f64 / f64::from(SAMPLE_RATE_HZ)
}

/// Headings of the columns with the fraction of time at each clock.
pub fn clock_headings() -> [String; 3] {
    CLOCKS_HZ.map(|clock_hz| format!("{} MHz, %", clock_hz / 1e6))
}

/// Returns `cycles` as a fraction of a sample's 200 µs at `clock_hz`.
pub fn share(cycles: f64, clock_hz: f64) -> f64 {
    cycles / (clock_hz / f64::from(SAMPLE_RATE_HZ))
}

/// The meaning of [`Frontier::choice_table`]'s columns.
pub const CHOICES_NOTE: &str = "Errors are RMS over third octaves: at rest against recordings held out, in motion \
     against float64. Cycles per sample, updates included, are modelled for the device's Cortex-M7; the share is of \
     its 200 µs at 400 MHz. Hard cases: how many are held.";

/// All results of the comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Frontier {
    /// Description of the fitted and the held-out recordings.
    pub material: String,
    /// True if any recording is simulated.
    pub simulated: bool,
    /// The textures.
    pub textures: Vec<String>,
    /// Number of nodes that were judged at rest.
    pub nodes: usize,
    /// C of one take against the other, without any model.
    pub take_cost: f64,
    /// RMS error in bands of one take against the other, dB.
    pub take_band_error_db: f64,
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// The compiler that built the code whose instructions were counted.
    pub rustc: String,
    /// The emulator that counted the instructions.
    pub qemu: String,
    /// The version of LLVM whose llvm-mca modelled the Cortex-M7.
    pub llvm_mca: String,
    /// Other implementations, for comparison.
    pub peers: Vec<Peer>,
    /// Structures by orders.
    pub filters: Vec<Filter>,
    /// Filters by intervals.
    pub points: Vec<Point>,
}

impl Frontier {
    /// True if a choice that plays all textures holds every hard case.
    pub fn is_safe(&self) -> bool {
        self.points.iter().any(|point| point.on_safe_front)
    }

    /// Returns the front from which choices are made, the cheapest first. It is the front of all choices that hold
    /// every hard case, or of all choices if none does.
    pub fn front(&self) -> Vec<&Point> {
        let is_safe = self.is_safe();
        let is_on = |point: &&Point| {
            if is_safe { point.on_safe_front } else { point.on_front }
        };
        let mut front: Vec<&Point> = self.points.iter().filter(is_on).collect();
        front.sort_by(|a, b| a.cycles.total_cmp(&b.cycles));
        front
    }

    /// Returns three choices of [`Frontier::front`] that show what accuracy costs, with their names. The cheapest one
    /// is named thrifty, and the most accurate one finest. The knee lies farthest below the chord between these two, in
    /// logarithms of cycles and error. If no choice is below the chord, the knee is the finest. The result is empty for
    /// an empty front.
    pub fn choices(&self) -> Vec<(&'static str, &Point)> {
        let front = self.front();
        let places = front.iter().map(|point| (point.cycles, point.total_error_db));
        let knee = knee(&places.collect::<Vec<_>>());
        knee.map(|knee| [("thrifty", 0), ("knee", knee), ("finest", front.len() - 1)])
            .into_iter()
            .flatten()
            .map(|(name, index)| (name, front[index]))
            .collect()
    }

    /// The answer in three sentences.
    pub fn answer(&self) -> String {
        let choices = self.choices();
        let [(_, thrifty), (_, knee), (_, finest)] = choices.as_slice() else {
            return "No structure plays all of the textures, so that there is nothing to choose.".to_owned();
        };
        let begin = if self.is_safe() {
            "The cheapest choice that holds every hard case"
        } else {
            "No choice holds every hard case; the cheapest of all"
        };
        let [few, some, most] = [thrifty, knee, finest].map(|point| percent(Some(point.share()), 2));
        format!(
            "{begin} takes {few} % of the device's time and errs by {:.1} dB. The most accurate takes {:.0} times as \
             long, {most} %, and errs by {:.1} dB, where two takes of one surface differ by {:.1} dB, and skin feels \
             no difference below {AMPLITUDE_JND_DB} dB. The knee lies at {some} % and {:.1} dB: from there the last \
             {:.1} dB take {:.1} times the time.",
            thrifty.total_error_db,
            finest.cycles / thrifty.cycles,
            finest.total_error_db,
            self.take_band_error_db,
            knee.total_error_db,
            knee.total_error_db - finest.total_error_db,
            finest.cycles / knee.cycles,
        )
    }

    /// The three choices as a table.
    pub fn choice_table(&self) -> Table {
        let choices = self.choices().into_iter().map(|(name, point)| (name.to_owned(), point));
        self.table("Three choices on the Pareto front", "choice", choices)
    }

    /// The choices on a front, the cheapest first.
    pub fn front_table(&self) -> Table {
        let on_a_front = |point: &&Point| point.on_front || point.on_safe_front;
        let mut points: Vec<&Point> = self.points.iter().filter(on_a_front).collect();
        points.sort_by(|a, b| a.cycles.total_cmp(&b.cycles));
        let named = points.into_iter().map(|point| {
            let structure = self.filters[point.filter].structure;
            (structure.to_string(), point)
        });
        self.table(
            "Nothing cheaper has a lower error, among all or among what holds every hard case",
            "structure",
            named,
        )
    }

    /// Choices with names under the heading `names`; [`CHOICES_NOTE`] explains the columns.
    fn table<'a>(&'a self, title: &str, names: &str, choices: impl Iterator<Item = (String, &'a Point)>) -> Table {
        let row = |(name, point): (String, &Point)| {
            let filter = &self.filters[point.filter];
            vec![
                (names, name),
                ("order", filter.order_text()),
                ("update, ms", point.interval_ms().to_string()),
                ("at rest, dB", format!("{:.2}", filter.still.band_error_db)),
                ("in motion, dB", format!("{:.2}", point.motion_error_db)),
                ("cycles", format!("{:.0}", point.cycles)),
                ("share, %", percent(Some(point.share()), 2)),
                ("hard cases", filter.hard.to_string()),
            ]
        };
        Table::headed(title, choices.map(row))
    }

    /// The numbers as JSON, a line per filter, choice and row.
    pub fn to_json(&self) -> String {
        let value = serde_json::to_value(self).expect("plain data become JSON");
        let fields = value.as_object().into_iter().flatten().map(|(name, value)| {
            let text = match value.as_array() {
                Some(items) => {
                    let items: Vec<String> = items.iter().map(ToString::to_string).collect();
                    format!("[\n{}\n]", items.join(",\n"))
                }
                None => value.to_string(),
            };
            format!("\"{name}\": {text}")
        });
        format!("{{\n{}\n}}\n", fields.collect::<Vec<_>>().join(",\n"))
    }
}

/// Least improvement that justifies more time, dB. Smaller ones are within the scatter of the measurement.
const WORTH_DB: f64 = 0.05;

/// Marks the points that no cheaper point beats. A structure that does not hold all nodes and textures is left out.
pub(super) fn mark_fronts(frontier: &mut Frontier) {
    let front = |holds: fn(&Filter) -> bool| {
        let points = frontier.points.iter().map(|point| {
            let filter = &frontier.filters[point.filter];
            let is_played = filter.still.refused == 0 && filter.refused_textures.is_empty();
            // `pareto` leaves out what is not a number.
            let error = if is_played && holds(filter) {
                point.total_error_db
            } else {
                f64::NAN
            };
            (point.cycles, error)
        });
        pareto(&points.collect::<Vec<_>>(), WORTH_DB)
    };
    let on_front = front(|_| true);
    let on_safe_front = front(|filter| filter.hard.held == filter.hard.cases);
    let marks = on_front.into_iter().zip(on_safe_front);
    for (point, (on_front, on_safe_front)) in frontier.points.iter_mut().zip(marks) {
        (point.on_front, point.on_safe_front) = (on_front, on_safe_front);
    }
}

/// Marks the pairs (cost, error) on the Pareto front. A pair is on it if its error is lower by more than `worth` than
/// the errors of all pairs on it that cost as much or less. Pairs that are not finite are never on it.
fn pareto(points: &[(f64, f64)], worth: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&index| points[index].0.is_finite() && points[index].1.is_finite())
        .collect();
    // Of pairs of one cost, the lowest error comes first, so that none of the others is marked.
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut on_front = vec![false; points.len()];
    let mut lowest = f64::INFINITY;
    for index in order {
        let error = points[index].1;
        if error < lowest - worth {
            lowest = error;
            on_front[index] = true;
        }
    }
    on_front
}

/// Index of the place that lies farthest below the chord from the first to the last, in logarithms of both numbers.
fn knee(places: &[(f64, f64)]) -> Option<usize> {
    let logs: Vec<(f64, f64)> = places.iter().map(|place| (place.0.ln(), place.1.ln())).collect();
    let (&first, &last) = (logs.first()?, logs.last()?);
    // Twice the area of the triangle over the chord. It is proportional to the distance, because the chord is the same
    // for all places.
    let below = |&(x, y): &(f64, f64)| (x - first.0) * (last.1 - first.1) - (y - first.1) * (last.0 - first.0);
    // Of equals, `max_by` returns the last: both ends are on the chord, and the finest choice is the last.
    (0..logs.len()).max_by(|&a, &b| below(&logs[a]).total_cmp(&below(&logs[b])))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn nothing_on_the_front_is_beaten_and_all_else_is(
            points in prop::collection::vec((0.0..10.0f64, 0.0..10.0f64), 1..40),
        ) {
            let on_front = pareto(&points, 0.0);
            for (index, point) in points.iter().enumerate() {
                let beaten = points.iter().any(|other| {
                    other.0 <= point.0 && other.1 <= point.1 && other != point
                });
                prop_assert_eq!(on_front[index], !beaten);
            }
        }

        #[test]
        fn each_step_along_the_front_is_worth_its_cost(
            points in prop::collection::vec((0.0..10.0f64, 0.0..10.0f64), 1..40), worth in 0.0..2.0f64,
        ) {
            let on_front = pareto(&points, worth);
            let mut kept: Vec<(f64, f64)> = points.iter().zip(&on_front).filter(|p| *p.1).map(|p| *p.0).collect();
            kept.sort_by(|a, b| a.0.total_cmp(&b.0));
            prop_assert!(!kept.is_empty());
            prop_assert!(kept.windows(2).all(|pair| pair[1].1 < pair[0].1 - worth));
        }
    }

    proptest! {
        /// Checks this with the chord turned to the horizontal. The units of cycles and error do not matter.
        #[test]
        fn nothing_on_a_front_lies_farther_below_its_chord_than_the_knee(
            points in prop::collection::vec((1.0..10.0f64, 1.0..10.0f64), 1..40), unit in 0.1..100.0f64,
        ) {
            let on_front = pareto(&points, 0.0);
            let mut front: Vec<(f64, f64)> = points.iter().zip(&on_front).filter(|p| *p.1).map(|p| *p.0).collect();
            front.sort_by(|a, b| a.0.total_cmp(&b.0));
            let of = |front: &[(f64, f64)]| front[knee(front).unwrap()];
            let (first, last, found) = (front[0], front[front.len() - 1], of(&front));
            let angle = (last.1 / first.1).ln().atan2((last.0 / first.0).ln());
            let below = |place: (f64, f64)| {
                let (x, y) = ((place.0 / first.0).ln(), (place.1 / first.1).ln());
                x * angle.sin() - y * angle.cos()
            };
            prop_assert!(front.iter().all(|place| below(*place) <= below(found) + 1e-9));
            let scaled: Vec<(f64, f64)> = front.iter().map(|place| (place.0 * unit, place.1 / unit)).collect();
            prop_assert!((below((of(&scaled).0 / unit, of(&scaled).1 * unit)) - below(found)).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_not_a_number_is_never_on_the_front() {
        let points = [(1.0, f64::NAN), (f64::INFINITY, 0.0), (2.0, 1.0)];
        assert_eq!(pareto(&points, 0.0), [false, false, true]);
    }
}
