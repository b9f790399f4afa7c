//! Upload of a library: in chunks, resumed after a broken link, and read back. And update of a device's image: it is
//! sent like an upload, exchanged by the bootloader, checked, and confirmed.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use model_format::Library;
use model_format::link::{
    CHUNK_ALIGN, EXCHANGE_MS, ImageHeader, LIBRARY_CRC, MAX_CHUNK_BYTES, SIGNED_BYTES, SlotId, SlotInfo, SlotState,
    UpdateBegin, UpdateError, UpdatePhase, UpdateReport, UploadBegin, UploadError,
};
use serde::Serialize;
use stylus_support::Error;
use stylus_support::bounded_file::Format;

use super::Device;
use super::error::{LinkError, Result};

/// Number of successive failures without progress after which an upload ends.
const MAX_FAILURES: u32 = 5;

const _: () = assert!(MAX_CHUNK_BYTES.is_multiple_of(CHUNK_ALIGN));

/// A library in the device, after it was read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Uploaded {
    /// The slot that holds it.
    pub slot: SlotId,
    /// The device's description of it.
    pub library: SlotInfo,
    /// Names of its textures, in the device's order.
    pub textures: Vec<String>,
    /// Number of bytes that the device had from an earlier upload.
    pub resumed_from: u32,
    /// Number of times that the upload was resumed after a failure.
    pub retries: u32,
}

/// Uploads `library`, the bytes of a library file, and reads it back. Calls `progress` with the number of bytes in the
/// device.
///
/// Resumes an interrupted upload of the same bytes, even if another program began it. The active library stays active
/// and continues to play. The last readable library is never erased for an upload.
///
/// # Errors
/// A refusal of the device, a lost link that does not come back, five failures in a row without progress, or a device
/// that then lists other textures.
pub fn upload(device: &mut Device, library: &[u8], progress: impl FnMut(usize)) -> Result<Uploaded> {
    upload_over(device, library, false, progress)
}

/// Uploads like [`upload`]. If `replaces_last`, the upload may erase the last readable library. A device that restarts
/// before the upload is complete then has none.
pub fn upload_over(
    device: &mut Device,
    library: &[u8],
    replaces_last: bool,
    mut progress: impl FnMut(usize),
) -> Result<Uploaded> {
    let begin = UploadBegin {
        // A length beyond 32 bits is none that a slot has, so the device refuses it.
        length: u32::try_from(library.len()).unwrap_or(u32::MAX),
        crc32: LIBRARY_CRC.checksum(library),
        replaces_last,
    };
    let mut run = Run {
        library,
        begin,
        resumed_from: None,
        next_offset: 0,
        committing: false,
    };
    let ((slot, info, textures), retries) = retried(device, |device| {
        let outcome = run
            .go_on(device, &mut progress)
            .and_then(|(slot, info)| Ok((slot, info, read_back(device, slot, &info, library)?)));
        (outcome, run.next_offset)
    })?;
    Ok(Uploaded {
        slot,
        library: info,
        textures,
        resumed_from: run.resumed_from.unwrap_or(0),
        retries,
    })
}

/// Repeats `attempt`, which also returns the device's next offset, as long as its failures may pass, and ends after
/// [`MAX_FAILURES`] failures in a row without progress. Returns the result, and the number of repetitions.
pub(super) fn retried<T>(
    device: &mut Device,
    mut attempt: impl FnMut(&Device) -> (Result<T>, u32),
) -> Result<(T, u32)> {
    let (mut furthest, mut failures, mut retries) = (0, 0, 0);
    loop {
        let (outcome, next_offset) = attempt(device);
        let failure = match outcome {
            Ok(done) => return Ok((done, retries)),
            Err(failure) if is_passing(&failure) => failure,
            Err(failure) => return Err(failure),
        };
        // Only successive failures without progress count, so that a poor link may fail any number of times.
        if next_offset > furthest {
            (furthest, failures) = (next_offset, 0);
        }
        failures += 1;
        retries += 1;
        if failures >= MAX_FAILURES {
            return Err(failure);
        }
        // A refusal has come over the link, so the link is whole.
        if !matches!(failure, LinkError::Upload(_)) {
            device.reconnect()?;
        }
    }
}

/// Returns true for a failure after which the upload can continue from the device's offset.
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

