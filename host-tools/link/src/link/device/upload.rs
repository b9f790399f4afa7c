//! Requests of an upload. [`crate::link::upload`] combines them.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::thread;

use model_format::link::{
    MAX_CHUNK_BYTES, UPLOAD_WINDOW, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk,
    UploadChunkEndpoint, UploadCommitEndpoint, UploadCommitted, UploadProgress, UploadProgressEndpoint, UploadState,
};

use postcard_rpc::standard_icd::WireError;

use super::connection::{BUSY_INTERVAL, Device};
use crate::link::error::{LinkError, Result};

/// A chunk on its way to the device: the wait for its answer, or the answer.
enum OnItsWay<'a> {
    Waiting(Pin<Box<dyn Future<Output = Result<UploadProgress>> + 'a>>),
    Answered(Result<UploadProgress>),
}

impl OnItsWay<'_> {
    /// Sends the chunk if it was not sent yet, and checks whether its answer has arrived.
    fn poll(&mut self, context: &mut Context<'_>) {
        if let Self::Waiting(answer) = self
            && let Poll::Ready(answer) = answer.as_mut().poll(context)
        {
            *self = Self::Answered(answer);
        }
    }
}

/// Waits for the answer to the first of `chunks`, and removes this chunk. Meanwhile all chunks are sent, in their
/// order.
async fn first_answer(chunks: &mut VecDeque<OnItsWay<'_>>) -> Option<Result<UploadProgress>> {
    poll_fn(|context| {
        chunks.iter_mut().for_each(|chunk| chunk.poll(context));
        match chunks.front() {
            Some(OnItsWay::Waiting(_)) => Poll::Pending,
            Some(OnItsWay::Answered(_)) | None => Poll::Ready(()),
        }
    })
    .await;
    match chunks.pop_front() {
        Some(OnItsWay::Answered(answer)) => Some(answer),
        Some(OnItsWay::Waiting(_)) | None => None,
    }
}

impl Device {
    /// Announces a library. The answer has the offset of the first byte that the device lacks.
    pub fn upload_begin(&self, upload: UploadBegin) -> Result<UploadProgress> {
        Ok(self.request_flash::<UploadBeginEndpoint>("upload begin", &upload)??)
    }

    /// Sends the chunks of `library` from byte `from` on. Up to [`UPLOAD_WINDOW`] chunks are sent before the first one
    /// is answered, so that chunks cross the link while the device programs an earlier one. Calls `progress` with the
    /// device's next offset after each answer.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer. Chunks may still be on their way then. The device processes them
    /// before it answers another request about the upload.
    pub fn upload_chunks(&self, library: &[u8], from: u32, mut progress: impl FnMut(u32)) -> Result<()> {
        let mut limit = self.limit(self.timeouts().flash);
        let mut at = from as usize;
        while at < library.len() {
            let sent = self.runtime().block_on(self.send_window(library, at, |next| {
                // Each answered chunk is progress, so the wait for a full queue begins anew.
                (at, limit) = (next as usize, self.limit(self.timeouts().flash));
                progress(next);
            }));
            match sent {
                // Jobs of another link may be in the device's queue.
                Err(LinkError::Frame {
                    error: WireError::FailedToSpawn,
                    ..
                }) if !limit.has_passed() => thread::sleep(BUSY_INTERVAL),
                sent => return sent,
            }
        }
        Ok(())
    }

    /// Sends chunks like [`Self::upload_chunks`], but only up to the first failure. By then all outstanding answers
    /// have arrived, unless the link has failed.
    async fn send_window(&self, library: &[u8], from: usize, mut progress: impl FnMut(u32)) -> Result<()> {
        let timeout = self.timeouts().flash;
        let mut rest = library[from..].chunks(MAX_CHUNK_BYTES);
        let mut next = from as u32;
        let mut chunks: VecDeque<OnItsWay<'_>> = VecDeque::new();
        loop {
            while chunks.len() < UPLOAD_WINDOW
                && let Some(data) = rest.next()
            {
                let offset = next;
                next += data.len() as u32;
                let answer = async move {
                    let chunk = UploadChunk { offset, data };
                    Ok((self.requester)
                        .request::<UploadChunkEndpoint<'_>>("upload chunk", timeout, &chunk)
                        .await??)
                };
                chunks.push_back(OnItsWay::Waiting(Box::pin(answer)));
            }
            match first_answer(&mut chunks).await {
                None => return Ok(()),
                Some(Ok(there)) => progress(there.next_offset),
                Some(Err(failure)) => {
                    // After a refused chunk the device refuses the chunks that follow. Their answers are awaited here,
                    // so that none of them takes a place in the device's queue when the next chunks are sent.
                    if matches!(failure, LinkError::Frame { .. } | LinkError::Upload(_)) {
                        while first_answer(&mut chunks).await.is_some() {}
                    }
                    return Err(failure);
                }
            }
        }
    }

    /// Sends a chunk.
    pub fn upload_chunk(&self, chunk: &UploadChunk<'_>) -> Result<UploadProgress> {
        Ok(self.request_flash::<UploadChunkEndpoint<'_>>("upload chunk", chunk)??)
    }

    /// Commits an upload, which makes the library valid.
    pub fn upload_commit(&self) -> Result<UploadCommitted> {
        Ok(self.request_flash::<UploadCommitEndpoint>("upload commit", &())??)
    }

    /// Aborts an upload.
    pub fn upload_abort(&self) -> Result<UploadState> {
        Ok(self.request_flash::<UploadAbortEndpoint>("upload abort", &())??)
    }

    /// Reads the progress of an upload.
    pub fn upload_progress(&self) -> Result<UploadState> {
        self.request_flash::<UploadProgressEndpoint>("upload progress", &())
    }
}
