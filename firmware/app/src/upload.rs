//! Upload of a library: begin, chunks in order, commit.
//!
//! Each call erases at most one sector: `begin` erases the header's, and a chunk erases the sector that it is the first
//! to reach. A call that fails in the flash, or is dropped half way, ends the upload, because a word cannot be written
//! twice. A call that is refused leaves the upload as it was. An upload never touches the active slot, and it replaces
//! the last library that can be read only if it asks for that.

use model_format::limits::MAX_LIBRARY_BYTES;
use model_format::link::{
    CHUNK_ALIGN, MAX_CHUNK_BYTES, SlotFault, SlotId, UploadBegin, UploadChunk, UploadCommitted, UploadError,
    UploadProgress, UploadState,
};

use crate::flash::WORD_BYTES;
use crate::slots::{Claim, LastLibrary, MappedFlash, SealFault, SlotStore, WriteFault};

const _: () = assert!(CHUNK_ALIGN.is_multiple_of(WORD_BYTES) && MAX_CHUNK_BYTES.is_multiple_of(CHUNK_ALIGN));

/// The upload under way, if any.
#[derive(Debug, Default)]
pub struct Uploader {
    upload: Option<Upload>,
}

/// Progress of an upload.
#[derive(Debug)]
struct Upload {
    begin: UploadBegin,
    claim: Claim,
    next_offset: u32,
}

impl Upload {
    fn progress(&self) -> UploadProgress {
        UploadProgress {
            upload: self.begin,
            slot: self.claim.slot(),
            next_offset: self.next_offset,
        }
    }
}

impl Uploader {
    /// An uploader with no upload under way.
    pub const fn new() -> Self {
        Self { upload: None }
    }

    /// Progress of the upload, for the status.
    pub fn state(&self) -> UploadState {
        self.upload
            .as_ref()
            .map_or(UploadState::Idle, |upload| UploadState::Receiving(upload.progress()))
    }

    /// Begins an upload, or continues an upload of the same length and checksum. Any other upload under way ends.
    ///
    /// # Errors
    /// No library has this length; the slot holds the last library that can be read, and `begin` does not ask to
    /// replace it; the flash fails.
    pub async fn begin<F: MappedFlash>(
        &mut self,
        store: &mut SlotStore<F>,
        begin: UploadBegin,
    ) -> Result<UploadProgress, UploadError> {
        if begin.length == 0 || begin.length as usize > MAX_LIBRARY_BYTES {
            return Err(UploadError::Length { length: begin.length });
        }
        if let Some(upload) = &self.upload
            && (upload.begin.length, upload.begin.crc32) == (begin.length, begin.crc32)
        {
            return Ok(upload.progress());
        }
        // The claim comes before the end of another upload, which goes on if the claim is refused.
        let claim = store.claim_spare(begin.replaces_last).await;
        let claim = claim.map_err(|LastLibrary { slot }| UploadError::LastLibrary { slot })?;
        self.abort(store);
        store.erase_sector(&claim, SlotStore::<F>::header_sector()).await?;
        store.set_receiving(claim.slot());
        let upload = Upload {
            begin,
            claim,
            next_offset: 0,
        };
        Ok(self.upload.insert(upload).progress())
    }

    /// Writes the next chunk.
    ///
    /// # Errors
    /// No upload is under way; the chunk is out of order, of a wrong length or past the end; the flash fails, which
    /// ends the upload.
    pub async fn chunk<F: MappedFlash>(
        &mut self,
        store: &mut SlotStore<F>,
        chunk: UploadChunk<'_>,
    ) -> Result<UploadProgress, UploadError> {
        let upload = self.upload.as_ref().ok_or(UploadError::NotBegun)?;
        let next_offset = check_chunk(upload, chunk)?;
        // The upload ends here and is restored once the words are written, so that a call dropped half way ends it.
        let upload = self.end(store)?;
        write_chunk(store, &upload, chunk).await?;
        store.set_receiving(upload.claim.slot());
        let upload = Upload { next_offset, ..upload };
        Ok(self.upload.insert(upload).progress())
    }

