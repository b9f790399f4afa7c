//! Choices for the conditioning of a recording before it is used: a high-pass filter, then a reduction to one axis.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use stylus_dsp::reduction::Reduction;

#[cfg(doc)]
use stylus_dsp::high_pass::SLOW_HZ;

/// Least fraction of a recording's power below [`SLOW_HZ`] for which the recording is filtered. A smaller one turns the
/// principal axis by at most 1.4° and raises the level by 0.2 dB.
const LEAST_SHARE: f64 = 0.05;

/// Cut-off frequency of the automatic choice, Hz. It attenuates by 64 dB at 8 Hz and by 0.2 dB at 31.5 Hz.
const CUT_HZ: f64 = 20.0;

/// Range of the cut-off frequencies that may be given, Hz.
const CUTS_HZ: [f64; 2] = [1.0, 200.0];

/// The choice of a high-pass filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HighPass {
    /// 20 Hz for recordings with more than 5 % of their power below 10 Hz, none for others.
    #[default]
    Auto,
    /// None: the motion of hand and rig is part of the texture.
    None,
    /// The given cut-off frequency, Hz, for all recordings.
    At(f64),
}

impl HighPass {
    /// Returns the cut-off frequency for a recording, Hz; `slow_share` is the fraction of its power below [`SLOW_HZ`].
    pub fn cut_hz(self, slow_share: f64) -> Option<f64> {
        match self {
            Self::Auto => (slow_share > LEAST_SHARE).then_some(CUT_HZ),
            Self::None => None,
            Self::At(cut_hz) => Some(cut_hz),
        }
    }
}

impl FromStr for HighPass {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let [least, most] = CUTS_HZ;
        match (text, text.parse::<f64>()) {
            ("auto", _) => Ok(Self::Auto),
            ("none", _) => Ok(Self::None),
            // No range contains NaN, which parses as a number.
            (_, Ok(hz)) if (least..=most).contains(&hz) => Ok(Self::At(hz)),
            _ => Err(format!("must be 'auto', 'none' or {least} to {most} Hz")),
        }
    }
}

impl fmt::Display for HighPass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::None => f.write_str("none"),
            Self::At(hz) => write!(f, "{hz}"),
        }
    }
}

/// How a recording's axes are treated before they are used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, clap::Args)]
pub struct Conditioning {
    /// Reduction from three axes to one; give the same to every command that reads one set
    #[arg(id = "reduce", long, value_enum, default_value = "pca")]
    pub reduction: Reduction,
    /// Cut-off of a high-pass filter before the reduction, Hz; 'none' keeps the motion of the hand; 'auto' takes 20 Hz
    /// where more than 5 % of the power is below 10 Hz
    #[arg(long, value_name = "HZ", default_value_t = HighPass::Auto)]
    pub high_pass: HighPass,
}

impl Default for Conditioning {
    fn default() -> Self {
        Self {
            reduction: Reduction::Pca,
            high_pass: HighPass::Auto,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_as_they_are_written_and_others_are_refused() {
        for text in ["auto", "none", "12.5"] {
            assert_eq!(text.parse::<HighPass>().unwrap().to_string(), text);
        }
        for text in ["", "0", "201", "nan", "inf", "-20"] {
            assert!(text.parse::<HighPass>().is_err(), "{text}");
        }
    }
}
