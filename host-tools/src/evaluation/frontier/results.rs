//! Results of a comparison: filters, and filters with an interval of updates. They are written as `frontier.json`, and
//! read from it where a page is to be drawn anew.

use std::path::Path;

use serde::{Deserialize, Serialize};
use stylus_costs::Peer;

use crate::fit::Order;
use crate::support::bounded_file::{Limit, MIB};
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

use super::costs::Cost;
use super::hard::HardCases;
use super::number::number;
use super::options::CLOCKS_HZ;
use super::parts::PartsRow;
use super::still::Still;
use super::structure::FilterStructure;

/// The most that a comparison's numbers take.
const LIMIT: Limit = Limit {
    of: "a comparison's numbers",
    bytes: 64 * MIB,
};

/// A structure at an order, with its costs and errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Filter {
    /// The structure.
    pub structure: FilterStructure,
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
        order_text(self.order, self.highest_order)
    }
}

/// `order` in a word, as [`Filter::order_text`].
pub(super) fn order_text(order: Order, highest_order: usize) -> String {
    match order {
        Order::Fixed(order) => order.to_string(),
        Order::Bayesian => format!("BIC,\u{a0}≤\u{a0}{highest_order}"),
        Order::Auto | Order::AtMost(_) => format!("AIC,\u{a0}≤\u{a0}{highest_order}"),
    }
}

/// A filter with an interval of updates.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// Index of its filter.
    pub filter: usize,
    /// Samples from one update to the next.
    pub interval: usize,
    /// Error in motion, dB, over the textures that are not refused; not a number if all are.
    #[serde(deserialize_with = "number")]
    pub motion_error_db: f64,
    /// Share of bands in motion within the JND.
    #[serde(deserialize_with = "number")]
    pub motion_within_jnd: f64,
    /// Errors at rest and in motion together, dB.
    #[serde(deserialize_with = "number")]
    pub total_error_db: f64,
    /// Samples at full scale while rubbing.
    pub saturations: u32,
    /// Cycles per sample on a Cortex-M4, updates included.
    #[serde(deserialize_with = "number")]
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

/// `cycles` as a share of a sample's 200 µs.
pub fn share(cycles: f64, clock_hz: f64) -> f64 {
    cycles / (clock_hz / f64::from(SAMPLE_RATE_HZ))
}

/// Everything.
#[derive(Clone, Debug, Serialize, Deserialize)]
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
    #[serde(deserialize_with = "number")]
    pub take_cost: f64,
    /// RMS error in bands of one take against the other, dB.
    #[serde(deserialize_with = "number")]
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
    /// Choices of optional parts, from none to all.
    pub parts: Vec<PartsRow>,
}

impl Frontier {
    /// Reads the numbers that `stylus frontier` wrote.
    ///
    /// # Errors
    /// A file that cannot be read or is no such file.
    pub fn read(path: &Path) -> Result<Self> {
        let frontier: Self = parsed(path)?;
        if frontier
            .points
            .iter()
            .any(|point| point.filter >= frontier.filters.len())
        {
            return Err(unusable(path, "has a choice without its filter"));
        }
        Ok(frontier)
    }
}

/// The content of a file of a comparison's numbers.
pub(super) fn parsed<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T> {
    serde_json::from_str(&LIMIT.read_text(path)?)
        .map_err(|failure| unusable(path, &format!("is no comparison ({failure})")))
}

/// The refusal of such a file.
pub(super) fn unusable(path: &Path, problem: &str) -> Error {
    let remedy = "give a frontier.json that stylus frontier wrote";
    Error::file(path, format!("{problem}: {remedy}"))
}
