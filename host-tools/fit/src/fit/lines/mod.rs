//! Lines that are tied to position: what a surface with a period, such as a weave or a grating, sounds at speed over
//! wavelength, apart from everything else that it sounds.
//!
//! A texture's lines are sought in all its trials together (`search`); each trial's share of them is then fitted by
//! least squares on the place of the surface under the tool (`track`), and removed, so that the stochastic model is
//! fitted to the rest. What is removed leaves as much as noise would have there, so that the rest has neither a line
//! nor a hole.
//!
//! Threads that are not evenly spaced make a band instead of a line. If there is no narrow line, bands of a steady
//! amplitude are sought (`bands`), whose phase tells the place with its wander (`wander`).

mod bands;
mod findings;
mod peaks;
mod search;
mod separate;

#[cfg(test)]
mod tests;
mod track;
mod wander;

pub use super::options::Lines;
pub use findings::{Findings, Line, LineMember, NoLines, TrialLines, lines_on};
pub use separate::{Separated, separate};
