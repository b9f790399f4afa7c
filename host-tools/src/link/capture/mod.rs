//! The record stream: the codes of the device's converters at each tick, what of it was lost, and the physical values
//! that the codes stand for.

mod calibration;
mod contiguous;
mod level;
mod loss;
mod stream;

pub use calibration::Calibration;
pub use contiguous::{Capture, capture};
pub use level::Level;
pub use loss::Loss;
pub use stream::{Arrival, Stream};
