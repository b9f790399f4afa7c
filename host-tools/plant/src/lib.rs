#![doc = include_str!("../README.md")]

mod accelerometer;
pub mod chance;
mod fault;
mod linear;
mod parameters;
mod plant;

pub use fault::{Axis, Fault};
pub use linear::STEP_HZ;
pub use num_complex::Complex;
pub use parameters::{Accelerometer, Amplifier, Body, Coil, Error, Hand, PRESETS, Parameters, Result};
pub use plant::Plant;
