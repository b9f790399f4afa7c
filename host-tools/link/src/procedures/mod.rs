//! Procedures that a person carries out with a stylus. Each makes several requests over a [`link`](crate::link).
//!
//! | module | subject |
//! |---|---|
//! | [`self_test`] | measurements of the device, compared with limits |
//! | [`calibrate`] | values of the coil, and zeros and scales of the sensors, measured and verified |
//! | [`response`] | the actuator's response: measured, equalised, proved and checked; headroom of a library |
//! | [`set`] | a recording set that grows trial by trial |
//! | [`strokes`] | recordings of a free hand, with its motion |
//!
//! Invariant: nothing here prints or asks; a person's answers are arguments.

pub mod calibrate;
pub mod response;
pub mod self_test;
pub mod set;
pub mod strokes;
