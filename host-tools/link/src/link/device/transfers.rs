//! Requests that carry something into the device: a library, an image, the waveform of a probe, and the response that
//! probes measure. [`crate::link::upload`] and [`crate::procedures::response`] combine them.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::thread;

use model_format::link::{
    MAX_CHUNK_BYTES, ProbeLoad, ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint, ProbeStarted, Response,
    ResponseChange, ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, ResponseState, UPLOAD_WINDOW,
    UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint, UpdateReport, UpdateStateEndpoint,
    UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint, UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint,
    UploadCommitted, UploadProgress, UploadProgressEndpoint, UploadState, waveform_crc32,
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

impl Device {
    /// Loads one period of a probe's waveform. Returns its checksum, for [`ProbeStart::crc32`].
    pub fn load_probe(&self, period: &[i16]) -> Result<u32> {
        for load in ProbeLoad::parts(period) {
            self.request::<ProbeLoadEndpoint>("probe load", &load)??;
        }
        Ok(waveform_crc32(period.iter().copied()))
    }

    /// Plays the waveform that was loaded. While it plays, the host sends [`Device::keep_alive`] every
    /// [`model_format::link::KEEP_ALIVE_MS`].
    pub fn start_probe(&self, start: &ProbeStart) -> Result<ProbeStarted> {
        Ok(self.request::<ProbeStartEndpoint>("probe", start)??)
    }

    /// Reads which response is stored, and which is proposed.
    pub fn response(&self) -> Result<ResponseState> {
        self.request::<ResponseGetEndpoint>("response", &())
    }

    /// Proposes a response, through which a probe may then be played. Stored data does not change. Returns the
    /// response's hash.
    pub fn propose_response(&self, response: &Response) -> Result<u32> {
        let id = self.request::<ResponseProposeEndpoint>("response proposal", response)??;
        if id == response.id() {
            Ok(id)
        } else {
            Err(self.not_verified("the device took another response than this one: propose it again".to_owned()))
        }
    }

    /// Stores the response that was proposed over this link, or removes the stored one, and checks this by reading the
    /// state back.
    pub fn set_response(&self, change: ResponseChange) -> Result<ResponseState> {
        self.request_flash::<ResponseSetEndpoint>("response change", &change)??;
        let state = self.response()?;
        let wanted = match change {
            ResponseChange::Store { id } => Some(id),
            ResponseChange::Clear { .. } => None,
        };
        if state.stored.as_ref().map(|stored| stored.id) == wanted {
            Ok(state)
        } else {
            Err(self.not_verified("the response was changed, but another one reads back: change it again".to_owned()))
        }
    }
}
