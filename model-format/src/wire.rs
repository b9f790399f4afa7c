//! The records of a library as they are stored. The package's `README.md` has the layout with offsets.
//!
//! Multi-byte numbers in byte strings are little-endian and not aligned. The CRC covers all bytes of a library but its
//! own four, and so also the version and the length.

use serde::{Deserialize, Serialize};

/// The format's version. It changes when an older reader could misread newer bytes.
pub const FORMAT_VERSION: u16 = 7;

/// First bytes of every library.
pub(crate) const MAGIC: [u8; 4] = *b"HTXL";

/// Length of [`Prefix`], bytes.
pub(crate) const PREFIX_BYTES: usize = 16;

/// Bytes of [`Prefix::reserved`].
pub(crate) const RESERVED: core::ops::Range<usize> = 6..8;

/// Bytes of [`Prefix::crc32`].
pub(crate) const CRC_RANGE: core::ops::Range<usize> = 12..16;

/// Algorithm of the CRC-32 (ISO-HDLC) with which libraries are checked: in their prefix, in an upload and in a slot.
pub static CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC, as in zlib) of all bytes of a library except the field that stores it.
///
/// `bytes` must be at least as long as a [`Prefix`].
#[cfg(feature = "alloc")]
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(&bytes[..CRC_RANGE.start]);
    digest.update(&bytes[CRC_RANGE.end..]);
    digest.finalize()
}

/// Reader of postcard's encodings. It refuses a varint of more bytes than necessary, so that a library has only one
/// encoding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    #[inline]
    pub fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(byte)
    }

    /// Reads a varint whose value has at most 32 bits.
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
                // A last byte of 0 says nothing, and the fifth byte has only the upper 4 of 32 bits.
                let whole = byte > 0 && (shift < 28 || byte < 0x10);
                return whole.then_some(value);
            }
        }
        None
    }

    /// Reads a string: its length as a varint, then its bytes.
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

    /// Reads the first byte of an `Option`: 0 if there is no value, 1 if the value follows.
    pub fn is_some(&mut self) -> Option<bool> {
        match self.byte()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

impl<'a> TextureRecord<'a> {
    /// Reads the record at the reader's position.
    pub fn read(reader: &mut Reader<'a>) -> Option<Self> {
        Some(Self {
            name: core::str::from_utf8(reader.string()?).ok()?,
            sample_rate_hz: reader.varint()?,
            provenance: match reader.varint()? {
                0 => Provenance::Recorded,
                1 => Provenance::Simulated,
                2 => Provenance::Unscaled,
                _ => return None,
            },
            speed_axis: reader.string()?,
            force_axis: reader.string()?,
            nodes: reader.string()?,
            coefficients: reader.string()?,
            summary: Summary {
                highest_order: u16::try_from(reader.varint()?).ok()?,
                highest_output_power: reader.f32()?,
            },
        })
    }
}

/// First bytes of a library, with the same layout in every version of the format.
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

/// Origin of the recordings behind a texture. It stays with the texture in every library, listing and report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Provenance {
    /// Recorded from a real tool on a real surface.
    Recorded,
    /// Computed by the rig simulator.
    Simulated,
    /// Recorded, as integers whose acceleration nothing states: the level is not known.
    Unscaled,
}

impl Provenance {
    /// Returns the provenance of what has `parts` of these provenances. One that is simulated makes the whole
    /// simulated, so that no simulation passes for a recording, and one without a scale takes the others' away.
    pub fn of_all(parts: impl IntoIterator<Item = Self>) -> Self {
        let graver = |whole, part| match (whole, part) {
            (Self::Simulated, _) | (_, Self::Simulated) => Self::Simulated,
            (Self::Unscaled, _) | (_, Self::Unscaled) => Self::Unscaled,
            _ => Self::Recorded,
        };
        parts.into_iter().fold(Self::Recorded, graver)
    }
}

impl core::fmt::Display for Provenance {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Recorded => "recorded",
            Self::Simulated => "SIMULATED",
            Self::Unscaled => "recorded, level not known",
        })
    }
}

/// Record of a texture, as postcard encodes it. In a library, one string holds the record and the optional parts after
/// it.
#[derive(Serialize)]
pub(crate) struct TextureRecord<'a> {
    pub name: &'a str,
    pub sample_rate_hz: u32,
    pub provenance: Provenance,
    pub speed_axis: &'a [u8],
    pub force_axis: &'a [u8],
    pub nodes: &'a [u8],
    pub coefficients: &'a [u8],
    pub summary: Summary,
}

/// Highest values of all nodes of a texture. They are stored so that a player need not read all nodes to find them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Summary {
    /// Highest order.
    pub highest_order: u16,
    /// Highest output power, (m/s²)².
    pub highest_output_power: f32,
}

impl Summary {
    /// Returns the summary with one more node included.
    #[inline]
    pub fn with_node(self, order: u16, output_power: f32) -> Self {
        Self {
            highest_order: self.highest_order.max(order),
            // Powers are not negative, so their bits, read as integers, have the same order as the powers.
            highest_output_power: f32::from_bits(self.highest_output_power.to_bits().max(output_power.to_bits())),
        }
    }
}

/// Record of a node of the grid. It has a fixed width, so that any node can be found without reading the nodes before
/// it.
#[derive(Clone, Copy)]
pub(crate) struct NodeRecord {
    pub order: u16,
    pub flags: u16,
    pub output_power: f32,
    pub prediction_error_power: f32,
    /// Byte of the coefficient string at which the node's coefficients begin.
    pub offset: u32,
}

impl NodeRecord {
    pub const BYTES: usize = 16;

    /// Offset of the flags in the record, bytes.
    pub const FLAGS: usize = 2;

    pub fn read(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        Self {
            order: u16::from_le_bytes([bytes[0], bytes[1]]),
            flags: u16::from_le_bytes([bytes[Self::FLAGS], bytes[Self::FLAGS + 1]]),
            output_power: f32::from_le_bytes(word(4)),
            prediction_error_power: f32::from_le_bytes(word(8)),
            offset: u32::from_le_bytes(word(12)),
        }
    }

    #[cfg(feature = "alloc")]
    pub fn bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        bytes[0..2].copy_from_slice(&self.order.to_le_bytes());
        bytes[Self::FLAGS..4].copy_from_slice(&self.flags.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.output_power.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.prediction_error_power.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.offset.to_le_bytes());
        bytes
    }
}
