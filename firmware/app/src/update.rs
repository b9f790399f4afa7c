//! Update of the image: what the device checks, and its record. The requests are in [`crate::update_requests`].
//!
//! An image is received as an upload into the slot that is not active, whose library is given up. Board, length,
//! version and signature are checked before anything is erased. The image itself is checked as it reads back. Then a
//! record of one flash word, [`record`](stylus_boot::record), asks the bootloader to exchange it with the running
//! image. The new image is on trial until the host confirms it, or until it has been healthy for [`TRIAL_MS`].

use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{
    BoardName, HEADER_BYTES, ImageHeader, ImageVersion, MAX_IMAGE_BYTES, ResetReason, SIGNATURE_BYTES, SIGNED_BYTES,
    SlotId, TRIAL_MS, UNSIGNED, UpdateBegin, UpdateError, UpdatePhase, UpdateReport,
};
use salty::{Keypair, PublicKey, Sha512, Signature};
use stylus_boot::record::{FLASH_FAILED, Store, mark};

/// Public key of [`model_format::link::DEVELOPMENT_SEED`].
pub const DEVELOPMENT_KEY: [u8; 32] = [
    60, 141, 25, 48, 18, 125, 197, 143, 241, 9, 30, 215, 2, 87, 122, 109, 17, 105, 72, 170, 118, 52, 139, 22, 54, 213,
    167, 39, 0, 190, 15, 173,
];

/// The running image, and what it trusts.
#[derive(Clone, Copy, Debug)]
pub struct Running {
    /// Board of the running image.
    pub board: BoardName,
    /// Version of the running image.
    pub image: ImageVersion,
    /// The bootloader's version.
    pub bootloader: ImageVersion,
    /// Ed25519 key that an update must be signed with.
    pub key: [u8; 32],
    /// True if an update need not be signed, because the button was held at power-on.
    pub takes_unsigned: bool,
}

impl Running {
    /// Checks an update by its header, and returns the header.
    pub(crate) fn check(&self, begin: &UpdateBegin) -> Result<ImageHeader, UpdateError> {
        let (signed, signature) = begin
            .signed
            .split_first_chunk::<HEADER_BYTES>()
            .ok_or(UpdateError::NotAnImage)?;
        let header = ImageHeader::read(signed).ok_or(UpdateError::NotAnImage)?;
        let signature: &[u8; SIGNATURE_BYTES] = signature.try_into().map_err(|_| UpdateError::NotAnImage)?;
        if header.board != self.board {
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

/// Header and signature of `image` for `board` by the key of `seed`, as the device checks them. The device itself does
/// not sign.
pub fn sign(board: BoardName, image: &[u8], version: ImageVersion, seed: &[u8; 32]) -> [u8; SIGNED_BYTES] {
    let header = ImageHeader {
        board,
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

/// Public key that belongs to the private key of `seed`.
pub fn public_key(seed: &[u8; 32]) -> [u8; 32] {
    Keypair::from(seed).public.to_bytes()
}

/// Updates of a device with a bootloader, with the record in `R`.
pub struct Updates<R> {
    pub(crate) store: Store<R>,
    pub(crate) running: Running,
    /// Header of the update that is being received.
    pub(crate) begun: Option<ImageHeader>,
    pub(crate) wants_restart: bool,
}

impl<R: NorFlash> Updates<R> {
    /// Updates of the image `running`.
    pub const fn new(store: Store<R>, running: Running) -> Self {
        Self {
            store,
            running,
            begun: None,
            wants_restart: false,
        }
    }

    /// Returns true while the slot of the update holds the previous image, or the new one before it is exchanged.
    pub(crate) fn is_pending(&self) -> bool {
        self.store.record().asks()
    }

    /// Returns true if the running image is the new one and is not yet confirmed. Before the exchange, an update is
    /// committed, but not on trial.
    pub(crate) fn is_on_trial(&self) -> bool {
        self.is_pending() && self.store.record().steps() > 0
    }

    fn slot(&self) -> SlotId {
        SlotId::ALL[usize::from(self.store.record().slot) % 2]
    }

    pub(crate) fn report(&self, now_us: u64) -> UpdateReport {
        let Running {
            image,
            bootloader,
            key,
            takes_unsigned,
            ..
        } = self.running;
        let record = self.store.record();
        let version = ImageVersion::new(record.version);
        let phase = match record.marks[0] {
            mark::SWAP if !self.is_on_trial() => UpdatePhase::Committed { version },
            mark::SWAP => UpdatePhase::Trial {
                slot: self.slot(),
                left_ms: TRIAL_MS.saturating_sub(now_us / 1000) as u32,
            },
            mark::REVERT | mark::ERASED if record.cause == FLASH_FAILED => UpdatePhase::GivenUp { version },
            // The marks are erased for a moment between the last step back and its mark.
            mark::REVERT | mark::ERASED => UpdatePhase::RolledBack {
                version,
                cause: cause(record.cause),
            },
            _ => UpdatePhase::Confirmed,
        };
        UpdateReport {
            image,
            bootloader: Some(bootloader),
            phase,
            trusts_development_key: key == DEVELOPMENT_KEY,
            takes_unsigned,
        }
    }
}

/// Cause of a reset, from bits 28:21 of `RCC_RSR` (RM0433 section 8.7.38).
///
/// The first of several flags counts, because every other reset sets the pin's flag too, and power-on also that of the
/// brown-out.
pub fn cause(flags: u8) -> ResetReason {
    let by_bit = [
        (2, ResetReason::PowerOn),
        (0, ResetReason::Brownout),
        (5, ResetReason::Watchdog),
        (3, ResetReason::Software),
        (1, ResetReason::Pin),
    ];
    let mut seen = by_bit.into_iter().filter(|(bit, _)| flags >> bit & 1 != 0);
    seen.next().map_or(ResetReason::Unknown, |(_, reason)| reason)
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
