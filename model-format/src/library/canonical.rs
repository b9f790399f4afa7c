//! The one form of a library's bytes.
//!
//! Lengths, counts and kinds are varints, seven bits per byte, and a reader of varints takes more bytes than a number
//! needs: 0x80 0x00 reads as 0x00. Such bytes are refused, so that a library has one encoding, and two files that
//! differ are two libraries. Each of the functions gives the length of the only encoding; the reader compares it with
//! the bytes that it took, which are never fewer.

use crate::error::Problem;
use crate::scene::Scene;
use crate::wire::{CertificateRecord, TextureRecord};

/// Refuses a value that took more bytes of `before`, of which `after` are left, than its only encoding has.
pub(super) fn check(before: &[u8], after: &[u8], length: usize) -> Result<(), Problem> {
    if before.len() - after.len() == length {
        Ok(())
    } else {
        Err(Problem::Padded)
    }
}

/// Length of the varint of `value`, bytes.
pub(super) const fn of_number(value: u32) -> usize {
    let bits = u32::BITS - (value | 1).leading_zeros();
    bits.div_ceil(7) as usize
}

/// Length of a string of bytes or of text with its own length before it, bytes.
pub(super) const fn of_string(bytes: &[u8]) -> usize {
    // No string is longer than a library, whose length fits in 32 bits.
    of_number(bytes.len() as u32) + bytes.len()
}

/// Length of a texture's record, bytes.
pub(super) fn of_texture(record: &TextureRecord<'_>) -> usize {
    /// Structure, provenance and the kind of the certificate: each has fewer than 128 values.
    const KINDS: usize = 3;
    const CRC_BYTES: usize = 4;
    let certificate = match record.certificate {
        CertificateRecord::None => 0,
        CertificateRecord::Lattice { largest_theta } => of_number(largest_theta),
        CertificateRecord::DirectForm { cell_margins, .. } => CRC_BYTES + of_string(cell_margins),
    };
    KINDS
        + of_string(record.name.as_bytes())
        + of_number(record.sample_rate_hz)
        + of_string(record.speed_axis)
        + of_string(record.force_axis)
        + of_string(record.nodes)
        + of_string(record.coefficients)
        + certificate
}

/// Length of a scene's record, bytes. A scene is small, so that it is measured by its writer.
pub(super) fn of_scene(scene: &Scene) -> Option<usize> {
    postcard::experimental::serialized_size(scene).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_numbers_are_those_of_their_encoding() {
        let mut buffer = [0; 8];
        for bit in 0..32 {
            for value in [(1u32 << bit) - 1, 1 << bit, (1 << bit) | 1, u32::MAX >> bit] {
                let encoded = postcard::to_slice(&value, &mut buffer).expect("there is room");
                assert_eq!(of_number(value), encoded.len(), "{value}");
            }
        }
    }
}
