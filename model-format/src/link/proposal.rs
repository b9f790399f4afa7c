//! State of the settings, and changes of settings in two steps: a host proposes a change, receives a token, and then
//! applies the change with this token.
//!
//! So a single frame changes nothing. The device holds one proposal, which [`super::Status`] shows with its token. The
//! proposal ends after [`super::PROPOSAL_VALID_MS`], with a play, with a restart, with another proposal, and with its
//! first use. Only the link that made the proposal can apply it. This protects from mistakes and from two programs at
//! once, but not from a malicious user of the port.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{LinkId, SETTING_COUNT, Setting, SettingChange, Settings, SettingsError, Tighter};

/// Token of a proposal. Two successive proposals have different tokens, on one device or on two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ProposalToken(pub u32);

impl core::fmt::Display for ProposalToken {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

/// Change of settings. It is made completely or not at all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub enum SettingsChange {
    /// New values of some settings.
    Set(Vec<SettingChange, SETTING_COUNT>),
    /// Every setting gets its default and counts as not set.
    Reset,
}

/// Settings that describe the hardware or limit it: those for which one value protects better than another, see
/// [`Setting::tighter`].
pub const LOCKED: SettingSet = {
    let (mut locked, mut index) = (SettingSet::NONE, 0);
    while index < SETTING_COUNT {
        let setting = Setting::ALL[index];
        locked = locked.with(setting, setting.tighter().is_some());
        index += 1;
    }
    locked
};

impl SettingsChange {
    /// Creates the change to `values` without checking it; see [`Self::check`].
    ///
    /// # Errors
    /// More values than there are settings, so that one occurs twice.
    pub fn of(values: &[SettingChange]) -> Result<Self, SettingsError> {
        let too_many = values
            .last()
            .map_or(SettingsError::Nothing, |last| SettingsError::Repeated {
                setting: last.setting,
            });
        Vec::from_slice(values).map(Self::Set).map_err(|_| too_many)
    }

    /// Checks that every value is in its setting's range, and that no setting has two values.
    ///
    /// # Errors
    /// A value out of range, a setting that occurs twice, or no value at all.
    pub fn check(&self) -> Result<(), SettingsError> {
        let Self::Set(values) = self else {
            return Ok(());
        };
        let mut seen = SettingSet::NONE;
        for &SettingChange { setting, value } in values {
            setting.check(value)?;
            if seen.contains(setting) {
                return Err(SettingsError::Repeated { setting });
            }
            seen = seen.with(setting, true);
        }
        if seen.is_empty() {
            return Err(SettingsError::Nothing);
        }
        Ok(())
    }

    /// Returns the settings after this change of `settings`.
    pub fn applied_to(&self, settings: Settings) -> Result<Settings, SettingsError> {
        match self {
            Self::Set(values) => values
                .iter()
                .try_fold(settings, |settings, &change| settings.with(change)),
            Self::Reset => Ok(Settings::DEFAULT),
        }
    }

    /// Returns the [`LOCKED`] settings whose protection this change reduces, or to which it gives a first value. A host
    /// asks its user about these settings.
    pub fn loosens(&self, settings: &Settings, state: &SettingsState) -> SettingSet {
        // After a reset nobody has set any of them.
        let Self::Set(values) = self else {
            return LOCKED;
        };
        // Where nobody knows the value before, no value can be called tighter.
        let unknown = state.lost.or(SettingSet::REQUIRED.without(state.set));
        values.iter().fold(SettingSet::NONE, |set, change| {
            let (setting, before) = (change.setting, settings.get(change.setting));
            let is_looser = match setting.tighter() {
                Some(Tighter::Lower) => change.value > before,
                Some(Tighter::Higher) => change.value < before,
                None => false,
            };
            let loosens = is_looser || (LOCKED.contains(setting) && unknown.contains(setting));
            set.with(setting, loosens)
        })
    }
}

/// A change that was proposed and not yet applied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct SettingsProposal {
    /// Token with which the change is applied.
    pub token: ProposalToken,
    /// The change.
    pub change: SettingsChange,
    /// Settings in the change about which a host asks its user; see [`SettingsChange::loosens`].
    pub loosens: SettingSet,
    /// The link that proposed the change. Only this link may apply it.
    pub from: LinkId,
    /// Time that remains to apply it, ms.
    pub remaining_ms: u32,
}

/// A set of settings, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SettingSet(u32);

const _: () = assert!(Setting::ALL.len() <= u32::BITS as usize);

impl SettingSet {
    /// No setting.
    pub const NONE: Self = Self(0);

    /// Every setting.
    pub const ALL: Self = Self(!(u32::MAX << Setting::ALL.len()));

    /// The settings without which nothing is played, because only the owner of the coil knows them. A wrong value makes
    /// the model of the coil's temperature wrong, for the gain even by the square of the error.
    ///
    /// `hard-limit` is not among them, because it is a voltage at the device's own pin. If these three settings are
    /// known, the thermal limiter limits the power for any value of `hard-limit`.
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
        Setting::ALL.into_iter().filter(move |&setting| self.contains(setting))
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
    /// Settings that were set; every other setting has its default. Nothing is played while a setting of
    /// [`SettingSet::REQUIRED`] has only its default.
    pub set: SettingSet,
    /// Settings whose value was lost with both copies. Nothing is played until each is set again, or all are reset.
    pub lost: SettingSet,
    /// Settings whose two copies differed at the start, so that the tighter value is used.
    pub differing: SettingSet,
    /// True if one copy was damaged or its writing was interrupted. The other copy is then used, and both were written
    /// again.
    pub mended: bool,
    /// True if the last change could not be written to flash.
    pub unwritable: bool,
}
