//! Verdicts, by name and in words.

use std::fmt;

use serde::{Serialize, Serializer};

use super::fingerprint::Likeness;

/// A verdict on a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// No signal, apart from a constant.
    Silent,
    /// Too few samples for a good model.
    TooShort {
        /// Number of samples.
        samples: usize,
    },
    /// Samples at the limits of the range.
    Clipped {
        /// Share of clipped samples on the worst axis.
        share: f64,
    },
    /// A linear trend under the vibration.
    Drifting {
        /// Share of the trend in the energy of the worst axis.
        share: f64,
    },
    /// A spectral line of the mains.
    Hum {
        /// Frequency of the line, Hz.
        frequency_hz: f64,
    },
    /// A copy of another trial, also one that is scaled, inverted or shifted.
    Duplicate {
        /// Index of the earlier trial.
        of: usize,
        /// Relation to it.
        likeness: Likeness,
    },
    /// A lower sample rate than that of the models.
    WrongRate {
        /// Sample rate of the file, Hz.
        rate_hz: f64,
    },
}

impl Verdict {
    /// Name of the verdict, as users give it on the command line.
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
            Self::Duplicate { of, likeness } => {
                write!(f, "duplicate of trial {}{likeness}", of + 1)
            }
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
