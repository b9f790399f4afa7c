//! Requests of an upload, one by one; [`crate::link::upload`] makes an upload of them.

use model_format::link::{
    UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint,
    UploadCommitEndpoint, UploadCommitted, UploadProgress, UploadProgressEndpoint, UploadState,
};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Announces a library. The answer has the offset of the first byte that the device lacks.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn upload_begin(&self, upload: UploadBegin) -> Result<UploadProgress> {
        Ok(self.request_flash::<UploadBeginEndpoint>("upload begin", &upload)??)
    }

    /// Sends a chunk.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn upload_chunk(&self, chunk: &UploadChunk<'_>) -> Result<UploadProgress> {
        Ok(self.request_flash::<UploadChunkEndpoint<'_>>("upload chunk", chunk)??)
    }

    /// Commits an upload, which makes the library valid.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn upload_commit(&self) -> Result<UploadCommitted> {
        Ok(self.request_flash::<UploadCommitEndpoint>("upload commit", &())??)
    }

    /// Aborts an upload.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn upload_abort(&self) -> Result<UploadState> {
        Ok(self.request_flash::<UploadAbortEndpoint>("upload abort", &())??)
    }

    /// Reads the progress of an upload.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn upload_progress(&self) -> Result<UploadState> {
        self.request_flash::<UploadProgressEndpoint>("upload progress", &())
    }
}
