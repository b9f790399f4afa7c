//! Changes of settings, in two steps: a host proposes a change, and then applies it by the token that it was given.
//!
//! One frame alone changes nothing. The device holds one proposal, which [`super::Status`] shows with its token. It
//! ends after [`super::PROPOSAL_VALID_MS`], with a play, a restart, another proposal, and with its first use. It is
//! applied by the link that made it alone. This protects from mistakes, and from two programs at once; not from whoever
//! has the port and means harm.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{LinkId, SETTING_COUNT, Setting, SettingChange, SettingSet, Settings, SettingsError};
use super::{SettingsState, Tighter};

/// Token of a proposal. No two in a row are the same, on one device or on two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ProposalToken(pub u32);

impl core::fmt::Display for ProposalToken {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

/// Change of settings, of which all is done or nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub enum SettingsChange {
    /// New values of some settings.
    Set(Vec<SettingChange, SETTING_COUNT>),
    /// Every setting to its default, and none of them set.
    Reset,
}

/// Settings that describe the hardware or limit it: those of which one value protects better than another.
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
    /// The change to `values`, which [`Self::check`] judges.
    ///
    /// # Errors
    /// More values than there are settings, so that one occurs twice.
    pub fn of(values: &[SettingChange]) -> Result<Self, SettingsError> {
        let too_many =
            values
                .last()
                .map_or(SettingsError::Nothing, |last| SettingsError::Repeated {
                    setting: last.setting,
                });
        Vec::from_slice(values).map(Self::Set).map_err(|_| too_many)
    }

    /// Checks that every value is in its setting's range, and that no setting has two.
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
    ///
    /// # Errors
    /// A value that the setting may not have.
    pub fn applied_to(&self, settings: Settings) -> Result<Settings, SettingsError> {
        match self {
            Self::Set(values) => values
                .iter()
                .try_fold(settings, |settings, &change| settings.with(change)),
            Self::Reset => Ok(Settings::DEFAULT),
        }
    }

    /// Returns the [`LOCKED`] settings of which this change takes protection away, or gives a first value: those for
    /// which a host asks its user.
    pub fn loosens(&self, settings: &Settings, state: &SettingsState) -> SettingSet {
        let Self::Set(values) = self else {
            return LOCKED;
        };
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
    /// Token that applies it.
    pub token: ProposalToken,
    /// The change.
    pub change: SettingsChange,
    /// Settings of it for which a host asks its user; see [`SettingsChange::loosens`].
    pub loosens: SettingSet,
    /// The link that proposed it, and that alone may apply it.
    pub from: LinkId,
    /// Time that remains to apply it, ms.
    pub remaining_ms: u32,
}
