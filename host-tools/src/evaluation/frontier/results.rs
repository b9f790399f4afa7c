//! Results of a comparison: filters, and filters with an interval of updates.

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;
use stylus_costs::{Peer, Structure};

use super::CLOCKS_HZ;
use super::costs::Cost;
use super::hard::HardCases;
use super::still::Still;
use crate::evaluation::tables::{Table, percent};
use crate::fit::Order;

/// A structure at an order, with its costs and errors.
#[derive(Clone, Debug, Serialize)]
pub struct Filter {
    /// The structure.
    pub structure: Structure,
    /// Choice of the order.
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
    /// On a Cortex-M7.
    pub m7: Cost,
    /// Flash that a node takes in a library, bytes.
    pub library_bytes_per_node: usize,
    /// RAM for two frames' coefficients and the state, bytes.
    pub ram_bytes: usize,
    /// True if it plays all nodes and nothing cheaper has as low a C.
    pub on_cost_front: bool,
}

impl Filter {
    /// The order in a word: where each node has its own, the criterion and the highest.
    pub fn order_text(&self) -> String {
        let highest = self.highest_order;
        match self.order {
            Order::Fixed(order) => order.to_string(),
            Order::Bayesian => format!("BIC,\u{a0}≤\u{a0}{highest}"),
            Order::Auto => format!("AIC,\u{a0}≤\u{a0}{highest}"),
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
    /// Cycles per sample on a Cortex-M4, updates included.
    pub cycles: f64,
    /// True if it plays all textures and nothing cheaper has as low an error.
    pub on_front: bool,
    /// True if it holds every hard case and nothing cheaper that does has as low an error.
    pub on_safe_front: bool,
}

impl Point {
    /// Share of a sample's time at each of [`CLOCKS_HZ`].
    pub fn shares(&self) -> [f64; 3] {
        CLOCKS_HZ.map(|clock_hz| share(self.cycles, clock_hz))
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

/// Headings of shares of the time, by clock.
pub fn clock_headings() -> [String; 3] {
    CLOCKS_HZ.map(|clock_hz| format!("{} MHz, %", clock_hz / 1e6))
}

/// `cycles` as a share of a sample's 200 µs.
pub fn share(cycles: f64, clock_hz: f64) -> f64 {
    cycles / (clock_hz / f64::from(SAMPLE_RATE_HZ))
}

/// Everything.
#[derive(Clone, Debug, Serialize)]
pub struct Frontier {
    /// Description of the fitted and the held-out recordings.
    pub material: String,
    /// True if any recording is simulated.
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
    /// The version of LLVM whose llvm-mca modelled the Cortex-M7.
    pub llvm_mca: String,
    /// Other implementations beside ours.
    pub peers: Vec<Peer>,
    /// Structures by orders.
    pub filters: Vec<Filter>,
    /// Filters by intervals.
    pub points: Vec<Point>,
}

impl Frontier {
    /// The choices on a front, the cheapest first.
    pub fn front_table(&self) -> Table {
        let on_a_front = |point: &&Point| point.on_front || point.on_safe_front;
        let mut points: Vec<&Point> = self.points.iter().filter(on_a_front).collect();
        points.sort_by(|a, b| a.cycles.total_cmp(&b.cycles));
        let row = |point: &Point| {
            let filter = &self.filters[point.filter];
            let cell = |heading: &str, text: String| (heading.to_owned(), text);
            let mut row = vec![
                cell("structure", filter.structure.to_string()),
                cell("order", filter.order_text()),
                cell("update, ms", point.interval_ms().to_string()),
                cell("error, dB", format!("{:.2}", point.total_error_db)),
                cell("at rest", format!("{:.2}", filter.still.band_error_db)),
                cell("in motion", format!("{:.2}", point.motion_error_db)),
                cell("C, %", percent(Some(filter.still.cost), 1)),
                cell("SNR, dB", format!("{:.0}", filter.still.lowest_snr_db)),
                cell("cycles", format!("{:.0}", point.cycles)),
            ];
            let shares = point.shares().map(|share| percent(Some(share), 1));
            row.extend(clock_headings().into_iter().zip(shares));
            let held = format!("{} of {}", filter.hard.held, filter.hard.cases);
            let front = match (point.on_front, point.on_safe_front) {
                (true, true) => "both",
                (true, false) => "all",
                (false, _) => "safe",
            };
            row.push(cell("hard cases held", held));
            row.push(cell("front of", front.to_owned()));
            row
        };
        Table::headed(
            "Nothing cheaper has a lower error, all textures being held; safe: among what holds every hard case; \
             shares are of 200 µs",
            points.into_iter().map(row),
        )
    }

    /// The numbers as JSON, a line per filter, choice and row.
    pub fn to_json(&self) -> String {
        let value = serde_json::to_value(self).expect("plain data become JSON");
        let fields = value
            .as_object()
            .into_iter()
            .flatten()
            .map(|(name, value)| {
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

/// Least gains that count for more time: less is the scatter of the measurement.
mod worth {
    /// Of C.
    pub const COST: f64 = 0.005;
    /// Of errors in bands, dB.
    pub const BAND_DB: f64 = 0.05;
}

/// Marks what nothing cheaper beats. Where a structure does not hold all nodes or textures it is not in the running.
pub(super) fn mark_fronts(frontier: &mut Frontier) {
    let costs = frontier.filters.iter().map(|filter| {
        let holds = filter.still.refused == 0;
        let cost = if holds { filter.still.cost } else { f64::NAN };
        (filter.m4.sample.cycles, cost)
    });
    let on_cost_front = pareto(&costs.collect::<Vec<_>>(), worth::COST);
    let front = |holds: fn(&Filter) -> bool| {
        let points = frontier.points.iter().map(|point| {
            let filter = &frontier.filters[point.filter];
            let is_played = filter.still.refused == 0 && filter.refused_textures.is_empty();
            let error = if is_played && holds(filter) {
                point.total_error_db
            } else {
                f64::NAN
            };
            (point.cycles, error)
        });
        pareto(&points.collect::<Vec<_>>(), worth::BAND_DB)
    };
    let on_front = front(|_| true);
    let on_safe_front = front(|filter| filter.hard.held == filter.hard.cases);
    for (filter, on_front) in frontier.filters.iter_mut().zip(on_cost_front) {
        filter.on_cost_front = on_front;
    }
    let marks = on_front.into_iter().zip(on_safe_front);
    for (point, (on_front, on_safe_front)) in frontier.points.iter_mut().zip(marks) {
        (point.on_front, point.on_safe_front) = (on_front, on_safe_front);
    }
}

/// Marks the pairs (cost, error) that no other beats: none that costs as much or less has an error as low within
/// `worth`, by which an error must fall for more cost to count. What is not a number is never on the front.
fn pareto(points: &[(f64, f64)], worth: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&index| points[index].0.is_finite() && points[index].1.is_finite())
        .collect();
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

    #[test]
    fn what_is_not_a_number_is_never_on_the_front() {
        let points = [(1.0, f64::NAN), (f64::INFINITY, 0.0), (2.0, 1.0)];
        assert_eq!(pareto(&points, 0.0), [false, false, true]);
    }
}
