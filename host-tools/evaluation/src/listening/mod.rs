//! Listening tests of three designs. In trials of A, B and X, X is of the same kind as A or B, and a listener says
//! which. In ratings, a listener says how alike two sounds are. Staircases find the strength of a part that a listener
//! can just notice.
//!
//! Two excerpts of one noise differ in every sample. If X were the same excerpt as A or B, a listener could recognise
//! it by its waveform. So X is another excerpt of the same kind, at the same speed and force, and no two syntheses of a
//! trial are from the same window of their common noise. All excerpts of a page have the same RMS, so that level gives
//! no hint, unless the level itself is tested. Recordings are excerpts of what was held out from the fit.
//!
//! A listener who hears no difference answers right in half of the trials. The exact interval of the proportion
//! ([`clopper_pearson`](stylus_dsp::binomial::clopper_pearson)) shows whether the listener heard a difference.
//!
//! The kinds of signals, and the pairs of them that are compared, are here.

mod abx;
mod answers;
mod excerpts;
mod plan;
mod similarity;
mod staircase;

use serde::Serialize;

pub use abx::Trial;
pub use answers::{Answers, CHANCE, CONFIDENCE, Field, Score, score};
pub use excerpts::{FADE_S, SHORTEST_EXCERPT_S};
pub use plan::{Compared, Design, Options, Plan, Task, plan};
pub use similarity::Ratings;
pub use staircase::{Part, Staircases};

/// A kind of signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A recording that was not fitted.
    Recording,
    /// The texture's filter, excited by Gaussian noise.
    Gaussian,
    /// The texture with all its parts.
    Fitted,
    /// The texture of another library.
    Before,
}

/// Two kinds that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Pair {
    /// A recording and the texture as fitted.
    RecordingFitted,
    /// A recording and Gaussian noise through the filter.
    RecordingGaussian,
    /// Gaussian noise through the filter and the texture as fitted.
    GaussianFitted,
    /// A recording and the texture of another library.
    RecordingBefore,
    /// The textures of another library and of this one.
    BeforeFitted,
}

impl Kind {
    /// The kind's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Gaussian => "gaussian",
            Self::Fitted => "fitted",
            Self::Before => "before",
        }
    }
}

impl Pair {
    /// The pairs of one library.
    pub const USUAL: [Self; 3] = [Self::RecordingFitted, Self::RecordingGaussian, Self::GaussianFitted];

    /// The pairs of two libraries.
    pub const WITH_BEFORE: [Self; 3] = [Self::RecordingFitted, Self::RecordingBefore, Self::BeforeFitted];

    /// Returns the requested pairs, each once, or the usual ones if none is requested. `has_before` says whether
    /// another library is compared, too.
    pub fn asked(pairs: &[Self], has_before: bool) -> Vec<Self> {
        match pairs {
            [] if has_before => Self::WITH_BEFORE.to_vec(),
            [] => Self::USUAL.to_vec(),
            asked => once(asked),
        }
    }

    /// Both kinds.
    pub fn kinds(self) -> [Kind; 2] {
        match self {
            Self::RecordingFitted => [Kind::Recording, Kind::Fitted],
            Self::RecordingGaussian => [Kind::Recording, Kind::Gaussian],
            Self::GaussianFitted => [Kind::Gaussian, Kind::Fitted],
            Self::RecordingBefore => [Kind::Recording, Kind::Before],
            Self::BeforeFitted => [Kind::Before, Kind::Fitted],
        }
    }

    /// The pair's name in files.
    pub fn name(self) -> String {
        self.kinds().map(Kind::name).join("-")
    }
}

/// Returns the requested items, each once.
pub fn once<T: Copy + PartialEq>(asked: &[T]) -> Vec<T> {
    let mut once = Vec::new();
    for one in asked {
        if !once.contains(one) {
            once.push(*one);
        }
    }
    once
}
