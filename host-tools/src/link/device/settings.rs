//! Requests about the device's settings. A change takes two: it is proposed, and then applied by its token.

use model_format::link::{
    SettingChange, Settings, SettingsApplyEndpoint, SettingsChange, SettingsGetEndpoint,
    SettingsProposal, SettingsProposeEndpoint,
};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Reads the settings.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn settings(&self) -> Result<Settings> {
        Ok(self.request_flash::<SettingsGetEndpoint>("settings", &())??)
    }

    /// Proposes a change of settings, which [`Device::apply`] applies. Nothing changes yet.
    ///
    /// # Errors
    /// Values that the device refuses, or something that is played; an answer about another change.
    pub fn propose(&self, change: &SettingsChange) -> Result<SettingsProposal> {
        let proposal = self.request::<SettingsProposeEndpoint>("settings proposal", change)??;
        if proposal.change == *change {
            Ok(proposal)
        } else {
            Err(self.not_verified(
                "another change of settings was proposed than was asked for: propose it again"
                    .to_owned(),
            ))
        }
    }

    /// Applies a change that was proposed over this link, and reads it back.
    ///
    /// # Errors
    /// A proposal that has ended, a refusal, or other values read back.
    pub fn apply(&self, proposal: &SettingsProposal) -> Result<Settings> {
        self.request_flash::<SettingsApplyEndpoint>("settings change", &proposal.token)??;
        let settings = self.settings()?;
        let wrong = match &proposal.change {
            SettingsChange::Set(values) => values
                .iter()
                .find(|change| settings.get(change.setting) != change.value)
                .map(|change| change.setting),
            SettingsChange::Reset => settings
                .iter()
                .find(|change| change.value != change.setting.spec().default)
                .map(|change| change.setting),
        };
        match wrong {
            None => Ok(settings),
            Some(setting) => Err(self.not_verified(format!(
                "settings were changed, but {setting} reads back {}: change them again",
                settings.get(setting)
            ))),
        }
    }

    /// Changes a setting by both steps, and reads it back.
    ///
    /// # Errors
    /// A value that the device refuses, or another value read back.
    pub fn set(&self, change: SettingChange) -> Result<Settings> {
        self.set_all(&[change])
    }

    /// Changes settings by both steps, all or none, and reads them back.
    ///
    /// # Errors
    /// A value that the device refuses, or another value read back.
    pub fn set_all(&self, changes: &[SettingChange]) -> Result<Settings> {
        self.apply(&self.propose(&SettingsChange::of(changes)?)?)
    }

    /// Resets every setting to its default by both steps, and reads them back.
    ///
    /// # Errors
    /// A refusal, or other values read back.
    pub fn reset_settings(&self) -> Result<Settings> {
        self.apply(&self.propose(&SettingsChange::Reset)?)
    }
}
