//! Requests about the device's settings.

use model_format::link::{
    SettingChange, Settings, SettingsGetEndpoint, SettingsResetEndpoint, SettingsSetEndpoint,
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

    /// Changes a setting, and reads it back.
    ///
    /// # Errors
    /// A value that the device refuses, or another value read back.
    pub fn set(&self, change: SettingChange) -> Result<Settings> {
        self.request_flash::<SettingsSetEndpoint>("settings change", &change)??;
        let settings = self.settings()?;
        let found = settings.get(change.setting);
        if found == change.value {
            Ok(settings)
        } else {
            Err(self.not_verified(format!(
                "{} was set to {} and reads back {found}: set it again",
                change.setting, change.value
            )))
        }
    }

    /// Resets every setting to its default, and reads them back.
    ///
    /// # Errors
    /// A refusal, or other values read back.
    pub fn reset_settings(&self) -> Result<Settings> {
        self.request_flash::<SettingsResetEndpoint>("settings reset", &())??;
        let settings = self.settings()?;
        if settings == Settings::default() {
            Ok(settings)
        } else {
            Err(self.not_verified(
                "settings were reset, but other values than the defaults were read back: reset them again"
                    .to_owned(),
            ))
        }
    }
}
