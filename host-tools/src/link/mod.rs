//! The host's side of the link to a stylus: over USB, a serial port, or TCP (a virtual stylus).
//!
//! What is said is [`model_format::link`]; this module carries it. [`Device`] is the whole of it for a caller: it opens a
//! link, asks the device first what it is, refuses one that speaks another protocol, and then asks, answers and streams.
//!
//! | module | does |
//! |---|---|
//! | `address` | where a device is, as a user writes it |
//! | `open` | opens what an address names; `wire` and `bulk` carry frames over it |
//! | `usb`, [`virtual_usb`] | the bulk endpoints of a stylus, and of a virtual one |
//! | `version` | which side of two that differ is the older one |
//! | [`Device`] | every request, with its timeout, as a function |
//! | [`upload`] | a library to the device, resumed over broken links, read back |
//! | [`play`] | motions and keep-alives at a rate |
//! | [`capture`] | the record stream, with what it lost |
//! | [`strokes`] | a free hand's recording, with its motion |
//! | [`set`] | a folder of recordings that a fit reads |
//!
//! Over TCP and the serial port a frame is COBS-encoded and ended by a zero byte; over USB it is a bulk transfer.

mod address;
mod bulk;
pub mod capture;
mod device;
mod error;
mod open;
pub mod play;
pub mod set;
pub mod strokes;
pub mod upload;
mod usb;
mod version;
pub mod virtual_usb;
mod wire;

pub use address::LinkAddress;
pub use device::{Device, Patience};
pub use error::{LinkError, Result};
pub use version::Mismatch;
