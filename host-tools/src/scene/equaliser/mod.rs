//! The equaliser: the inverse of a measured response of the actuator, as a cascade of peaking and shelving sections.
//!
//! Sections are those of Robert Bristow-Johnson's *Cookbook formulae for audio equalizer biquad filter coefficients*
//! (W3C Group Note, 2021), computed by the `biquad` crate. Levenberg-Marquardt fits their frequencies, quality factors
//! and gains to the level in dB at frequencies spread evenly over the logarithm. Sections are added one at a time, each
//! of the kind that lowers the residual most, until one more lowers it too little.
//!
//! **Level.** The equaliser inverts the deviation from the response's mean level in dB over the band, so that the whole
//! is neither louder nor softer than necessary. No frequency is boosted by more than the limit. If the response is
//! further below its mean than the limit, some deviation remains; it is reported separately from the error of the fit.

mod design;
mod response;
mod section;
#[cfg(test)]
mod tests;

pub use design::{CurvePoint, DEFAULT_MAX_GAIN_DB, Design, Deviation, Request, design};
pub use response::Response;
pub use section::{Section, SectionKind};

/// A value out of its range, with its key in a scene's text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Key of the value.
    pub key: &'static str,
    /// Description of the problem.
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