/// State of one upload, over any number of links.
struct Run<'a> {
    library: &'a [u8],
    begin: UploadBegin,
    resumed_from: Option<u32>,
    /// The device's offset in its last answer.
    next_offset: u32,
    /// True if a commit was sent and its answer has not arrived.
    committing: bool,
}

impl Run<'_> {
    fn go_on(&mut self, device: &Device, progress: &mut impl FnMut(usize)) -> Result<(SlotId, SlotInfo)> {
        // A second upload of a committed library would erase the slot.
        if self.committing
            && let Some(done) = self.committed(device)?
        {
            return Ok(done);
        }
        self.committing = false;
        let at = device.upload_begin(self.begin)?.next_offset;
        self.resumed_from.get_or_insert(at);
        self.next_offset = at;
        progress(at as usize);
        device.upload_chunks(self.library, at, |next| {
            self.next_offset = next;
            progress(next as usize);
        })?;
        self.committing = true;
        let committed = device.upload_commit()?;
        let slots = device.slots()?;
        match &slots.slots[committed.slot.index()] {
            SlotState::Valid(info) if self.is_ours(info) && info.sequence == committed.sequence => {
                Ok((committed.slot, *info))
            }
            other => Err(device.not_verified(format!(
                "the upload was committed to slot {}, which now reads back as {other:?}: upload again",
                committed.slot
            ))),
        }
    }

    /// Returns the newest library in the device if it is the one that this upload sends.
    fn committed(&self, device: &Device) -> Result<Option<(SlotId, SlotInfo)>> {
        Ok(device.newest()?.filter(|(_, info)| self.is_ours(info)))
    }

    fn is_ours(&self, info: &SlotInfo) -> bool {
        (info.length, info.crc32) == (self.begin.length, self.begin.crc32)
    }
}

/// Lists the slot's textures and compares them with those of the library that was sent.
fn read_back(device: &Device, slot: SlotId, info: &SlotInfo, library: &[u8]) -> Result<Vec<String>> {
    let listed = device.textures(slot)?;
    let names: Vec<String> = listed.iter().map(|texture| texture.name.to_string()).collect();
    // A library that only the device can decode has no other list to compare with.
    let expected: Vec<String> = match Library::decode(library) {
        Ok(library) => library.textures().map(|t| t.name().to_owned()).collect(),
        Err(_) => names.clone(),
    };
    if names == expected && names.len() == usize::from(info.textures) {
        Ok(names)
    } else {
        Err(device.not_verified(format!(
            "slot {slot} lists {} instead of {}: upload again",
            names.join(", "),
            expected.join(", ")
        )))
    }
}

/// Interval between checks of a device that restarts.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);

/// A file of an update.
#[derive(Clone, Debug)]
pub struct UpdateFile {
    /// The header.
    pub header: ImageHeader,
    bytes: Vec<u8>,
}

impl UpdateFile {
    /// Reads the file at `path`. The device checks its signature.
    pub fn read(path: &Path) -> stylus_support::Result<Self> {
        let bytes = Format::Update.read(path)?;
        let header = ImageHeader::read(&bytes);
        let header = header
            .filter(|header| bytes.len() == SIGNED_BYTES + header.length as usize)
            .ok_or_else(|| {
                let problem = "is not an update: give a file that `cargo tasks image` wrote";
                Error::file(path, problem.to_owned())
            })?;
        Ok(Self { header, bytes })
    }

    fn image(&self) -> &[u8] {
        &self.bytes[SIGNED_BYTES..]
    }
}

/// An update that was done.
#[derive(Clone, Debug, Serialize)]
pub struct Updated {
    /// The device's report before the update.
    pub before: UpdateReport,
    /// The device's report after the update.
    pub after: UpdateReport,
    /// Length of the image, bytes.
    pub bytes: u32,
    /// Time to send the image, s.
    pub sent_s: f64,
    /// Time from the commit until the new image answered, s.
    pub exchanged_s: f64,
    /// Number of times that the transfer was resumed after a failure.
    pub retries: u32,
}

/// Progress of an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// This many bytes of the image are in the device.
    Sent(usize),
    /// The device exchanges the images.
    Exchanging,
}

