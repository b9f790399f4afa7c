//! The record stream: the codes of the device's converters at each tick, which of them were lost, and the physical
//! values that the codes stand for.

mod calibration;
mod contiguous;
mod stream;

pub use calibration::{Calibration, Level, Loss};
pub(crate) use contiguous::mend;
pub use contiguous::{Capture, capture};
pub use stream::{Arrival, Stream};