    /// Validates the received bytes and makes them the library of their slot, which does not become the active one.
    ///
    /// # Errors
    /// No upload is under way, or it is not complete. Any other error ends the upload: the bytes are not those
    /// announced, or not a library, or the flash fails.
    pub async fn commit<F: MappedFlash>(&mut self, store: &mut SlotStore<F>) -> Result<UploadCommitted, UploadError> {
        let UploadProgress { upload, slot, .. } = self.received()?;
        let Upload { claim, .. } = self.end(store)?;
        let sealed = store.seal(claim, upload.length, upload.crc32).await;
        let library = sealed.map_err(|fault| match fault {
            SealFault::Bytes(fault) => bytes_error(slot, fault),
            SealFault::Write(fault) => fault.into(),
        })?;
        Ok(UploadCommitted {
            slot,
            sequence: library.sequence,
            textures: library.textures,
        })
    }

    /// Progress of the upload under way, of which all bytes have arrived.
    ///
    /// # Errors
    /// No upload is under way, or it is not complete.
    pub(crate) fn received(&self) -> Result<UploadProgress, UploadError> {
        let upload = self.upload.as_ref().ok_or(UploadError::NotBegun)?;
        let (next_offset, length) = (upload.next_offset, upload.begin.length);
        if next_offset == length {
            return Ok(upload.progress());
        }
        Err(UploadError::Incomplete { next_offset, length })
    }

    /// Ends the upload under way, if any.
    pub fn abort<F: MappedFlash>(&mut self, store: &mut SlotStore<F>) {
        let _ = self.end(store);
    }

    /// Ends the upload under way, and returns it with its claim.
    fn end<F: MappedFlash>(&mut self, store: &mut SlotStore<F>) -> Result<Upload, UploadError> {
        let upload = self.upload.take().ok_or(UploadError::NotBegun)?;
        store.set_unfinished(upload.claim.slot());
        Ok(upload)
    }
}

/// Checks that `chunk` is the next of `upload`, and returns the offset of the chunk after it.
fn check_chunk(upload: &Upload, chunk: UploadChunk<'_>) -> Result<u32, UploadError> {
    let (expected, total) = (upload.next_offset, upload.begin.length);
    if chunk.offset != expected {
        return Err(UploadError::Offset {
            expected,
            found: chunk.offset,
        });
    }
    let length = chunk.data.len();
    if length == 0 || length > MAX_CHUNK_BYTES {
        return Err(UploadError::ChunkLength { length: length as u32 });
    }
    let end = expected + length as u32;
    if end > total {
        return Err(UploadError::PastEnd { end, length: total });
    }
    if end < total && !length.is_multiple_of(CHUNK_ALIGN) {
        return Err(UploadError::ChunkLength { length: length as u32 });
    }
    Ok(end)
}

/// Writes `chunk`, after erasing the sector that it is the first to reach.
async fn write_chunk<F: MappedFlash>(
    store: &mut SlotStore<F>,
    upload: &Upload,
    chunk: UploadChunk<'_>,
) -> Result<(), WriteFault> {
    let sector = SlotStore::<F>::sector_bytes();
    let end = chunk.offset + chunk.data.len() as u32;
    let border = chunk.offset.next_multiple_of(sector);
    // `begin` erased the header's sector. Sectors are longer than chunks, so a chunk reaches at most one border.
    if border < end && border != SlotStore::<F>::header_sector() {
        store.erase_sector(&upload.claim, border).await?;
    }
    store.write(&upload.claim, chunk.offset, chunk.data).await
}

impl From<WriteFault> for UploadError {
    fn from(fault: WriteFault) -> Self {
        match fault {
            WriteFault::Flash(fault) => Self::Flash {
                slot: fault.slot,
                operation: fault.operation,
                offset: fault.offset,
            },
            WriteFault::ReadBack { slot, offset } => Self::ReadBack { slot, offset },
        }
    }
}

fn bytes_error(slot: SlotId, fault: SlotFault) -> UploadError {
    match fault {
        SlotFault::Checksum { expected, found } => UploadError::Checksum { expected, found },
        SlotFault::Invalid { reason } => UploadError::Invalid { reason },
        SlotFault::Unreadable { offset } => UploadError::Flash {
            slot,
            operation: model_format::link::FlashOperation::Read,
            offset,
        },
        // Only the scan of a slot finds these. A commit reads back the header's word as it writes it.
        SlotFault::Unfinished | SlotFault::HeaderVersion { .. } | SlotFault::Length { .. } => UploadError::ReadBack {
            slot,
            offset: MAX_LIBRARY_BYTES as u32,
        },
    }
}
