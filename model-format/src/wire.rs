//! The records of a library as they are stored. The package's `README.md` has the layout with offsets.
//!
//! Multi-byte numbers in byte strings are little-endian and not aligned. The CRC covers every byte before and after
//! itself, the version and the length included.

use serde::{Deserialize, Serialize};

/// The format's version. It changes when an older reader could misread newer bytes.
pub const FORMAT_VERSION: u16 = 4;

/// First bytes of every library.
pub(crate) const MAGIC: [u8; 4] = *b"HTXL";

/// Length of [`Prefix`], bytes.
#[cfg(feature = "alloc")]
pub(crate) const PREFIX_BYTES: usize = 16;

/// Bytes of [`Prefix::crc32`].
pub(crate) const CRC_RANGE: core::ops::Range<usize> = 12..16;

pub(crate) const CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC, that of zlib) of a library without the field that holds it.
///
/// `bytes` must be at least as long as a [`Prefix`].
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(&bytes[..CRC_RANGE.start]);
    digest.update(&bytes[CRC_RANGE.end..]);
    digest.finalize()
}

/// The part that every version shares, at the same place and of the same size.
#[derive(Serialize, Deserialize)]
pub(crate) struct Prefix {
    pub magic: [u8; 4],
    #[serde(with = "postcard::fixint::le")]
    pub version: u16,
    #[serde(with = "postcard::fixint::le")]
    pub reserved: u16,
    #[serde(with = "postcard::fixint::le")]
    pub total_bytes: u32,
    #[serde(with = "postcard::fixint::le")]
    pub crc32: u32,
}

/// Filter structure of a texture, and with it the format of its coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Structure {
    /// Normalised (four-multiplier) all-pole lattice: θ = arcsin k of each stage in 16 bits.
    NormalisedLattice,
    /// Direct form, the paper's own: predictor coefficients h in 16 bits, with one exponent per node.
    DirectForm16,
    /// Direct form: predictor coefficients h in 32 bits, with one exponent per node.
    DirectForm32,
}

impl Structure {
    /// Width of one stored coefficient, bytes.
    pub const fn coefficient_bytes(self) -> usize {
        match self {
            Self::NormalisedLattice | Self::DirectForm16 => 2,
            Self::DirectForm32 => 4,
        }
    }
}

impl core::fmt::Display for Structure {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NormalisedLattice => "normalised lattice",
            Self::DirectForm16 => "direct form, 16 bits",
            Self::DirectForm32 => "direct form, 32 bits",
        })
    }
}

/// Origin of the recordings behind a texture. It stays with the texture in every library, listing and report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Provenance {
    /// Recorded from a real tool on a real surface.
    Recorded,
    /// Computed by the rig simulator.
    Simulated,
}

impl core::fmt::Display for Provenance {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Recorded => "recorded",
            Self::Simulated => "SIMULATED",
        })
    }
}

/// A texture as postcard encodes it. Its optional parts follow.
#[derive(Serialize, Deserialize)]
pub(crate) struct TextureRecord<'a> {
    pub name: &'a str,
    pub sample_rate_hz: u32,
    pub structure: Structure,
    pub provenance: Provenance,
    pub speed_axis: &'a [u8],
    pub force_axis: &'a [u8],
    pub nodes: &'a [u8],
    pub coefficients: &'a [u8],
    #[serde(borrow)]
    pub certificate: CertificateRecord<'a>,
}

/// A texture's certificate as it is stored; [`crate::Certificate`] has its meaning.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) enum CertificateRecord<'a> {
    /// No certificate.
    None,
    /// Largest |θ| of all nodes, in steps of [`crate::FINE_THETA_STEP_RAD`].
    Lattice { largest_theta: u32 },
    /// One byte per cell, speed-major, and the CRC-32 of axes, nodes, coefficients and these bytes, in this order.
    DirectForm {
        #[serde(with = "postcard::fixint::le")]
        crc32: u32,
        cell_margins: &'a [u8],
    },
}

/// CRC-32 of byte strings in turn. It binds a certificate to the numbers that it was issued for.
pub(crate) fn checksum_of_strings(strings: [&[u8]; 5]) -> u32 {
    let mut digest = CRC32.digest();
    for string in strings {
        digest.update(string);
    }
    digest.finalize()
}

/// A node of the grid in its form of fixed width, so that any node is found without reading those before it.
#[derive(Clone, Copy)]
pub(crate) struct NodeRecord {
    pub order: u16,
    pub flags: u8,
    pub exponent: u8,
    pub output_power: f32,
    pub prediction_error_power: f32,
    /// Byte of the coefficient string at which the node's coefficients begin.
    pub offset: u32,
}

impl NodeRecord {
    pub const BYTES: usize = 16;

    pub fn read(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        Self {
            order: u16::from_le_bytes([bytes[0], bytes[1]]),
            flags: bytes[2],
            exponent: bytes[3],
            output_power: f32::from_le_bytes(word(4)),
            prediction_error_power: f32::from_le_bytes(word(8)),
            offset: u32::from_le_bytes(word(12)),
        }
    }

    #[cfg(feature = "alloc")]
    pub fn bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[0..2].copy_from_slice(&self.order.to_le_bytes());
        bytes[2] = self.flags;
        bytes[3] = self.exponent;
        bytes[4..8].copy_from_slice(&self.output_power.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.prediction_error_power.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.offset.to_le_bytes());
        bytes
    }
}
