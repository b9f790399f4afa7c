//! Update of the device's image: a signed header, then the image as an upload into the slot that is not active.
//!
//! The file of an update consists of [`ImageHeader::to_bytes`], the Ed25519 signature of these bytes, and the image.
//! The image is sent in chunks by [`super::UploadChunkEndpoint`].

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{BoardName, LIBRARY_CRC, ResetReason, SlotId, UploadError};

/// First bytes of a header: name and version of the header's format.
const MAGIC: [u8; 8] = *b"STYLIMG\x01";

/// Size of the largest image, bytes: the three sectors of flash from which the image runs.
pub const MAX_IMAGE_BYTES: u32 = 384 * 1024;

/// Length of a header, bytes.
pub const HEADER_BYTES: usize = 100;

/// Length of an Ed25519 signature, bytes.
pub const SIGNATURE_BYTES: usize = 64;

/// Length of a header with its signature, bytes.
pub const SIGNED_BYTES: usize = HEADER_BYTES + SIGNATURE_BYTES;

/// Signature of an image that is not signed. The device accepts it only if the device's button was held at power-on.
pub const UNSIGNED: [u8; SIGNATURE_BYTES] = [0; SIGNATURE_BYTES];

/// Seed of the development key. It is public, so that a device whose image trusts this key accepts anybody's images.
pub const DEVELOPMENT_SEED: [u8; 32] = *b"stylus: development, not secret!";

/// Time for which a new image runs until the image confirms itself, ms.
pub const TRIAL_MS: u64 = 60_000;

/// Longest time that a device takes to exchange two images, ms: it erases and programs six sectors (DS12110, table 60).
pub const EXCHANGE_MS: u64 = 60_000;

/// Version of an image or a bootloader. Of two versions the later one is the greater.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
pub struct ImageVersion {
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// Number of the patch.
    pub patch: u16,
}

impl ImageVersion {
    /// The version of these numbers.
    pub const fn new([major, minor, patch]: [u16; 3]) -> Self {
        Self { major, minor, patch }
    }

    /// Reads `major.minor.patch`; none if `text` is not three numbers.
    pub fn read(text: &str) -> Option<Self> {
        let mut parts = text.split('.').map(|part| part.parse().ok());
        let numbers = [parts.next()??, parts.next()??, parts.next()??];
        parts.next().is_none().then(|| Self::new(numbers))
    }

    /// Major number, minor number, and number of the patch.
    pub const fn numbers(self) -> [u16; 3] {
        [self.major, self.minor, self.patch]
    }
}

impl core::fmt::Display for ImageVersion {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

/// Header of an image; the signature is over the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// Board that the image runs on.
    pub board: BoardName,
    /// Version of the image.
    pub version: ImageVersion,
    /// Length of the image, bytes.
    pub length: u32,
    /// SHA-512 of the image.
    pub digest: [u8; 64],
}

impl ImageHeader {
    /// The bytes that are signed.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..24].copy_from_slice(&self.board.0);
        let parts = bytes[24..30].as_chunks_mut::<2>().0.iter_mut();
        for (place, number) in parts.zip(self.version.numbers()) {
            *place = number.to_le_bytes();
        }
        // Two bytes after the version stay 0 and keep the length aligned.
        bytes[32..36].copy_from_slice(&self.length.to_le_bytes());
        bytes[36..].copy_from_slice(&self.digest);
        bytes
    }

    /// Reads the header at the start of `bytes`; none if there is no header.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (magic, rest) = bytes.split_first_chunk::<8>()?;
        let (board, rest) = rest.split_first_chunk::<16>()?;
        let (version, rest) = rest.split_first_chunk::<8>()?;
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let digest = *rest.first_chunk::<64>()?;
        let [a, b, c, d, e, f, _, _] = *version;
        (*magic == MAGIC).then_some(Self {
            board: BoardName(*board),
            version: ImageVersion::new([[a, b], [c, d], [e, f]].map(u16::from_le_bytes)),
            length: u32::from_le_bytes(*length),
            digest,
        })
    }
}

/// Request to receive an image. The device checks the request before it erases anything.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UpdateBegin {
    /// Header and signature, [`SIGNED_BYTES`].
    pub signed: Vec<u8, SIGNED_BYTES>,
    /// CRC-32 (ISO-HDLC) of the image. An interrupted transfer is resumed if its checksum is the same.
    pub crc32: u32,
    /// True if the image may be older than the running one.
    pub allow_downgrade: bool,
}

