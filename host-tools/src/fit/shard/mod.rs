//! A fit as a map over trials and a reduce over nodes, with files in between.
//!
//! The map reads a trial and computes what no other trial tells: autocorrelation by the chosen estimator, third-octave
//! bands, level, verdicts of triage, the landmarks by which copies are found, and its share of its texture's lines. A
//! *unit* of it is what must be computed together: all trials of a texture where lines are sought, because they show in
//! all of them, and up to 64 trials of a texture otherwise. Unit k belongs to shard k mod n.
//!
//! The reduce compares the trials, pools each node's lags and fits its model. It goes over the textures one after the
//! other, and holds the lags of one. Where the excitation needs residuals, it reads the texture's recordings again.
//!
//! A partial file holds a shard (`file`). While it is made it is a journal, to which each unit is appended (`journal`):
//! what an interrupted map has done is there when it is started again, and what an earlier one has done is taken over
//! where name, size and time of the recordings, their lines in the list and the options are the same.
//!
//! The library and its record are equal to the bit to those of one process, on processors with the same vector
//! instructions: transforms are of the same bits only then.

mod file;
mod identity;
mod journal;
mod map;
mod merge;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use map::{Mapped, map};
pub use merge::Merged;

/// Most shards of a fit.
const MOST_SHARDS: u32 = 100_000;

/// One of the shards of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Shard {
    /// Number of the shard, from 1.
    pub number: u32,
    /// Number of shards.
    pub of: u32,
}

impl Shard {
    /// The whole of a fit.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// Returns whether the piece of work `index` is this shard's.
    pub fn has(self, index: usize) -> bool {
        index % self.of as usize == self.number as usize - 1
    }

    /// Returns whether the number is one of the shards.
    fn is_sound(self) -> bool {
        (1..=MOST_SHARDS).contains(&self.of) && (1..=self.of).contains(&self.number)
    }

    /// Name of its partial file.
    pub fn file_name(self) -> String {
        format!("shard-{:05}-of-{:05}.{ENDING}", self.number, self.of)
    }
}

/// Ending of the names of partial files.
const ENDING: &str = "part";

impl fmt::Display for Shard {
    /// Writes `3/8`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(number, of)| {
            Some(Self {
                number: number.parse().ok()?,
                of: of.parse().ok()?,
            })
        });
        parsed.filter(|shard| shard.is_sound()).ok_or_else(|| {
            format!("must be I/N with I from 1 to N, such as 3/8, and N at most {MOST_SHARDS}")
        })
    }
}
