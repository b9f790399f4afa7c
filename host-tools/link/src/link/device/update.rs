//! Requests of an update. [`crate::link::update`] combines them.

use model_format::link::{
    UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint, UpdateReport, UpdateStateEndpoint,
    UploadProgress,
};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Announces an image. The answer has the offset of the first byte that the device lacks.
    pub fn update_begin(&self, update: &UpdateBegin) -> Result<UploadProgress> {
        Ok(self.request_flash::<UpdateBeginEndpoint>("update begin", update)??)
    }

    /// Commits an update. The device restarts after its answer.
    pub fn update_commit(&self) -> Result<UpdateReport> {
        Ok(self.request_flash::<UpdateCommitEndpoint>("update commit", &())??)
    }

    /// Confirms the image that is on trial.
    pub fn update_confirm(&self) -> Result<UpdateReport> {
        Ok(self.request_flash::<UpdateConfirmEndpoint>("update confirmation", &())??)
    }

    /// Reads the versions and the state of the update; none from a device without a bootloader.
    pub fn update_state(&self) -> Result<Option<UpdateReport>> {
        self.request_flash::<UpdateStateEndpoint>("update state", &())
    }
}
