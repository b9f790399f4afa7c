//! The parts of an image that go to the flash, according to its program headers, because flashing tools write whole
//! segments.

use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{Endianness, elf};

use anyhow::{Context, Result, bail};

use super::memory::region;

/// Regions of the memory map that hold code.
const CODE: [&str; 2] = ["BOOTLOADER", "FLASH"];

/// Regions whose last page is flashed with ones, so that the flashing tool erases their sectors.
const ERASED: [&str; 2] = ["RECORDS_1", "RECORDS_2"];

/// Number of bytes that probe-rs programs at once, the `page_size` in its description of the part. It fills a page up
/// with ones.
const PAGE_BYTES: u64 = 0x400;

/// Bytes for a region of the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Name of the region.
    pub region: &'static str,
    /// Address of the first byte.
    pub address: u64,
    /// The bytes. Gaps between segments are ones.
    pub bytes: Vec<u8>,
}

/// Returns the bytes of the ELF file `image`, one piece for each region of the flash.
///
/// # Errors
/// The bytes are not an image, or a segment is where nothing may be flashed: on records, settings or libraries.
pub fn pieces(image: &[u8]) -> Result<Vec<Piece>> {
    let file = ElfFile32::<Endianness>::parse(image)?;
    let endian = file.endian();
    let mut segments = Vec::new();
    for segment in file.elf_header().program_headers(endian, file.data())? {
        let bytes = segment.data(endian, file.data()).unwrap_or_default();
        if segment.p_type(endian) == elf::PT_LOAD && !bytes.is_empty() {
            // The physical address is where flashing tools write; code of the ITCM has its copy in flash there.
            segments.push((u64::from(segment.p_paddr(endian)), bytes));
        }
    }
    segments.sort_unstable();
    joined(&segments)
}

/// Returns the pieces of an image that is flashed together with its bootloader, one for each region.
///
/// # Errors
/// The errors of [`pieces`]; or one of the regions is empty.
pub fn all_pieces(image: &[u8]) -> Result<Vec<Piece>> {
    let pieces = pieces(image)?;
    for name in CODE.into_iter().chain(ERASED) {
        if pieces.iter().all(|piece| piece.region != name) {
            bail!("the image has nothing for {name}");
        }
    }
    Ok(pieces)
}

/// Returns the bytes of the ELF file `image` from the start of the region called `name` on.
///
/// # Errors
/// The errors of [`pieces`]; or there is nothing at the region's start.
pub fn flashed(image: &[u8], name: &str) -> Result<Vec<u8>> {
    let (start, _) = region(name).with_context(|| format!("memory.x has no region {name}"))?;
    Ok(pieces(image)?
        .into_iter()
        .find(|piece| piece.address == start)
        .with_context(|| format!("the image has nothing at the start of {name}"))?
        .bytes)
}

/// Joins segments, in ascending order, to one piece per region.
fn joined(segments: &[(u64, &[u8])]) -> Result<Vec<Piece>> {
    let mut pieces: Vec<Piece> = Vec::new();
    for &(address, bytes) in segments {
        let region = region_of(address, bytes)?;
        match pieces.last_mut() {
            Some(piece) if piece.region == region => {
                piece.bytes.resize((address - piece.address) as usize, 0xFF);
                piece.bytes.extend_from_slice(bytes);
            }
            _ => pieces.push(Piece {
                region,
                address,
                bytes: bytes.to_vec(),
            }),
        }
    }
    Ok(pieces)
}

/// Returns the name of the region to which a segment may be flashed.
fn region_of(address: u64, bytes: &[u8]) -> Result<&'static str> {
    let end = address + bytes.len() as u64;
    for name in CODE.into_iter().chain(ERASED) {
        let (start, length) = region(name).with_context(|| format!("memory.x has no region {name}"))?;
        let first = if ERASED.contains(&name) {
            start + length - PAGE_BYTES
        } else {
            start
        };
        let is_right = CODE.contains(&name) || bytes.iter().all(|&byte| byte == 0xFF);
        if first <= address && end <= start + length && is_right {
            return Ok(name);
        }
    }
    bail!(
        "a segment of {} bytes would be flashed to {address:#010x}, where only the device may write: memory.x and the \
         linker scripts place it",
        bytes.len()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONES: [u8; 32] = [0xFF; 32];

    /// Returns an address in a region of the map.
    fn at(name: &str, offset: u64) -> u64 {
        region(name).expect("it is in the map").0 + offset
    }

    #[test]
    fn segments_of_a_region_are_one_piece_with_ones_between_them() {
        let mark = at("RECORDS_2", 128 * 1024 - 32);
        let segments: [(u64, &[u8]); 3] = [(at("FLASH", 0), &[1, 2]), (at("FLASH", 4), &[3]), (mark, &ONES)];
        let pieces = joined(&segments).expect("all may be flashed");
        let found: Vec<_> = (pieces.iter())
            .map(|piece| (piece.region, piece.address, &piece.bytes[..]))
            .collect();
        let code: &[u8] = &[1, 2, 0xFF, 0xFF, 3];
        let expected = [("FLASH", at("FLASH", 0), code), ("RECORDS_2", mark, &ONES)];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_segment_over_records_settings_or_libraries_is_refused_with_its_address() {
        let sector = vec![0xFF; 128 * 1024];
        let refused: [(u64, &[u8]); 7] = [
            (at("RECORDS_1", 0), &ONES),
            (at("RECORDS_1", 0), &sector),
            (at("RECORDS_1", 127 * 1024 - 32), &ONES),
            (at("RECORDS_1", 128 * 1024 - 32), &[0; 32]),
            (at("RECORDS_1", 128 * 1024 - 16), &ONES),
            (at("SETTINGS", 0), &ONES),
            (at("SLOT_A", 0), &ONES),
        ];
        for (address, bytes) in refused {
            let error = joined(&[(address, bytes)]).unwrap_err().to_string();
            assert!(error.contains(&format!("{address:#010x}")), "{error}");
        }
    }
}
