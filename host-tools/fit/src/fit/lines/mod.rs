//! Lines that are tied to position. A surface with a period, such as a weave or a grating, sounds at the frequency
//! speed / wavelength. This module separates that sound from everything else that the surface sounds.
//!
//! Lines are sought jointly in all trials of a texture (`search`), except those that are silent, idle or dropped. Where
//! triage cut a part out of a trial, the phase jumps, so that each stretch between cuts is a trial here. In each trial
//! the lines are then fitted by least squares over the position of the surface under the tool (`track`) and subtracted
//! (`separate`), so that the stochastic model is fitted to the remainder. As much of each line stays in the signal as
//! noise would have there, so that the remainder has neither a line nor a hole.
//!
//! A line whose frequency is the same at all speeds, such as mains hum, is only reported. It stays in the signal; the
//! search removes it from its own copy, so that it is not taken for a line of the surface.
//!
//! Threads that are not evenly spaced make a band instead of a narrow line. Bands of a steady amplitude (`bands`) are
//! therefore always sought too. The phase of such a band gives the position with its wander (`wander`). The bands are
//! used if there is no narrow line, or if their lines have more than 1.1 times the power of the narrow ones.
//!
//! Along a free hand's strokes (`along`), the position is known at each sample, and the speed never steady.

mod along;
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
pub(crate) use along::{Along, Stretch, along};
pub use findings::{Findings, Line, NoLines, TrialLines};
pub(crate) use findings::{LineMember, lines_on};
pub(crate) use separate::separate;
