//! Update of a device's image. It is sent like an upload, exchanged by the bootloader, checked, and confirmed.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{EXCHANGE_MS, ImageHeader, SIGNED_BYTES, UpdateBegin, UpdateError, UpdatePhase, UpdateReport};
use serde::Serialize;
use stylus_support::Error;
use stylus_support::bounded_file::Format;

use super::Device;
use super::error::{LinkError, Result};
use super::upload::retried;

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
