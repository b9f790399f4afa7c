//! Requests of an update, which need slots, uploads and the record together.

use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{SlotId, TRIAL_MS, UpdateBegin, UpdateError, UpdateReport, UploadBegin, UploadProgress};
use salty::Sha512;
use stylus_boot::record::{Record, mark};

use crate::control::Control;
use crate::slots::{MappedFlash, SlotStore};
use crate::storage::{Stage, Storage, supplied};
use crate::update::Updates;

impl<F: MappedFlash, S: NorFlash> Storage<F, S> {
    /// Allows `updates`: the device has a bootloader.
    pub fn set_updates(&mut self, updates: Updates<S>) {
        self.updates = Some(updates);
    }

    /// Returns true while no slot may be erased, because of an update: its images are in use, or its record cannot be
    /// renewed.
    pub(crate) async fn keeps_image(&mut self) -> bool {
        let Some(updates) = self.updates.as_mut() else {
            return false;
        };
        updates.is_pending() || updates.store.renew().await.is_err()
    }

    /// Returns true once the device is to restart, after its answer has been sent.
    pub fn wants_restart(&self) -> bool {
        let updates = self.updates.as_ref();
        updates.is_some_and(|updates| updates.wants_restart)
    }

    /// Serves `UpdateStateEndpoint`.
    pub fn update_state(&self, stage: &impl Stage) -> Option<UpdateReport> {
        let updates = self.updates.as_ref()?;
        Some(updates.report(stage.now_us()))
    }

    /// Serves `UpdateBeginEndpoint`. The image's chunks are sent as those of an upload.
    ///
    /// # Errors
    /// The supply is too low, there is no bootloader, the device refuses the image, something is played, an earlier
    /// update is not confirmed, or the flash fails.
    pub async fn update_begin(
        &mut self,
        stage: &mut impl Stage,
        begin: &UpdateBegin,
    ) -> Result<UploadProgress, UpdateError> {
        supplied(stage)?;
        let updates = self.updates.as_ref().ok_or(UpdateError::NoBootloader)?;
        let header = updates.running.check(begin)?;
        at_rest(stage)?;
        // This check comes last, because it may write the record again.
        let is_kept = self.keeps_image().await;
        let updates = self.updates.as_mut().ok_or(UpdateError::NoBootloader)?;
        if is_kept {
            stage.with_control(Control::end_self_test);
            return Err(UpdateError::Unconfirmed);
        }
        updates.begun = Some(header);
        self.slots.scan_once().await;
        let upload = UploadBegin {
            length: header.length,
            crc32: begin.crc32,
            replaces_last: true,
        };
        let begun = self.uploader.begin(&mut self.slots, upload).await;
        stage.with_control(|control| {
            control.end_self_test();
            control.set_upload(self.uploader.state());
        });
        Ok(begun?)
    }

    /// Serves `UpdateCommitEndpoint`: checks the image in flash, asks the bootloader to exchange it, and asks for a
    /// restart.
    ///
    /// # Errors
    /// The supply is too low, no update was begun, chunks are missing, the image is not the signed one, something is
    /// played, or the flash fails. The running image stays.
    pub async fn update_commit(&mut self, stage: &mut impl Stage) -> Result<UpdateReport, UpdateError> {
        supplied(stage)?;
        let updates = self.updates.as_mut().ok_or(UpdateError::NoBootloader)?;
        let header = updates.begun.ok_or(UpdateError::NotBegun)?;
        let UploadProgress { upload, slot, .. } = self.uploader.received()?;
        let length = upload.length;
        at_rest(stage)?;
        // An image is no library, so the upload ends here and is never committed as one.
        self.uploader.abort(&mut self.slots);
        let is_signed = length == header.length && digest(&mut self.slots, slot, length).await == Some(header.digest);
        let asked = if is_signed {
            let version = header.version.numbers();
            let record = Record::marked(mark::SWAP, slot.index() as u8, version);
            let kept = updates.store.replace(record).await;
            kept.map_err(|_| UpdateError::NotKept)
        } else {
            Err(UpdateError::Digest)
        };
        updates.begun = None;
        stage.with_control(|control| control.set_upload(self.uploader.state()));
        if let Err(error) = asked {
            stage.with_control(Control::end_self_test);
            return Err(error);
        }
        // Until the restart nothing can be played.
        updates.wants_restart = true;
        Ok(updates.report(stage.now_us()))
    }

    /// Serves `UpdateConfirmEndpoint`: from now on a reset does not restore the previous image.
    ///
    /// # Errors
    /// The supply is too low, no image is on trial, something is played, or the flash fails.
    pub async fn update_confirm(&mut self, stage: &mut impl Stage) -> Result<UpdateReport, UpdateError> {
        supplied(stage)?;
        let updates = self.updates.as_mut().ok_or(UpdateError::NoBootloader)?;
        if !updates.is_on_trial() {
            return Err(UpdateError::NotOnTrial);
        }
        at_rest(stage)?;
        let Record { slot, version, .. } = updates.store.record();
        let confirmed = Record::marked(mark::BOOT, slot, version);
        let kept = updates.store.replace(confirmed).await;
        stage.with_control(Control::end_self_test);
        kept.map_err(|_| UpdateError::NotKept)?;
        Ok(updates.report(stage.now_us()))
    }

    /// Confirms the image at the end of its trial if it is healthy, or else asks for a restart, which restores the
    /// previous image. Before that end, or while something is played, it does nothing.
    pub async fn end_trial(&mut self, stage: &mut impl Stage) {
        let now_ms = stage.now_us() / 1000;
        let Some(updates) = self.updates.as_mut().filter(|updates| updates.is_on_trial()) else {
            return;
        };
        if now_ms < TRIAL_MS {
            return;
        }
        if stage.with_control(|control| control.is_healthy()) {
            // If the record cannot be written now, the next call tries again.
            let _ = self.update_confirm(stage).await;
        } else if at_rest(stage).is_ok() {
            updates.wants_restart = true;
        }
    }
}

/// Prevents playing until `Control::end_self_test`.
fn at_rest(stage: &impl Stage) -> Result<(), UpdateError> {
    let begun = stage.with_control(Control::begin_self_test);
    begun.map_err(|_| UpdateError::Playing)
}

/// SHA-512 of the first `length` bytes of `slot`; none if a word cannot be read.
async fn digest<F: MappedFlash>(slots: &mut SlotStore<F>, slot: SlotId, length: u32) -> Option<[u8; 64]> {
    let mut digest = Sha512::new();
    let take = |bytes: &[u8]| digest.update(bytes);
    slots.read_bytes(slot, length, 1, take).await.ok()?;
    Some(digest.finalize())
}
