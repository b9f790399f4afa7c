//! Differences of version between device and host, and which side is older.

use std::cmp::Ordering;
use std::fmt;

use model_format::FORMAT_VERSION;
use model_format::link::{DeviceInfo, PROTOCOL_VERSION, SCHEMA_HASH};

/// Version of this program. The firmware takes its version from the same workspace.
const HOST_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Remedy if the device is older.
const RENEW_DEVICE: &str = "the device's firmware is the older side: flash it from this version (cargo flash)";
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
                let what =
                    format!("the messages of the device (firmware {device}) and of this program ({host}) differ");
                (what, numbers(device).cmp(&numbers(host)))
            }
            Self::LibraryFormat { device, host } => {
                let what = format!("the device plays libraries of format {device}, this program writes {host}");
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
    // A suffix, such as a revision, says nothing about the order.
    version
        .split(['-', '+', ' '])
        .next()
        .unwrap_or_default()
        .split('.')
        .map_while(|part| part.parse().ok())
        .collect()
}
