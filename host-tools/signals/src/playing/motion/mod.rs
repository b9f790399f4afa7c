//! Motion of a hand over time, for a rendering: constant, or from a CSV file.
//!
//! ```text
//! # Comments begin with a number sign.
//! time_s,speed_mm_s,force_n
//! 0.0,0,0.5
//! 1.5,120,0.8
//! ```
//! The sign of a speed is its direction along the path, and a force at or below zero means no contact. This holds for
//! every motion: on the command line, in a scene and on the link. Values that no hand reaches are refused.
//!
//! Columns may be in any order, and other columns are ignored. A column `position_mm` gives the position on the path;
//! without it, the position is the integral of the speed, from 0 mm. A column `contact`, 0 or 1, gives contact with the
//! surface; without it, contact follows from the force, see [`Hand`].

mod path;
mod table;

pub use path::{Hand, MotionPath, MotionRow};
