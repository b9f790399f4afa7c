//! What a device is and which versions it speaks.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A product's name.
pub type ProductName = String<32>;
/// A board's serial number, hexadecimal: the 96-bit unique id of the STM32 (RM0433 section 61.1).
pub type Serial = String<24>;
/// A version in words.
pub type VersionText = String<64>;

/// What a device is. This type never changes; what else a host should know goes to an endpoint of its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct DeviceInfo {
    /// What the product is called.
    pub product: ProductName,
    /// The board's own number.
    pub serial: Serial,
    /// Version of the firmware.
    pub firmware_version: VersionText,
    /// How it was built: profile, compiler, revision if known.
    pub build: VersionText,
    /// [`crate::link::PROTOCOL_VERSION`] of the device.
    pub protocol_version: u16,
    /// [`crate::FORMAT_VERSION`] of the libraries that the device plays.
    pub library_format_version: u16,
    /// [`crate::link::SCHEMA_HASH`] of the device.
    pub schema_hash: u64,
}