/// Updates the device, waits for the new image, checks its status, and confirms it. The library in the slot that is not
/// active is lost.
///
/// # Errors
/// A refusal of the device, a lost link that does not come back, or a new image that did not start or is not healthy.
/// In the last case the previous image is restored, at the device's next reset at the latest.
pub fn update(
    device: &mut Device,
    file: &UpdateFile,
    allow_downgrade: bool,
    mut step: impl FnMut(Step),
) -> Result<Updated> {
    let before = device.update_state()?.ok_or(UpdateError::NoBootloader)?;
    let (offered, board) = (file.header.board, device.status()?.start.board);
    if offered != board {
        return Err(LinkError::OtherBoard { offered, board });
    }
    let image = file.image();
    let begin = UpdateBegin {
        allow_downgrade,
        ..UpdateBegin::new(image, &file.bytes[..SIGNED_BYTES])
    };
    let start = Instant::now();
    let mut next_offset = 0;
    let ((), retries) = retried(device, |device| {
        let outcome = send(device, image, &begin, |next| {
            next_offset = next;
            step(Step::Sent(next as usize));
        });
        (outcome, next_offset)
    })?;
    let sent_s = start.elapsed().as_secs_f64();
    // A device that restarts may close the link before its answer has arrived.
    let committed = match device.update_commit() {
        Err(failure) if !failure.is_passing() => return Err(failure),
        outcome => outcome,
    };
    step(Step::Exchanging);
    let start = Instant::now();
    let trial = wait_for_exchange(device)?;
    let exchanged_s = start.elapsed().as_secs_f64();
    check_exchanged(device, &trial, &file.header)?;
    let after = if matches!(trial.phase, UpdatePhase::Trial { .. }) {
        check_health(device)?;
        device.update_confirm()?
    } else {
        // Without a trial, only the answer to the commit distinguishes a new image from an old one of the same version.
        committed?;
        trial
    };
    Ok(Updated {
        before,
        after,
        bytes: file.header.length,
        sent_s,
        exchanged_s,
        retries,
    })
}

/// Checks by `trial`, the device's report after the restart, that an image with the version in the header `wanted`
/// runs.
fn check_exchanged(device: &Device, trial: &UpdateReport, wanted: &ImageHeader) -> Result<()> {
    if let UpdatePhase::RolledBack { version, cause } = trial.phase {
        return Err(device.not_verified(format!(
            "the new image, {version}, did not last and the one before is back; the reset was by: {cause}; \
             `stylus status` shows a fault"
        )));
    }
    if let UpdatePhase::GivenUp { version } = trial.phase {
        return Err(device.not_verified(format!(
            "a sector of flash could not be written for the new image, {version}, and the one before runs: update \
             again; if it stays, the sector is write-protected or worn"
        )));
    }
    let (runs, wanted) = (trial.image, wanted.version);
    if runs != wanted {
        return Err(device.not_verified(format!(
            "{runs} runs, and not the new image, {wanted}, which did not start or was put back: update again; \
             `stylus status` shows a fault"
        )));
    }
    Ok(())
}

fn send(device: &Device, image: &[u8], begin: &UpdateBegin, mut progress: impl FnMut(u32)) -> Result<()> {
    let at = device.update_begin(begin)?.next_offset;
    progress(at);
    device.upload_chunks(image, at, progress)
}

/// Waits until the device has restarted and its update is no longer in the phase `Committed`.
fn wait_for_exchange(device: &mut Device) -> Result<UpdateReport> {
    let longest = Duration::from_millis(EXCHANGE_MS);
    let mut limit = device.limit(longest);
    loop {
        thread::sleep(LOOK_INTERVAL);
        let report = device.reconnect().and_then(|()| device.update_state());
        match report {
            Ok(Some(report)) if !matches!(report.phase, UpdatePhase::Committed { .. }) => {
                return Ok(report);
            }
            // Another protocol stays another one, however long the wait.
            Err(failure @ LinkError::Version { .. }) => return Err(failure),
            Err(failure) if limit.has_passed() => return Err(failure),
            Ok(_) if limit.has_passed() => {
                let what = "the device does not restart: switch its power off and on".to_owned();
                return Err(device.not_verified(what));
            }
            _ => {}
        }
    }
}

/// Checks by the status that the new image is healthy: no safe mode, no missed tick and no hung stage.
fn check_health(device: &Device) -> Result<()> {
    let status = device.status()?;
    if status.start.safe_mode || status.tick.missed > 0 || status.start.hung_stage.is_some() {
        return Err(device.not_verified(
            "the new image is not healthy, so it is not confirmed: reset the device, which puts the one before back; \
             `stylus status` shows why"
                .to_owned(),
        ));
    }
    Ok(())
}
