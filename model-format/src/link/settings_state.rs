//! State of the settings: set by someone, lost, or differing between their two copies in flash.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::Setting;

/// A set of settings, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SettingSet(u32);

const _: () = assert!(Setting::ALL.len() <= u32::BITS as usize);

impl SettingSet {
    /// No setting.
    pub const NONE: Self = Self(0);

    /// Every setting.
    pub const ALL: Self = Self(!(u32::MAX << Setting::ALL.len()));

    /// The settings without which nothing is played, because only the owner of the coil knows them: a wrong value makes
    /// the model of the coil's warmth wrong by its square.
    ///
    /// `hard-limit` is not among them: it is a voltage at the pin of the device itself, and with these three known, the
    /// thermal limiter holds the power at any value of it.
    pub const REQUIRED: Self = Self::NONE
        .with(Setting::CoilResistance, true)
        .with(Setting::AmplifierGain, true)
        .with(Setting::PowerLimit, true);

    /// Bits of the set: bit n for the setting with number n.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The set of these [`SettingSet::bits`]. Bits that stand for no setting are dropped.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits & Self::ALL.0)
    }

    /// The set with or without `setting`.
    #[must_use]
    pub const fn with(self, setting: Setting, on: bool) -> Self {
        let bit = 1 << setting as u32;
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    /// Returns true if `setting` is in the set.
    pub const fn contains(self, setting: Setting) -> bool {
        self.0 & (1 << setting as u32) != 0
    }

    /// Returns true if the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The settings that are in both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// The settings that are in either set.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The settings of this set that are not in `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The settings in the set.
    pub fn iter(self) -> impl Iterator<Item = Setting> {
        Setting::ALL
            .into_iter()
            .filter(move |&setting| self.contains(setting))
    }
}

impl core::fmt::Display for SettingSet {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (index, setting) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{setting}")?;
        }
        Ok(())
    }
}

/// State of the settings and of their two copies in flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SettingsState {
    /// Settings that someone has set; every other one has its default, with which [`SettingSet::REQUIRED`] do not play.
    pub set: SettingSet,
    /// Settings whose value was lost with both copies. Nothing is played until each is set again, or all are reset.
    pub lost: SettingSet,
    /// Settings whose copies differed at the start, so that the tighter value holds.
    pub differing: SettingSet,
    /// True if a copy was damaged or its writing interrupted, so that the other one holds and both were written anew.
    pub mended: bool,
    /// True if the last change could not be written to flash.
    pub unwritable: bool,
}
