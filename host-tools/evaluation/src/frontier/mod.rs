//! Accuracy against time: every structure, order and update interval, with its error and its cycles, and the Pareto
//! front of both.
//!
//! **At rest** (`still`): the nodes of textures, played by the kernel and by direct forms, against recordings that
//! the fit has not seen. **In motion** ([`moving`]): a hand that rubs over the grid, against float64 at every sample.
//! **Hard cases** (`hard`): those of `stylus stress`, with models cut to the order. **Time** ([`costs`]): a stored
//! table of instructions, which QEMU counted, and of cycles, which llvm-mca modelled. Those of the device's Cortex-M7
//! count.
//!
//! The error of a choice is the root of the sum of squares of its error at rest and its error in motion, in
//! third-octave bands. The first comes from the models and the second from following the hand, so the two are
//! independent. The time of a choice is the time of a sample plus the sample's part of the time of an update.

pub mod costs;
mod hard;
pub mod moving;
mod players;
mod prepared;
mod results;
mod run;
mod still;

use stylus_dsp::spectrum;
use stylus_fit::fit::conditioning::Conditioning;

pub use prepared::{Material, Prepared};
pub use results::{CHOICES_NOTE, Filter, Frontier, Point, clock_headings, interval_ms, share};
pub use stylus_costs::Structure;
use stylus_hard_cases::{Case, Length, suite};

/// Orders that are the same for all nodes.
pub const ORDERS: [usize; 6] = [10, 20, 50, 100, 200, 400];

/// Intervals of updates, samples: 0.2 (every sample) to 10 ms at 5 kHz.
pub const INTERVALS: [usize; 6] = [1, 2, 5, 10, 25, 50];

/// The device's clock, Hz.
pub(crate) const DEVICE_CLOCK_HZ: f64 = 400e6;

/// Clocks at which the time of a sample in a Cortex-M4's cycles is shown, Hz.
pub const CLOCKS_HZ: [f64; 3] = [80e6, 168e6, 480e6];

/// Options of a comparison.
#[derive(Clone, Debug)]
pub struct Options {
    /// Orders that are the same for all nodes.
    pub orders: Vec<usize>,
    /// Conversion of three axes to one.
    pub conditioning: Conditioning,
    /// Width of C's smoothing, Hz.
    pub smoothing_hz: f64,
    /// Duration of each synthesis at rest, s; it is longer if the recording is longer.
    pub synthesis_s: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// The hard cases that are played, at least one.
    pub cases: Vec<Case>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            orders: ORDERS.to_vec(),
            conditioning: Conditioning::default(),
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 4.0,
            seed: 1,
            cases: suite(Length::Short),
        }
    }
}
