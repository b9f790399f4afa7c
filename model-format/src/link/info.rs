//! Identity and versions of a device.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Name of a product.
pub type ProductName = String<32>;
/// Serial number of a board, hexadecimal: the 96-bit unique id of the STM32 (RM0433 section 61.1).
pub type Serial = String<24>;
/// A version as text.
pub type VersionText = String<64>;

/// Identity and versions of a device. This type never changes; anything else goes to an endpoint of its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct DeviceInfo {
    /// Name of the product.
    pub product: ProductName,
    /// Serial number of the board.
    pub serial: Serial,
    /// Version of the firmware.
    pub firmware_version: VersionText,
    /// Build of the firmware: profile, compiler, revision if known.
    pub build: VersionText,
    /// [`crate::link::PROTOCOL_VERSION`] of the device.
    pub protocol_version: u16,
    /// [`crate::FORMAT_VERSION`] of the libraries that the device plays.
    pub library_format_version: u16,
    /// [`crate::link::SCHEMA_HASH`] of the device.
    pub schema_hash: u64,
}
