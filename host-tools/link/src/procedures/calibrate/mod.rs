//! Calibration of a stylus: the coil's measured values, checked against each other, and its sensors, measured.
//!
//! The device cannot measure its coil, because it has no current sense. So resistance, amplifier gain and power limit
//! are measured by a person, and [`Coil`] says what follows from them. The sensors' codes without force and
//! acceleration are measured by the device itself, with their noise, and measured again after they were set. The scale
//! of the force comes from known weights ([`ForceScale`]), the scale of the path from a known distance ([`PathScale`]).

mod coil;
mod force;
mod path;
mod rest;

pub use coil::Coil;
pub use force::{ForceFault, ForceScale, Weighed, order};
pub use path::{PathFault, PathScale, Travel};
pub use rest::{AtRest, acceleration_zeros, verify};
