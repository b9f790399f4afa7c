//! Archives of files as they are, without compression: recordings hardly get smaller.
//!
//! Source: PKWARE, .ZIP File Format Specification, 4.3.6 to 4.3.16.

use crc::{CRC_32_ISO_HDLC, Crc};

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Version that a reader must have, 2.0: folders in names. Flag 11: names are UTF-8. Method 0: stored. Time 0, and the
/// earliest day, so that the same files give the same archive.
const COMMON: [u8; 10] = [20, 0, 0, 8, 0, 0, 0, 0, 0x21, 0];

/// Returns the archive of `files`, each a name and its content; `None` beyond what the format counts: 65 535 files, or
/// 4 GiB.
pub fn archive<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Option<Vec<u8>> {
    let (mut all, mut directory, mut count) = (Vec::new(), Vec::new(), 0_u16);
    for (name, bytes) in files {
        let at = u32::try_from(all.len()).ok()?;
        let size = u32::try_from(bytes.len()).ok()?.to_le_bytes();
        let length = u16::try_from(name.len()).ok()?.to_le_bytes();
        let sum = CRC.checksum(bytes).to_le_bytes();
        // Both headers end with these, and with the length of what is left out.
        let common = [&COMMON[..], &sum, &size, &size, &length, &[0, 0]].concat();
        all.extend([b"PK\x03\x04", &common[..], name.as_bytes(), bytes].concat());
        directory.extend(
            [
                b"PK\x01\x02\x14\0",
                &common[..],
                &[0; 10],
                &at.to_le_bytes(),
                name.as_bytes(),
            ]
            .concat(),
        );
        count = count.checked_add(1)?;
    }
    let (at, size) = (u32::try_from(all.len()).ok()?, u32::try_from(directory.len()).ok()?);
    let count = count.to_le_bytes();
    all.extend(directory);
    let counts = [
        &[0; 4][..],
        &count,
        &count,
        &size.to_le_bytes(),
        &at.to_le_bytes(),
        &[0, 0],
    ]
    .concat();
    all.extend([b"PK\x05\x06", &counts[..]].concat());
    Some(all)
}
