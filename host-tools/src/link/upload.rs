//! A library on its way to the device: in chunks, resumed where a link broke, and read back.

use model_format::Library;
use model_format::link::{
    CHUNK_ALIGN, LIBRARY_CRC, MAX_CHUNK_BYTES, SlotId, SlotInfo, SlotState, UploadBegin,
    UploadChunk, UploadError,
};

use super::Device;
use super::error::{LinkError, Result};

/// How often in a row an upload may fail without getting further.
const TRIES: u32 = 5;

const _: () = assert!(MAX_CHUNK_BYTES.is_multiple_of(CHUNK_ALIGN));

/// A library that is in the device, and was read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Uploaded {
    /// Where it is.
    pub slot: SlotId,
    /// What the device says of it.
    pub library: SlotInfo,
    /// Names of its textures, as the device lists them.
    pub textures: Vec<String>,
    /// Bytes that an earlier upload had brought.
    pub resumed_from: u32,
    /// How often the upload was taken up again after a failure.
    pub retries: u32,
}

/// Uploads `library` and reads it back; `progress` hears how many bytes the device has.
///
/// An upload of the same bytes that was broken off is resumed, whoever began it. The library that is active goes on.
///
/// # Errors
/// A refusal of the device; a link that broke and did not come back, or failed five times in a row without getting further;
/// a device that then lists something else.
pub fn upload(
    device: &mut Device,
    library: &[u8],
    mut progress: impl FnMut(usize),
) -> Result<Uploaded> {
    let begin = UploadBegin {
        length: u32::try_from(library.len()).unwrap_or(u32::MAX),
        crc32: LIBRARY_CRC.checksum(library),
    };
    let mut run = Run {
        library,
        begin,
        resumed_from: None,
        next_offset: 0,
        committing: false,
    };
    let (mut furthest, mut failures, mut retries) = (0, 0, 0);
    let (slot, info, textures) = loop {
        let outcome = run
            .go_on(device, &mut progress)
            .and_then(|(slot, info)| Ok((slot, info, read_back(device, slot, &info, library)?)));
        let failure = match outcome {
            Ok(done) => break done,
            Err(failure) if is_passing(&failure) => failure,
            Err(failure) => return Err(failure),
        };
        if run.next_offset > furthest {
            (furthest, failures) = (run.next_offset, 0);
        }
        failures += 1;
        retries += 1;
        if failures >= TRIES {
            return Err(failure);
        }
        if !matches!(failure, LinkError::Upload(_)) {
            device.reconnect()?;
        }
    };
    Ok(Uploaded {
        slot,
        library: info,
        textures,
        resumed_from: run.resumed_from.unwrap_or(0),
        retries,
    })
}

/// Whether to go on from where the device is.
fn is_passing(failure: &LinkError) -> bool {
    let out_of_step = match failure {
        LinkError::Upload(refusal) => matches!(
            **refusal,
            UploadError::Offset { .. } | UploadError::Incomplete { .. } | UploadError::NotBegun
        ),
        _ => false,
    };
    failure.is_passing() || out_of_step
}

/// One upload, over any number of links.
struct Run<'a> {
    library: &'a [u8],
    begin: UploadBegin,
    resumed_from: Option<u32>,
    /// Where the device was when it last said so.
    next_offset: u32,
    /// A commit was sent, and whether it was heard is not known.
    committing: bool,
}

impl Run<'_> {
    fn go_on(
        &mut self,
        device: &Device,
        progress: &mut impl FnMut(usize),
    ) -> Result<(SlotId, SlotInfo)> {
        // To begin again what is committed would erase it.
        if self.committing
            && let Some(done) = self.committed(device)?
        {
            return Ok(done);
        }
        self.committing = false;
        let mut at = device.upload_begin(self.begin)?.next_offset;
        self.resumed_from.get_or_insert(at);
        self.next_offset = at;
        progress(at as usize);
        while let Some(rest) = self.library.get(at as usize..)
            && !rest.is_empty()
        {
            let chunk = UploadChunk {
                offset: at,
                data: &rest[..rest.len().min(MAX_CHUNK_BYTES)],
            };
            at = device.upload_chunk(&chunk)?.next_offset;
            self.next_offset = at;
            progress(at as usize);
        }
        self.committing = true;
        let committed = device.upload_commit()?;
        let slots = device.slots()?;
        match &slots.slots[committed.slot.index()] {
            SlotState::Valid(info) if self.is_ours(info) && info.sequence == committed.sequence => {
                Ok((committed.slot, *info))
            }
            other => Err(device.not_verified(format!(
                "the upload ended in slot {}, which now reads back as {other:?}: upload again",
                committed.slot
            ))),
        }
    }

    /// The newest library, if it is the one that is being uploaded.
    fn committed(&self, device: &Device) -> Result<Option<(SlotId, SlotInfo)>> {
        let slots = device.slots()?.slots;
        let valid = SlotId::ALL
            .into_iter()
            .zip(slots)
            .filter_map(|(id, state)| match state {
                SlotState::Valid(info) => Some((id, info)),
                _ => None,
            });
        let newest = valid.max_by_key(|(_, info)| info.sequence);
        Ok(newest.filter(|(_, info)| self.is_ours(info)))
    }

    fn is_ours(&self, info: &SlotInfo) -> bool {
        (info.length, info.crc32) == (self.begin.length, self.begin.crc32)
    }
}

/// Lists the slot and compares it with what was sent.
fn read_back(
    device: &Device,
    slot: SlotId,
    info: &SlotInfo,
    library: &[u8],
) -> Result<Vec<String>> {
    let listed = device.textures(slot)?;
    let names: Vec<String> = listed
        .iter()
        .map(|texture| texture.name.to_string())
        .collect();
    // What only the device can read is as the device says.
    let expected: Vec<String> = match Library::decode(library) {
        Ok(library) => library.textures().map(|t| t.name().to_owned()).collect(),
        Err(_) => names.clone(),
    };
    if names == expected && names.len() == usize::from(info.textures) {
        Ok(names)
    } else {
        Err(device.not_verified(format!(
            "slot {slot} lists {} where {} was sent: upload again",
            names.join(", "),
            expected.join(", ")
        )))
    }
}
