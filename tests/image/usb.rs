//! USB descriptors of the device, byte by byte as they were on the wire.

use model_format::link::{USB_PRODUCT_ID, USB_VENDOR_ID};
use virtual_stylus::Options;
use virtual_stylus::usb_host::Descriptors;
use virtual_stylus::usb_host::descriptor::{self, MICROSOFT_PLATFORM, bulk_endpoints, microsoft_set, parts};

use crate::device::{BULK_IN, BULK_OUT, Device};

fn read() -> Descriptors {
    let mut device = Device::on_usb(Options::default());
    device.enumerate().expect("it enumerates")
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// Decodes UTF-16, little-endian.
fn text(bytes: &[u8]) -> String {
    let units: Vec<u16> = bytes.chunks(2).map(|pair| word(pair, 0)).collect();
    String::from_utf16(&units).expect("UTF-16")
}

#[test]
fn the_descriptors_keep_the_rules_of_usb_2() {
    let read = read();
    check_device(&read.device);
    check_configuration(&read.configuration);
    // Section 9.6.7.
    assert_eq!(read.languages[..2], [4, descriptor::STRING]);
    assert_eq!(word(&read.languages, 2), 0x0409);
    for (place, string) in [14, 15, 16].into_iter().zip(&read.strings) {
        assert_ne!(read.device[place], 0, "there is a string");
        assert_eq!(string[..2], [string.len() as u8, descriptor::STRING]);
        assert!(!text(&string[2..]).is_empty());
    }
    let serial = text(&read.strings[2][2..]);
    assert_eq!(serial.len(), 24, "96 bits: {serial}");
    assert!(serial.chars().all(|digit| digit.is_ascii_hexdigit()));
}

fn check_device(device: &[u8]) {
    // Table 9-8.
    assert_eq!((device.len(), device[0], device[1]), (18, 18, descriptor::DEVICE));
    // From USB 2.1 on there is a BOS.
    assert!((0x0201..=0x0210).contains(&word(device, 2)));
    // The device has one function, which its interface describes.
    assert_eq!(device[4..7], [0, 0, 0]);
    assert!([8, 16, 32, 64].contains(&device[7]), "endpoint 0's packets");
    assert_eq!((word(device, 8), word(device, 10)), (USB_VENDOR_ID, USB_PRODUCT_ID));
    assert_eq!(device[17], 1, "configurations");
}

fn check_configuration(configuration: &[u8]) {
    // Table 9-10.
    assert_eq!(configuration[..2], [9, descriptor::CONFIGURATION]);
    assert_eq!(usize::from(word(configuration, 2)), configuration.len());
    assert_eq!(configuration[4], 1, "interfaces");
    assert_ne!(configuration[5], 0, "a configuration's value");
    let parts: Vec<&[u8]> = parts(configuration).collect();
    assert_eq!(parts.iter().map(|part| part.len()).sum::<usize>(), configuration.len());
    let kinds: Vec<[u8; 2]> = parts.iter().map(|part| [part[0], part[1]]).collect();
    assert_eq!(
        kinds,
        [
            [9, descriptor::CONFIGURATION],
            [9, descriptor::INTERFACE],
            [7, descriptor::ENDPOINT],
            [7, descriptor::ENDPOINT],
        ]
    );
    // Tables 9-12 and 9-13; section 5.8.3 for the packets of a bulk endpoint at full speed.
    let interface = parts[1];
    assert_eq!(interface[2..4], [0, 0], "number and setting");
    assert_eq!(interface[4], 2, "endpoints");
    assert_eq!(interface[5], 0xFF, "the vendor's class");
    for endpoint in &parts[2..] {
        assert_eq!(endpoint[3], 2, "bulk");
        assert!([8, 16, 32, 64].contains(&word(endpoint, 4)));
        assert_eq!(endpoint[2] & 0x70, 0, "reserved bits");
    }
    assert_eq!(bulk_endpoints(configuration), Some([BULK_OUT, BULK_IN]));
}

#[test]
fn windows_finds_its_driver_by_the_descriptors_of_microsoft_os_2() {
    let read = read();
    // USB 3.2, section 9.6.2.
    let bos = &read.bos;
    assert_eq!(bos[..2], [5, descriptor::BOS]);
    assert_eq!(usize::from(word(bos, 2)), bos.len());
    let capabilities: Vec<&[u8]> = parts(&bos[5..]).collect();
    assert_eq!(capabilities.len(), usize::from(bos[4]));
    for capability in &capabilities {
        assert_eq!(capability.len(), usize::from(capability[0]));
        assert_eq!(capability[1], descriptor::DEVICE_CAPABILITY);
    }
    // Microsoft OS 2.0 Descriptors Specification, tables 3 to 5.
    let platform = (capabilities.iter())
        .find(|capability| capability[2] == 5)
        .expect("a platform capability");
    assert_eq!((platform.len(), platform[3]), (28, 0));
    assert_eq!(platform[4..20], MICROSOFT_PLATFORM);
    let version = &platform[20..24];
    assert_eq!(version, [0, 0, 3, 6], "Windows 8.1");
    let (code, length) = microsoft_set(bos).expect("vendor code and length");
    assert_eq!((code, usize::from(length)), (platform[26], read.microsoft.len()));
    // Table 10: the set's header.
    let set = &read.microsoft;
    assert_eq!((word(set, 0), word(set, 2)), (10, 0));
    assert_eq!(&set[4..8], version);
    assert_eq!(word(set, 8), length);
    let mut features = Vec::new();
    let mut rest = &set[10..];
    while !rest.is_empty() {
        let (feature, behind) = rest.split_at(word(rest, 0).into());
        features.push(feature);
        rest = behind;
    }
    // Table 13: a compatible ID of eight bytes, and a sub-ID.
    let compatible = features[0];
    assert_eq!((compatible.len(), word(compatible, 2)), (20, 3));
    assert_eq!(&compatible[4..], b"WINUSB\0\0\0\0\0\0\0\0\0\0");
    // Table 14: a property of several strings. A zero ends each string, and another zero ends the list.
    let property = features[1];
    assert_eq!((word(property, 2), word(property, 4)), (4, 7));
    let name_bytes = usize::from(word(property, 6));
    let (name, value) = property[8..].split_at(name_bytes);
    assert_eq!(text(name), "DeviceInterfaceGUIDs\0");
    assert_eq!(usize::from(word(value, 0)), value.len() - 2);
    let guids = text(&value[2..]);
    let guid = guids.strip_suffix("\0\0").expect("it ends with two zeros");
    let digits = guid.strip_prefix('{').and_then(|guid| guid.strip_suffix('}'));
    let groups: Vec<usize> = digits.expect("braces").split('-').map(str::len).collect();
    assert_eq!(groups, [8, 4, 4, 4, 12]);
    assert_eq!(features.len(), 2);
}
