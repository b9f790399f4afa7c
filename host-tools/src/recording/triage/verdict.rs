//! Verdicts, by name and in words.

use std::fmt;

use serde::{Serialize, Serializer};

/// A finding about a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Nothing but at most a constant.
    Silent,
    /// Too few samples for a good model.
    TooShort {
        /// How many there are.
        samples: usize,
    },
    /// Samples cut off at the end of the range.
    Clipped {
        /// Share of the samples, of the worst axis.
        share: f64,
    },
    /// A slope under the vibration.
    Drifting {
        /// Share of the energy, of the worst axis.
        share: f64,
    },
    /// A line from the mains.
    Hum {
        /// Its frequency, Hz.
        frequency_hz: f64,
    },
    /// The same samples as another trial.
    Duplicate {
        /// Index of the earlier trial.
        of: usize,
    },
    /// Sampled more slowly than the models are.
    WrongRate {
        /// The file's rate, Hz.
        rate_hz: f64,
    },
}

impl Verdict {
    /// One word or two, as users name it on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::TooShort { .. } => "too-short",
            Self::Clipped { .. } => "clipped",
            Self::Drifting { .. } => "drifting",
            Self::Hum { .. } => "hum",
            Self::Duplicate { .. } => "duplicate",
            Self::WrongRate { .. } => "wrong-rate",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("silent"),
            Self::TooShort { samples } => write!(f, "too short: {samples} samples"),
            Self::Clipped { share } => write!(f, "clipped: {:.2} % of samples", share * 100.0),
            Self::Drifting { share } => write!(f, "drifting: {:.0} % of energy", share * 100.0),
            Self::Hum { frequency_hz } => write!(f, "hum at {frequency_hz:.1} Hz"),
            Self::Duplicate { of } => write!(f, "duplicate of trial {}", of + 1),
            Self::WrongRate { rate_hz } => write!(
                f,
                "wrong rate: {rate_hz} Hz, nothing above {} Hz",
                rate_hz / 2.0
            ),
        }
    }
}

impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
