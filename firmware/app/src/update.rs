//! Update of the image: what the device checks, and its record.
//!
//! An image is received as an upload into the slot that is not active, whose library is given up. Board, length,
//! version and signature are checked before anything is erased, and the image itself as it reads back. Then one word of
//! flash, the [record](stylus_boot::record), asks the bootloader to exchange it with the running one. The new image is
//! on trial until the host confirms it, or until it has been healthy for [`TRIAL_MS`].

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{
    BOARD, HEADER_BYTES, ImageHeader, ImageVersion, MAX_IMAGE_BYTES, ResetReason, SIGNATURE_BYTES,
    SIGNED_BYTES, SlotId, TRIAL_MS, UNSIGNED, UpdateBegin, UpdateError, UpdatePhase, UpdateReport,
    UploadBegin, UploadProgress,
};
use salty::{Keypair, PublicKey, Sha512, Signature};
use stylus_boot::record::{Record, Store, mark};

use crate::control::Control;
use crate::flash::WORD_BYTES;
use crate::slots::{MappedFlash, SlotStore};
use crate::storage::{Stage, Storage, supplied};

/// Public key of [`model_format::link::DEVELOPMENT_SEED`].
pub const DEVELOPMENT_KEY: [u8; 32] = [
    60, 141, 25, 48, 18, 125, 197, 143, 241, 9, 30, 215, 2, 87, 122, 109, 17, 105, 72, 170, 118,
    52, 139, 22, 54, 213, 167, 39, 0, 190, 15, 173,
];

/// Bytes of an image that are hashed between two turns of other tasks.
const STRIDE_BYTES: u32 = 4096;

/// The running image, and what it trusts.
#[derive(Clone, Copy, Debug)]
pub struct Running {
    /// Its version.
    pub image: ImageVersion,
    /// The bootloader's version; none if there is none.
    pub bootloader: Option<ImageVersion>,
    /// Ed25519 key that an update must be signed with.
    pub key: [u8; 32],
    /// True if an update need not be signed, because the button was held at power-on.
    pub takes_unsigned: bool,
}

impl Running {
    /// Checks an update by its header, and returns that.
    fn check(&self, begin: &UpdateBegin) -> Result<ImageHeader, UpdateError> {
        let (signed, signature) = begin
            .signed
            .split_first_chunk::<HEADER_BYTES>()
            .ok_or(UpdateError::NotAnImage)?;
        let header = ImageHeader::read(signed).ok_or(UpdateError::NotAnImage)?;
        let signature: &[u8; SIGNATURE_BYTES] =
            signature.try_into().map_err(|_| UpdateError::NotAnImage)?;
        if header.board != BOARD {
            return Err(UpdateError::Board);
        }
        let length = header.length;
        if !(1..=MAX_IMAGE_BYTES).contains(&length) {
            return Err(UpdateError::Length { length });
        }
        let is_unsigned = self.takes_unsigned && *signature == UNSIGNED;
        if !is_unsigned && !self.has_signed(signed, signature) {
            return Err(UpdateError::Signature);
        }
        let (running, offered) = (self.image, header.version);
        if offered < running && !begin.allow_downgrade {
            return Err(UpdateError::Downgrade { running, offered });
        }
        Ok(header)
    }

    fn has_signed(&self, message: &[u8], signature: &[u8; SIGNATURE_BYTES]) -> bool {
        let key = PublicKey::try_from(&self.key);
        key.is_ok_and(|key| key.verify(message, &Signature::from(signature)).is_ok())
    }
}

/// Header and signature of `image` by the key of `seed`, as the device checks them. Of no use to the device.
pub fn sign(image: &[u8], version: ImageVersion, seed: &[u8; 32]) -> [u8; SIGNED_BYTES] {
    let header = ImageHeader {
        board: BOARD,
        version,
        length: image.len() as u32,
        digest: Sha512::new().updated(image).finalize(),
    };
    let header = header.to_bytes();
    let mut signed = [0; SIGNED_BYTES];
    signed[..HEADER_BYTES].copy_from_slice(&header);
    signed[HEADER_BYTES..].copy_from_slice(&Keypair::from(seed).sign(&header).to_bytes());
    signed
}

/// Public key of the key of `seed`.
pub fn public_key(seed: &[u8; 32]) -> [u8; 32] {
    Keypair::from(seed).public.to_bytes()
}

/// Updates of a device with a bootloader, with the record in `R`.
pub struct Updates<R> {
    store: Store<R>,
    running: Running,
    /// Header of the update that is received.
    begun: Option<ImageHeader>,
    /// True once this run has committed an update.
    is_committed: bool,
    wants_restart: bool,
}

impl<R: NorFlash> Updates<R> {
    /// Updates of the image `running`.
    pub const fn new(store: Store<R>, running: Running) -> Self {
        Self {
            store,
            running,
            begun: None,
            is_committed: false,
            wants_restart: false,
        }
    }

    /// Gives the record's flash back.
    pub fn into_flash(self) -> R {
        self.store.into_flash()
    }

    /// Returns true while the slot of the update holds the image before, or the one that is to come.
    fn is_pending(&self) -> bool {
        self.store.record().marks[0] == mark::SWAP
    }

    fn is_on_trial(&self) -> bool {
        self.is_pending() && !self.is_committed
    }

    fn slot(&self) -> SlotId {
        SlotId::ALL[usize::from(self.store.record().slot) % 2]
    }

