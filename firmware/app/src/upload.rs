//! Receiving a library: begin, chunks in turn, commit.
//!
//! Each call does at most one erase of a sector: `begin` that of the header, a chunk that of the sector it reaches first.
//! A call that fails in the flash, or is dropped half way, ends the upload, since a word cannot be written twice; a call that
//! was refused leaves it as it was. What is being received never touches the active slot.

use model_format::limits::MAX_LIBRARY_BYTES;
use model_format::link::{
    CHUNK_ALIGN, MAX_CHUNK_BYTES, SlotFault, SlotId, UploadBegin, UploadChunk, UploadCommitted,
    UploadError, UploadProgress, UploadState,
};

use crate::flash::WORD_BYTES;
use crate::slots::{MappedFlash, SealFault, SlotStore, WriteFault};

const _: () =
    assert!(CHUNK_ALIGN.is_multiple_of(WORD_BYTES) && MAX_CHUNK_BYTES.is_multiple_of(CHUNK_ALIGN));

/// An upload under way, or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uploader {
    upload: Option<Upload>,
}

/// What has been received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Upload {
    begin: UploadBegin,
    slot: SlotId,
    next_offset: u32,
}

impl Upload {
    fn progress(self) -> UploadProgress {
        UploadProgress {
            upload: self.begin,
            slot: self.slot,
            next_offset: self.next_offset,
        }
    }
}

impl Uploader {
    /// None under way.
    pub const fn new() -> Self {
        Self { upload: None }
    }

    /// How far it has come.
    pub fn state(&self) -> UploadState {
        self.upload.map_or(UploadState::Idle, |upload| {
            UploadState::Receiving(upload.progress())
        })
    }

    /// Begins an upload, or goes on with the one of the same length and checksum; another one is given up.
    ///
    /// # Errors
    /// A length that no library has; a fault of the flash.
    pub async fn begin<F: MappedFlash>(
        &mut self,
        store: &mut SlotStore<F>,
        begin: UploadBegin,
    ) -> Result<UploadProgress, UploadError> {
        if begin.length == 0 || begin.length as usize > MAX_LIBRARY_BYTES {
            return Err(UploadError::Length {
                length: begin.length,
            });
        }
        let slot = store.spare();
        if let Some(upload) = self.upload
            && upload.begin == begin
            && upload.slot == slot
        {
            return Ok(upload.progress());
        }
        self.abort(store);
        store.set_unfinished(slot);
        store
            .erase_sector(slot, SlotStore::<F>::header_sector())
            .await
            .map_err(UploadFault::from)?;
        store.set_receiving(slot);
        let upload = Upload {
            begin,
            slot,
            next_offset: 0,
        };
        self.upload = Some(upload);
        Ok(upload.progress())
    }

    /// Takes the next bytes.
    ///
    /// # Errors
    /// None under way; a chunk out of turn, of a wrong length or past the end; a fault of the flash, which ends the upload.
    pub async fn chunk<F: MappedFlash>(
        &mut self,
        store: &mut SlotStore<F>,
        chunk: UploadChunk<'_>,
    ) -> Result<UploadProgress, UploadError> {
        let upload = self.upload.ok_or(UploadError::NotBegun)?;
        let next_offset = check_chunk(upload, chunk)?;
        // Until the words are written the upload is not there, so that one that is dropped half way is over.
        self.end(store);
        write_chunk(store, upload, chunk)
            .await
            .map_err(UploadFault::from)?;
        store.set_receiving(upload.slot);
        let upload = Upload {
            next_offset,
            ..upload
        };
        self.upload = Some(upload);
        Ok(upload.progress())
    }

    /// Validates what was received and makes it a library of its slot. It does not become the active one by that.
    ///
    /// # Errors
    /// None under way, or not complete; anything else ends the upload: bytes that are not those announced or no library, a
    /// fault of the flash.
    pub async fn commit<F: MappedFlash>(
        &mut self,
        store: &mut SlotStore<F>,
    ) -> Result<UploadCommitted, UploadError> {
        let Upload {
            begin,
            slot,
            next_offset,
        } = self.upload.ok_or(UploadError::NotBegun)?;
        let UploadBegin { length, crc32 } = begin;
        if next_offset != length {
            return Err(UploadError::Incomplete {
                next_offset,
                length,
            });
        }
        self.end(store);
        let sealed = store.seal(slot, length, crc32).await;
        let library = sealed.map_err(|fault| match fault {
            SealFault::Bytes(fault) => bytes_error(slot, fault),
            SealFault::Write(fault) => UploadFault::from(fault).0,
        })?;
        Ok(UploadCommitted {
            slot,
            sequence: library.sequence,
            textures: library.textures,
        })
    }

    /// Gives the upload up, if one is under way.
    pub fn abort<F: MappedFlash>(&mut self, store: &mut SlotStore<F>) {
        if self.upload.is_some() {
            self.end(store);
        }
    }

    fn end<F: MappedFlash>(&mut self, store: &mut SlotStore<F>) {
        if let Some(upload) = self.upload.take() {
            store.set_unfinished(upload.slot);
        }
    }
}

/// Where the chunk after `chunk` begins, if `chunk` is the next of `upload`.
fn check_chunk(upload: Upload, chunk: UploadChunk<'_>) -> Result<u32, UploadError> {
    let (expected, total) = (upload.next_offset, upload.begin.length);
    if chunk.offset != expected {
        return Err(UploadError::Offset {
            expected,
            found: chunk.offset,
        });
    }
    let length = chunk.data.len();
    if length == 0 || length > MAX_CHUNK_BYTES {
        return Err(UploadError::ChunkLength {
            length: length as u32,
        });
    }
    let end = expected + length as u32;
    if end > total {
        return Err(UploadError::PastEnd { end, length: total });
    }
    if end < total && !length.is_multiple_of(CHUNK_ALIGN) {
        return Err(UploadError::ChunkLength {
            length: length as u32,
        });
    }
    Ok(end)
}

/// Writes `chunk`, after erasing the sector that it begins or reaches into.
async fn write_chunk<F: MappedFlash>(
    store: &mut SlotStore<F>,
    upload: Upload,
    chunk: UploadChunk<'_>,
) -> Result<(), WriteFault> {
    let sector = SlotStore::<F>::sector_bytes();
    let end = chunk.offset + chunk.data.len() as u32;
    let border = chunk.offset.next_multiple_of(sector);
    // The header's sector was erased at the beginning. Sectors are longer than chunks, so one border at most is reached.
    if border < end && border != SlotStore::<F>::header_sector() {
        store.erase_sector(upload.slot, border).await?;
    }
    store.write(upload.slot, chunk.offset, chunk.data).await
}

/// A fault of the flash as it is told to the host.
struct UploadFault(UploadError);

impl From<WriteFault> for UploadFault {
    fn from(fault: WriteFault) -> Self {
        Self(match fault {
            WriteFault::Flash(fault) => UploadError::Flash {
                slot: fault.slot,
                operation: fault.operation,
                offset: fault.offset,
            },
            WriteFault::ReadBack { slot, offset } => UploadError::ReadBack { slot, offset },
        })
    }
}

impl From<UploadFault> for UploadError {
    fn from(fault: UploadFault) -> Self {
        fault.0
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
        // Faults of a header alone: a commit writes one, and reads back the word that it wrote.
        SlotFault::Unfinished | SlotFault::HeaderVersion { .. } | SlotFault::Length { .. } => {
            UploadError::ReadBack {
                slot,
                offset: MAX_LIBRARY_BYTES as u32,
            }
        }
    }
}
