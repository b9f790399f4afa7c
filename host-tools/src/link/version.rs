//! Differences of version between device and host, with the older side.

use std::cmp::Ordering;
use std::fmt;

use model_format::FORMAT_VERSION;
use model_format::link::{DeviceInfo, PROTOCOL_VERSION, SCHEMA_HASH};

/// Version of this program; it and the firmware's are versions of one workspace.
const HOST_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Remedy if the device is older.
const RENEW_DEVICE: &str =
    "the device's firmware is the older side: flash it from this version (cargo flash)";
/// Remedy if the host is older.
const RENEW_HOST: &str = "this program is the older side: build it from the firmware's version";

/// A difference between device and host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mismatch {
    /// Another version of the protocol.
    Protocol {
        /// The device's.
        device: u16,
        /// The host's.
        host: u16,
    },
    /// Other messages in the same version of the protocol: one side is a development version.
    Schema {
        /// The firmware's version.
        device: String,
        /// The host's version.
        host: String,
    },
    /// Another library format.
    LibraryFormat {
        /// The device's.
        device: u16,
        /// The host's.
        host: u16,
    },
}

impl Mismatch {
    /// Returns the difference that prevents host and device from communicating, if there is one.
    pub fn of_protocol(info: &DeviceInfo) -> Option<Self> {
        if info.protocol_version != PROTOCOL_VERSION {
            Some(Self::Protocol {
                device: info.protocol_version,
                host: PROTOCOL_VERSION,
            })
        } else if info.schema_hash != SCHEMA_HASH {
            Some(Self::Schema {
                device: info.firmware_version.to_string(),
                host: HOST_VERSION.to_owned(),
            })
        } else {
            None
        }
    }

    /// Returns the difference that prevents the device from playing libraries of this host, if there is one.
    pub fn of_library_format(info: &DeviceInfo) -> Option<Self> {
        (info.library_format_version != FORMAT_VERSION).then_some(Self::LibraryFormat {
            device: info.library_format_version,
            host: FORMAT_VERSION,
        })
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, order) = match self {
            Self::Protocol { device, host } => {
                let what = format!("the device speaks protocol {device}, this program {host}");
                (what, device.cmp(host))
            }
            Self::Schema { device, host } => {
                let what = format!(
                    "the messages of the device (firmware {device}) and of this program ({host}) differ"
                );
                (what, numbers(device).cmp(&numbers(host)))
            }
            Self::LibraryFormat { device, host } => {
                let what = format!(
                    "the device plays libraries of format {device}, this program writes {host}"
                );
                (what, device.cmp(host))
            }
        };
        let remedy = match order {
            Ordering::Less => RENEW_DEVICE,
            Ordering::Greater => RENEW_HOST,
            Ordering::Equal => "build and flash both from one version of the sources",
        };
        write!(f, "{what}: {remedy}")
    }
}

/// Returns the numbers of a version such as `0.1.12`, up to the first part that is not a number.
fn numbers(version: &str) -> Vec<u32> {
    let core = version.split(['-', '+', ' ']).next().unwrap_or_default();
    core.split('.')
        .map_while(|part| part.parse().ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(protocol_version: u16, library_format_version: u16, schema_hash: u64) -> DeviceInfo {
        DeviceInfo {
            product: "stylus".try_into().unwrap(),
            serial: "1".try_into().unwrap(),
            firmware_version: HOST_VERSION.try_into().unwrap(),
            build: "test".try_into().unwrap(),
            protocol_version,
            library_format_version,
            schema_hash,
        }
    }

    #[test]
    fn the_same_versions_agree() {
        let info = info(PROTOCOL_VERSION, FORMAT_VERSION, SCHEMA_HASH);
        assert_eq!(Mismatch::of_protocol(&info), None);
        assert_eq!(Mismatch::of_library_format(&info), None);
    }

    #[test]
    fn the_older_side_is_named() {
        let words = |info: &DeviceInfo| Mismatch::of_protocol(info).unwrap().to_string();
        let older = words(&info(PROTOCOL_VERSION - 1, FORMAT_VERSION, SCHEMA_HASH));
        assert!(older.contains("firmware is the older"), "{older}");
        let newer = words(&info(PROTOCOL_VERSION + 1, FORMAT_VERSION, SCHEMA_HASH));
        assert!(newer.contains("this program is the older"), "{newer}");
        // A newer protocol has other messages, too; the version is the better message.
        assert_eq!(newer, words(&info(PROTOCOL_VERSION + 1, FORMAT_VERSION, 0)));
        let format = Mismatch::of_library_format(&info(PROTOCOL_VERSION, FORMAT_VERSION + 1, 0));
        assert!(
            format
                .unwrap()
                .to_string()
                .contains("this program is the older")
        );
    }

    #[test]
    fn messages_that_differ_are_told_apart_by_the_versions_of_their_programs() {
        let mut info = info(PROTOCOL_VERSION, FORMAT_VERSION, SCHEMA_HASH ^ 1);
        let mut words = |firmware: &str| {
            info.firmware_version = firmware.try_into().unwrap();
            Mismatch::of_protocol(&info).unwrap().to_string()
        };
        assert!(words("0.0.9-dirty").contains("firmware is the older"));
        assert!(words("999.0.0").contains("this program is the older"));
        assert!(words(HOST_VERSION).contains("one version of the sources"));
    }
}