    fn report(&self, now_us: u64) -> UpdateReport {
        let Running {
            image,
            bootloader,
            key,
            takes_unsigned,
        } = self.running;
        let record = self.store.record();
        let version = ImageVersion::new(record.version);
        let phase = match record.marks[0] {
            _ if self.is_committed => UpdatePhase::Committed { version },
            mark::SWAP => UpdatePhase::Trial {
                slot: self.slot(),
                left_ms: TRIAL_MS.saturating_sub(now_us / 1000) as u32,
            },
            // Between the last step back and its mark the marks are erased.
            mark::REVERT | mark::ERASED => UpdatePhase::RolledBack {
                version,
                cause: cause(record.cause),
            },
            _ => UpdatePhase::Confirmed,
        };
        UpdateReport {
            image,
            bootloader,
            phase,
            trusts_development_key: key == DEVELOPMENT_KEY,
            takes_unsigned,
        }
    }
}

/// Cause of a reset by the byte that the bootloader kept, the most telling one first.
fn cause(flags: u8) -> ResetReason {
    let by_bit = [
        (2, ResetReason::PowerOn),
        (0, ResetReason::Brownout),
        (5, ResetReason::Watchdog),
        (3, ResetReason::Software),
        (1, ResetReason::Pin),
    ];
    let mut seen = by_bit.into_iter().filter(|(bit, _)| flags >> bit & 1 != 0);
    seen.next()
        .map_or(ResetReason::Unknown, |(_, reason)| reason)
}

impl<F: MappedFlash, S: NorFlash> Storage<F, S> {
    /// Allows `updates`: the device has a bootloader.
    pub fn set_updates(&mut self, updates: Updates<S>) {
        self.updates = Some(updates);
    }

    /// Returns true while no slot may be erased, because of an update.
    pub(crate) async fn keeps_image(&mut self) -> bool {
        let Some(updates) = self.updates.as_mut() else {
            return false;
        };
        updates.is_pending() || updates.store.settle().await.is_err()
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

    /// Serves `UpdateBeginEndpoint`. The chunks are those of an upload.
    ///
    /// # Errors
    /// The image is not one that this device takes, something is played, or the flash cannot be erased.
    pub async fn update_begin(
        &mut self,
        stage: &mut impl Stage,
        begin: &UpdateBegin,
    ) -> Result<UploadProgress, UpdateError> {
        supplied(stage)?;
        let is_kept = self.keeps_image().await;
        let updates = self.updates.as_mut().ok_or(UpdateError::NoBootloader)?;
        if is_kept {
            return Err(UpdateError::Unconfirmed);
        }
        let header = updates.running.check(begin)?;
        updates.begun = Some(header);
        at_rest(stage)?;
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

    /// Serves `UpdateCommitEndpoint`: checks the image in flash, asks the bootloader for it, and for a restart.
    ///
    /// # Errors
    /// No update was begun, chunks are missing, the image is not the signed one, something is played, or the flash
    /// fails. The running image stays.
    pub async fn update_commit(
        &mut self,
        stage: &mut impl Stage,
    ) -> Result<UpdateReport, UpdateError> {
        supplied(stage)?;
        let updates = self.updates.as_mut().ok_or(UpdateError::NoBootloader)?;
        let header = updates.begun.ok_or(UpdateError::NotBegun)?;
        let (slot, length) = self.uploader.received()?;
        at_rest(stage)?;
        self.uploader.abort(&mut self.slots);
        let is_signed = length == header.length
            && digest(&mut self.slots, slot, length).await == Some(header.digest);
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
        (updates.is_committed, updates.wants_restart) = (true, true);
        Ok(updates.report(stage.now_us()))
    }

    /// Serves `UpdateConfirmEndpoint`: from now on a reset does not put the image before back.
    ///
    /// # Errors
    /// No image is on trial, something is played, or the flash fails.
    pub async fn update_confirm(
        &mut self,
        stage: &mut impl Stage,
    ) -> Result<UpdateReport, UpdateError> {
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

    /// At the end of a trial: confirms the image if it is healthy, else asks for a restart, which puts the one before
    /// back. While something is played it does nothing.
    pub async fn end_trial(&mut self, stage: &mut impl Stage) {
        let now_ms = stage.now_us() / 1000;
        let Some(updates) = self
            .updates
            .as_mut()
            .filter(|updates| updates.is_on_trial())
        else {
            return;
        };
        if now_ms < TRIAL_MS {
            return;
        }
        if stage.with_control(|control| control.is_healthy()) {
            // What cannot be kept now is tried again.
            let _ = self.update_confirm(stage).await;
        } else if at_rest(stage).is_ok() {
            updates.wants_restart = true;
        }
    }
}

/// Keeps everything from being played until `Control::end_self_test`.
fn at_rest(stage: &impl Stage) -> Result<(), UpdateError> {
    let begun = stage.with_control(Control::begin_self_test);
    begun.map_err(|_| UpdateError::Playing)
}

/// SHA-512 of the first `length` bytes of `slot`; none if one cannot be read.
async fn digest<F: MappedFlash>(
    slots: &mut SlotStore<F>,
    slot: SlotId,
    length: u32,
) -> Option<[u8; 64]> {
    let mut digest = Sha512::new();
    for offset in (0..length).step_by(WORD_BYTES) {
        let word = slots.word(slot, offset).await?;
        let left = (length - offset) as usize;
        digest.update(&word[..left.min(WORD_BYTES)]);
        if offset.is_multiple_of(STRIDE_BYTES) {
            yield_now().await;
        }
    }
    Some(digest.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::link::DEVELOPMENT_SEED;

    #[test]
    fn the_development_key_is_that_of_its_seed() {
        assert_eq!(DEVELOPMENT_KEY, public_key(&DEVELOPMENT_SEED));
    }
}
