//! Reasons for the output to be at mid-scale.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A reason for the output to be at mid-scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[repr(u8)]
pub enum MuteReason {
    /// Nothing is played.
    NotPlaying,
    /// The speed or the force is older than [`super::STALE_AFTER_MS`].
    Stale,
    /// The link that plays has sent no play, motion or keep-alive for [`super::LINK_LOST_AFTER_MS`].
    LinkLost,
    /// A library is being activated, or a texture changed for another.
    Changing,
    /// A fault was found; only a restart ends this mute.
    Fault,
    /// The force sensor is at a rail of its converter: not connected, or overloaded.
    ForceRail,
    /// Safe mode after quick faults; only power or the reset button ends this mute.
    SafeMode,
}

/// Number of reasons.
pub const MUTE_REASON_COUNT: usize = 7;

impl MuteReason {
    /// All reasons, in the order of the counters in [`super::OutputStatus`].
    pub const ALL: [Self; MUTE_REASON_COUNT] = [
        Self::NotPlaying,
        Self::Stale,
        Self::LinkLost,
        Self::Changing,
        Self::Fault,
        Self::ForceRail,
        Self::SafeMode,
    ];
}

impl core::fmt::Display for MuteReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotPlaying => "not playing",
            Self::Stale => "speed or force out of date",
            Self::LinkLost => "link lost",
            Self::Changing => "changing texture or library",
            Self::Fault => "fault",
            Self::ForceRail => "force sensor at its rail: connect it, or press less",
            Self::SafeMode => "safe mode",
        })
    }
}

/// A set of reasons, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct MuteReasons(u8);

impl MuteReasons {
    /// No reason: the output is on.
    pub const NONE: Self = Self(0);

    /// Bits of the set: bit n for the nth of [`MuteReason::ALL`].
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The set of these [`MuteReasons::bits`]. Bits that stand for no reason are dropped.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & ((1 << MUTE_REASON_COUNT) - 1))
    }

    /// The set with or without `reason`.
    #[must_use]
    pub const fn set(self, reason: MuteReason, on: bool) -> Self {
        let bit = 1 << reason as u8;
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    /// Returns whether `reason` is in the set.
    pub const fn contains(self, reason: MuteReason) -> bool {
        self.0 & (1 << reason as u8) != 0
    }

    /// Returns whether the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The reasons in the set.
    pub fn iter(self) -> impl Iterator<Item = MuteReason> {
        MuteReason::ALL
            .into_iter()
            .filter(move |&reason| self.contains(reason))
    }
}

impl core::fmt::Display for MuteReasons {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (index, reason) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{reason}")?;
        }
        Ok(())
    }
}
