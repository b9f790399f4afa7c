//! Kinds of signals, and the pairs of them that are compared.

use serde::Serialize;

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