impl UpdateBegin {
    /// Creates the request for `image`. `signed` is its header and signature; bytes beyond [`SIGNED_BYTES`] are
    /// dropped.
    pub fn new(image: &[u8], signed: &[u8]) -> Self {
        Self {
            signed: signed.iter().copied().take(SIGNED_BYTES).collect(),
            crc32: LIBRARY_CRC.checksum(image),
            allow_downgrade: false,
        }
    }
}

/// Phase of the update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum UpdatePhase {
    /// The running image is confirmed.
    Confirmed,
    /// An image was committed, and the device is about to restart.
    Committed {
        /// Version of the committed image.
        version: ImageVersion,
    },
    /// The running image is new. Until it is confirmed, a reset puts the previous image back.
    Trial {
        /// Slot that keeps the previous image.
        slot: SlotId,
        /// Time until the running image confirms itself, ms.
        left_ms: u32,
    },
    /// The previous image was put back, because a reset came before the new image was confirmed.
    RolledBack {
        /// Version of the new image.
        version: ImageVersion,
        /// Cause of that reset.
        cause: ResetReason,
    },
    /// The previous image runs, because a sector of the flash could not be written when the new one was to replace it.
    GivenUp {
        /// Version of the new image.
        version: ImageVersion,
    },
}

/// The device's images, and the state of the update.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct UpdateReport {
    /// Version of the running image.
    pub image: ImageVersion,
    /// Version of the bootloader; none if there is none.
    pub bootloader: Option<ImageVersion>,
    /// Phase of the update.
    pub phase: UpdatePhase,
    /// True if the running image trusts the development key, and so accepts everybody's images.
    pub trusts_development_key: bool,
    /// True if the device accepts an image that is not signed, because the button was held at power-on.
    pub takes_unsigned: bool,
}

/// Reason for which an update does not continue. The running image stays.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum UpdateError {
    /// A device without a bootloader.
    #[error("the device has no bootloader: flash it once by the probe, `cargo flash`")]
    NoBootloader,
    /// An output that is not at rest.
    #[error("something is played, or settings or a library are being changed: stop it, then update")]
    Playing,
    /// Bytes that are no header.
    #[error("no header of an image: give a file that `cargo tasks image` wrote")]
    NotAnImage,
    /// An image of another board.
    #[error("the image is for another board: give one that was built for this board")]
    Board,
    /// An image that is empty or does not fit.
    #[error("an image of {length} bytes; it may have 1 to {MAX_IMAGE_BYTES}: give another one")]
    Length {
        /// Length of the image, bytes.
        length: u32,
    },
    /// A signature that is not by the key that the running image trusts.
    #[error(
        "the image is not signed by the key that the device trusts: sign it with that key, or hold the button while \
         power comes on, or flash it by the probe"
    )]
    Signature,
    /// A version older than the running one.
    #[error("the image is older, {offered}, than the running {running}: --allow-downgrade takes it")]
    Downgrade {
        /// Version of the running image.
        running: ImageVersion,
        /// Version of the offered image.
        offered: ImageVersion,
    },
    /// A new image that is not confirmed, or an image that waits for the restart.
    #[error("the running image is on trial: wait a minute, after which it confirms itself")]
    Unconfirmed,
    /// A confirmation of an image that is not on trial.
    #[error("the running image is not on trial: there is nothing to confirm")]
    NotOnTrial,
    /// A commit without a begin.
    #[error("no update is under way: begin one")]
    NotBegun,
    /// A failure of the transfer or the flash.
    #[error("{0}")]
    Upload(#[from] UploadError),
    /// An image in flash that is not the one that was signed.
    #[error("the image in flash is not the signed one: update again; if that fails too, get the file anew")]
    Digest,
    /// A record of the update that could not be kept in flash.
    #[error("the flash does not keep the record of the update: try again; if it stays, the flash is worn")]
    NotKept,
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_header_comes_back(version: [u16; 3], length: u32, board: [u8; 16], byte: u8) {
            let digest = [byte; 64];
            let version = ImageVersion::new(version);
            let header = ImageHeader { board: BoardName(board), version, length, digest };
            let bytes = header.to_bytes();
            prop_assert_eq!(ImageHeader::read(&bytes), Some(header));
            prop_assert_eq!(ImageHeader::read(&bytes[1..]), None);
            prop_assert_eq!(ImageVersion::read(&std::format!("{version}")), Some(version));
        }
    }
}
