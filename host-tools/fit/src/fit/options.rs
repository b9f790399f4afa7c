//! Choices of a fit.

use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use serde::{Deserialize, Serialize};
use stylus_signals::recording::Snap;
use stylus_signals::recording::triage::{Kind, SILENCE_FLOOR_M_S2};
use stylus_support::number::not_negative;
use stylus_support::{Error, Result};

use model_format::{PlayRate, SAMPLE_RATE_HZ};

use crate::fit::conditioning::Conditioning;

/// The choice of a model's order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// For each node by Akaike's criterion, at most 400: the order with the least expected error for another take, or a
    /// lower one that preserves all third octaves equally well.
    Auto,
    /// For each node by the Bayesian information criterion, at most 400. Libraries are smaller, but the lowest bands
    /// and short recordings are modelled less well.
    Bayesian,
    /// The same order for all nodes, as in the paper (whose order is 400).
    Fixed(usize),
}

impl Order {
    /// Returns the highest order that the choice allows.
    pub fn highest(self) -> usize {
        match self {
            Self::Auto | Self::Bayesian => model_format::limits::MAX_ORDER,
            Self::Fixed(order) => order,
        }
    }
}

impl std::str::FromStr for Order {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        const MAX_ORDER: usize = model_format::limits::MAX_ORDER;
        match text.parse::<usize>() {
            _ if text == "auto" => Ok(Self::Auto),
            _ if text == "bic" => Ok(Self::Bayesian),
            Ok(order) if order <= MAX_ORDER => Ok(Self::Fixed(order)),
            _ => Err(format!("must be 'auto', 'bic' or 0 to {MAX_ORDER}")),
        }
    }
}

/// The choice of an excitation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ExcitationChoice {
    /// Gaussian noise.
    Gaussian,
    /// Recorded snippets of the prediction residual, wherever there is enough of it.
    Snippets,
    /// Recorded snippets where a test finds that they would not be Gaussian noise, Gaussian noise elsewhere.
    #[default]
    Auto,
}

/// The choice of lines that are tied to position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Lines {
    /// Those that stand out at half of the speeds at least, by a test at a level of 1e-3 per texture.
    Auto,
    /// None: whatever has a period is fitted as noise.
    #[default]
    None,
}

/// The choice of what is done with the rig's own noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum FloorChoice {
    /// Its spectrum is taken off each recording before anything is fitted.
    Subtract,
    /// Its share of the recordings' power is told.
    #[default]
    Note,
    /// Nothing.
    None,
}

/// Options of a fit.
#[derive(Clone, Debug, Serialize, Deserialize, clap::Args)]
pub struct Options {
    /// Order of the models: 0 to 400, or per node 'auto' (AIC, or lower where third octaves stay as near) or 'bic'
    /// (lower still)
    #[arg(long, default_value = "auto")]
    pub order: Order,
    /// From three axes to one signal
    #[command(flatten)]
    #[serde(flatten)]
    pub conditioning: Conditioning,
    /// RMS below which a trial counts as silent, in m/s²
    #[arg(
        long = "silence-floor",
        value_name = "M_S2",
        value_parser = not_negative,
        default_value_t = SILENCE_FLOOR_M_S2
    )]
    pub silence_floor_m_s2: f64,
    /// Excitation: noise, recorded snippets of the residual, or what a test finds
    #[arg(long, value_enum, default_value = "auto")]
    pub excitation: ExcitationChoice,
    /// Leave out trials with these verdicts; a node without another trial is filled from its neighbours
    #[arg(long, value_delimiter = ',', value_parser = PossibleValuesParser::new(Kind::NAMES))]
    pub drop: Vec<String>,
    /// Lines that are tied to position, such as those of a weave: sought, or left in the noise
    #[arg(long, value_enum, default_value = "auto")]
    pub lines: Lines,
    /// The rig's own noise, as trials in motion at 0 N have it: subtracted from the recordings, or its share
    /// reported
    #[arg(long, value_enum, default_value = "note")]
    pub floor: FloorChoice,
    /// Recording, or list of them by speed, that has the rig's noise in place of trials at 0 N
    #[arg(long, value_name = "FILE|DIR")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor_recording: Option<PathBuf>,
    /// Refuse a set if triage finds anything
    #[arg(long)]
    pub strict: bool,
    /// Move measured speeds and forces to nominal ones: by at most this share, such as 0.05; auto, to the likeliest
    /// grid; clear, only where gaps between groups of values are three times as wide as the groups; or none
    // Values are snapped before the fit, which takes the set as it is given.
    #[arg(long, value_name = "SHARE|clear|auto|none", default_value_t)]
    pub snap: Snap,
    /// Sample rate of the models, Hz: 5000, or 10000 from recordings of that rate or above
    #[arg(id = "model_rate_hz", long = "model-rate", value_name = "HZ", default_value_t = SAMPLE_RATE_HZ)]
    pub sample_rate_hz: u32,
}

/// Returns the playing rate of `rate_hz` samples per second.
pub(super) fn play_rate(rate_hz: u32) -> Result<PlayRate> {
    PlayRate::of(rate_hz).ok_or_else(|| {
        let rates = PlayRate::ALL.map(|rate| rate.hz().to_string()).join(" or ");
        Error::Request(format!("a sample rate of {rate_hz} Hz: a stylus plays {rates}"))
    })
}

impl Options {
    /// Returns the options for their sample rate: at another rate than 5 kHz without the automatic choices that exist
    /// only there.
    ///
    /// # Errors
    /// A rate that the stylus does not play; at another rate than 5 kHz, a choice by hand that exists only there, which
    /// is named.
    pub fn at_their_rate(&self) -> Result<Self> {
        let rate_hz = self.sample_rate_hz;
        if rate_hz == SAMPLE_RATE_HZ {
            return Ok(self.clone());
        }
        play_rate(rate_hz)?;
        if self.excitation == ExcitationChoice::Snippets {
            return Err(Error::Request(format!(
                "--excitation snippets is fitted at {SAMPLE_RATE_HZ} Hz alone: leave it out, or fit at that rate"
            )));
        }
        Ok(Self {
            excitation: ExcitationChoice::Gaussian,
            lines: Lines::None,
            ..self.clone()
        })
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            order: Order::Auto,
            conditioning: Conditioning::default(),
            silence_floor_m_s2: SILENCE_FLOOR_M_S2,
            excitation: ExcitationChoice::Auto,
            drop: Vec::new(),
            lines: Lines::Auto,
            floor: FloorChoice::Note,
            floor_recording: None,
            strict: false,
            snap: Snap::default(),
            sample_rate_hz: SAMPLE_RATE_HZ,
        }
    }
}
