//! The file by which the part's built-in loader (AN2606) writes an image, in the format DfuSe of ST's UM0391.

use crc::{CRC_32_JAMCRC, Crc};
use stylus_app::flash::WORD_BYTES;

use super::segments::Piece;

/// Length of the file's prefix, and of the target's prefix without its size and its number of elements, bytes.
const PREFIX_BYTES: usize = 11;
const TARGET_BYTES: usize = 266;

/// Identifiers of the suffix: any device, the loader's product and vendor, and the version of the format.
const IDENTIFIERS: [u16; 4] = [0xFFFF, 0xDF11, 0x0483, 0x011A];

/// Returns the file that erases the sectors of `pieces` and then writes them.
pub fn file(pieces: &[Piece]) -> Vec<u8> {
    let mut elements = Vec::new();
    for Piece { address, bytes, .. } in pieces {
        // The part programs whole words of flash.
        let length = bytes.len().next_multiple_of(WORD_BYTES);
        elements.extend((*address as u32).to_le_bytes());
        elements.extend((length as u32).to_le_bytes());
        let end = elements.len() + length;
        elements.extend_from_slice(bytes);
        elements.resize(end, 0xFF);
    }
    let mut file = b"DfuSe\x01".to_vec();
    // The size of a file does not count its suffix. The 8 bytes are the target's size and number of elements.
    let all_bytes = PREFIX_BYTES + TARGET_BYTES + 8 + elements.len();
    file.extend((all_bytes as u32).to_le_bytes());
    file.push(1);
    // The target is alternate setting 0, the internal flash, and has no name.
    file.extend(b"Target");
    file.resize(PREFIX_BYTES + TARGET_BYTES, 0);
    file.extend((elements.len() as u32).to_le_bytes());
    file.extend((pieces.len() as u32).to_le_bytes());
    file.extend(elements);
    file.extend(IDENTIFIERS.iter().flat_map(|word| word.to_le_bytes()));
    file.extend(b"UFD\x10");
    // The CRC of the suffix is not complemented at its end (DFU 1.1, appendix B).
    let crc = Crc::<u32>::new(&CRC_32_JAMCRC).checksum(&file);
    file.extend(crc.to_le_bytes());
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_as_the_formats_describe_it() {
        let pieces = [Piece {
            region: "FLASH",
            address: 0x0802_0000,
            bytes: vec![7; 33],
        }];
        let file = file(&pieces);
        let word = |at| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes"));
        // UM0391, sections 2.1 to 2.4: prefix, target prefix, element.
        let suffix = file.len() - 16;
        assert_eq!(&file[..6], b"DfuSe\x01");
        assert_eq!((word(6) as usize, file[10]), (suffix, 1));
        assert_eq!(&file[11..22], b"Target\0\0\0\0\0");
        assert_eq!((word(277) as usize, word(281)), (suffix - 285, 1));
        assert_eq!((word(285), word(289)), (0x0802_0000, 64));
        assert_eq!(file[293..suffix], [[7; 33].as_slice(), &[0xFF; 31]].concat());
        // DFU 1.1, appendix B: the suffix, whose checksum at the end is not complemented.
        assert_eq!(file[suffix..suffix + 8], [0xFF, 0xFF, 0x11, 0xDF, 0x83, 4, 0x1A, 1]);
        assert_eq!(&file[suffix + 8..suffix + 12], b"UFD\x10");
        let sum = file[..suffix + 12].iter().fold(u32::MAX, |sum, byte| {
            (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ ((sum & 1) * 0xEDB8_8320))
        });
        assert_eq!(word(suffix + 12), sum);
    }
}
