//! The equaliser: the inverse of a measured response of the actuator, as a cascade of peaking and shelving sections.
//!
//! Sections are those of Robert Bristow-Johnson's *Cookbook formulae for audio equalizer biquad filter coefficients* (W3C
//! Group Note, 2021), computed by the `biquad` crate. What is fitted are their frequencies, quality factors and gains, by
//! Levenberg-Marquardt over the level in dB at frequencies spread evenly over the logarithm; sections are added one at a
//! time, each of the kind that helps most, as long as one more helps.
//!
//! **Level.** What is undone is the deviation from the response's own mean level in dB over the band, so that the equaliser
//! makes the whole neither louder nor softer than it must. It boosts nothing by more than the limit: where the response lies
//! lower than that below its mean, some of the deviation stays, and how much is told apart from the fit's own error.

mod design;
mod response;
mod section;
#[cfg(test)]
mod tests;

pub use design::{CurvePoint, DEFAULT_MAX_GAIN_DB, Design, Deviation, Request, design};
pub use response::Response;
pub use section::{Section, SectionKind};

/// A value that cannot be, with the key that holds it in a scene's text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The key.
    pub key: &'static str,
    /// What is wrong with it.
    pub problem: String,
}

impl Fault {
    fn new(key: &'static str, problem: impl Into<String>) -> Self {
        Self {
            key,
            problem: problem.into(),
        }
    }
}
