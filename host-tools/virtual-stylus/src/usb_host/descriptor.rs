//! Descriptors: their types (USB 2.0 table 9-5, USB 3.2 table 9-6), with the specification's names, and their contents.

/// `DEVICE`.
pub const DEVICE: u8 = 1;
/// `CONFIGURATION`.
pub const CONFIGURATION: u8 = 2;
/// `STRING`.
pub const STRING: u8 = 3;
/// `INTERFACE`.
pub const INTERFACE: u8 = 4;
/// `ENDPOINT`.
pub const ENDPOINT: u8 = 5;
/// `BOS`.
pub const BOS: u8 = 15;
/// `DEVICE_CAPABILITY`.
pub const DEVICE_CAPABILITY: u8 = 16;

/// `wTotalLength`, which has the same offset in a configuration and a BOS.
pub(super) fn total_length(head: &[u8]) -> u16 {
    match *head {
        [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
        _ => 0,
    }
}

/// `D8DD60DF-4589-4CC7-9CD2-659D9E648A9F`, in the order of the bytes on the wire (Microsoft OS 2.0 Descriptors
/// Specification, table 4).
pub const MICROSOFT_PLATFORM: [u8; 16] = [
    0xDF, 0x60, 0xDD, 0xD8, 0x89, 0x45, 0xC7, 0x4C, 0x9C, 0xD2, 0x65, 0x9D, 0x9E, 0x64, 0x8A, 0x9F,
];

/// Vendor code and length of the Microsoft OS 2.0 descriptor set, if the BOS names one.
pub fn microsoft_set(bos: &[u8]) -> Option<(u8, u16)> {
    let mut rest = bos.get(5..)?;
    while let Some(&length) = rest.first().filter(|length| **length > 2) {
        let capability = rest.get(..usize::from(length))?;
        if capability.get(4..20) == Some(&MICROSOFT_PLATFORM) {
            let [low, high] = [*capability.get(24)?, *capability.get(25)?];
            return Some((*capability.get(26)?, u16::from_le_bytes([low, high])));
        }
        rest = &rest[usize::from(length)..];
    }
    None
}

/// The descriptors that a configuration consists of, each starting with its length and type.
pub fn parts(configuration: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = configuration;
    std::iter::from_fn(move || {
        let length = usize::from(*rest.first()?);
        let (part, behind) = rest.split_at_checked(length.max(2))?;
        rest = behind;
        Some(part)
    })
}

/// Addresses of the first bulk endpoint to the device and the first one from it.
pub fn bulk_endpoints(configuration: &[u8]) -> Option<[u8; 2]> {
    let bulk = |from_device: bool| {
        parts(configuration).find_map(|part| match *part {
            [_, ENDPOINT, address, attributes, ..] if attributes & 3 == 2 && (address & 0x80 != 0) == from_device => {
                Some(address)
            }
            _ => None,
        })
    };
    Some([bulk(false)?, bulk(true)?])
}
