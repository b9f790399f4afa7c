//! The records of a library as they are stored. The package's `README.md` has the layout with offsets.
//!
//! Multi-byte numbers in byte strings are little-endian and not aligned. The CRC covers every byte before and after
//! itself, the version and the length included.

use serde::{Deserialize, Serialize};

use crate::limits;

/// The format's version. It changes when an older reader could misread newer bytes.
pub const FORMAT_VERSION: u16 = 5;

/// First bytes of every library.
pub(crate) const MAGIC: [u8; 4] = *b"HTXL";

/// Length of [`Prefix`], bytes.
pub(crate) const PREFIX_BYTES: usize = 16;

/// Bytes of [`Prefix::reserved`].
pub(crate) const RESERVED: core::ops::Range<usize> = 6..8;

/// Bytes of [`Prefix::crc32`].
pub(crate) const CRC_RANGE: core::ops::Range<usize> = 12..16;

/// CRC-32 (ISO-HDLC) of a whole library, as its prefix has it, an upload announces it and a slot keeps it.
pub static CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC, that of zlib) of a library without the field that holds it.
///
/// `bytes` must be at least as long as a [`Prefix`].
#[cfg(feature = "alloc")]
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(&bytes[..CRC_RANGE.start]);
    digest.update(&bytes[CRC_RANGE.end..]);
    digest.finalize()
}

/// A reader of postcard's encodings, which refuses a varint of more bytes than it needs, so that a library has one form
/// of bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    #[inline]
    pub fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(byte)
    }

    /// A varint of 32 bits.
    pub fn varint(&mut self) -> Option<u32> {
        let mut value = u32::from(self.byte()?);
        if value < 0x80 {
            return Some(value);
        }
        value &= 0x7f;
        for shift in [7, 14, 21, 28] {
            let byte = u32::from(self.byte()?);
            value |= (byte & 0x7f) << shift;
            if byte < 0x80 {
                let whole = byte > 0 && (shift < 28 || byte < 0x10);
                return whole.then_some(value);
            }
        }
        None
    }

    /// A string: its length as a varint, then its bytes.
    pub fn string(&mut self) -> Option<&'a [u8]> {
        let length = self.varint()? as usize;
        let (string, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(string)
    }

    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (&array, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(array)
    }

    pub fn f32(&mut self) -> Option<f32> {
        self.array().map(f32::from_le_bytes)
    }

    /// The byte before an `Option`'s value: 0 for none, 1 for one.
    pub fn is_some(&mut self) -> Option<bool> {
        match self.byte()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

impl<'a> TextureRecord<'a> {
    /// The record that `reader` is at.
    pub fn read(reader: &mut Reader<'a>) -> Option<Self> {
        Some(Self {
            name: core::str::from_utf8(reader.string()?).ok()?,
            sample_rate_hz: reader.varint()?,
            structure: match reader.varint()? {
                0 => Structure::NormalisedLattice,
                1 => Structure::DirectForm16,
                2 => Structure::DirectForm32,
                _ => return None,
            },
            provenance: match reader.varint()? {
                0 => Provenance::Recorded,
                1 => Provenance::Simulated,
                _ => return None,
            },
            speed_axis: reader.string()?,
            force_axis: reader.string()?,
            nodes: reader.string()?,
            coefficients: reader.string()?,
            certificate: match reader.varint()? {
                0 => CertificateRecord::None,
                1 => CertificateRecord::Lattice {
                    largest_theta: reader.varint()?,
                },
                2 => CertificateRecord::DirectForm {
                    crc32: reader.array().map(u32::from_le_bytes)?,
                    cell_margins: reader.string()?,
                },
                _ => return None,
            },
            summary: Summary {
                highest_order: u16::try_from(reader.varint()?).ok()?,
                highest_output_power: reader.f32()?,
                common_exponent: reader.byte()?,
            },
        })
    }
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

/// A texture as postcard encodes it. Its optional parts follow, and a string holds both.
#[derive(Serialize)]
pub(crate) struct TextureRecord<'a> {
    pub name: &'a str,
    pub sample_rate_hz: u32,
    pub structure: Structure,
    pub provenance: Provenance,
    pub speed_axis: &'a [u8],
    pub force_axis: &'a [u8],
    pub nodes: &'a [u8],
    pub coefficients: &'a [u8],
    pub certificate: CertificateRecord<'a>,
    pub summary: Summary,
}

/// Facts of all nodes of a texture, stored so that no player has to read the nodes for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// Highest order.
    pub highest_order: u16,
    /// Highest output power, (m/s²)².
    pub highest_output_power: f32,
    /// Exponent at which every mean of the nodes has room, see [`Summary::exponent_of`]; 0 for a lattice.
    pub common_exponent: u8,
}

impl Summary {
    /// The summary with a node of these facts added.
    #[inline]
    pub fn with_node(self, order: u16, output_power: f32, exponent: u8) -> Self {
        Self {
            highest_order: self.highest_order.max(order),
            // Powers are not negative, so that they are ordered as their bits are.
            highest_output_power: f32::from_bits(
                self.highest_output_power
                    .to_bits()
                    .max(output_power.to_bits()),
            ),
            common_exponent: self.common_exponent.max(exponent),
        }
    }

    /// The lowest exponent of a direct form at which every mean of this node with others of no higher need has room:
    /// h = code · 2^(exponent - 31), and Σ|code| stays below [`limits::CODE_SUM_LIMIT`].
    ///
    /// `sum` is the node's Σ|code| as 32-bit codes at its own `exponent`. The result is at most
    /// [`limits::MAX_EXPONENT`], which holds all, by the bound on Σ|h|.
    #[inline]
    pub fn exponent_of(exponent: u8, sum: u64) -> u8 {
        /// Rounding of a mean may add half a step per tap.
        const ROOM: u64 = limits::CODE_SUM_LIMIT - limits::MAX_ORDER as u64;
        let mut needed = exponent;
        let mut sum = sum;
        while sum >= ROOM && needed < limits::MAX_EXPONENT {
            sum >>= 1;
            needed += 1;
        }
        needed
    }
}

/// A texture's certificate as it is stored; [`crate::Certificate`] has its meaning.
#[derive(Clone, Copy, Debug, Serialize)]
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
#[cfg(feature = "alloc")]
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

    /// Byte of the flags.
    pub const FLAGS: usize = 2;

    pub fn read(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        Self {
            order: u16::from_le_bytes([bytes[0], bytes[1]]),
            flags: bytes[Self::FLAGS],
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
        bytes[Self::FLAGS] = self.flags;
        bytes[3] = self.exponent;
        bytes[4..8].copy_from_slice(&self.output_power.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.prediction_error_power.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.offset.to_le_bytes());
        bytes
    }
}
