//! The host's side of the link to a stylus: over USB, a serial port, or TCP (a virtual stylus).
//!
//! [`model_format::link`] defines the messages; this module carries them. A caller needs only [`Device`]: it opens a
//! link, reads the device's identity, refuses a device that speaks another protocol, and then makes requests and
//! receives streams.
//!
//! | module | subject |
//! |---|---|
//! | `address` | addresses of devices, as a user writes them |
//! | `open` | opening of an address; `wire` and `bulk` carry frames over it |
//! | `usb`, [`virtual_usb`] | the bulk endpoints of a stylus, and of a virtual one |
//! | `version` | differences of version between device and host, and the older side |
//! | [`Device`] | every request as a function, with its timeout |
//! | [`upload`] | upload of a library, resumed after broken links, and read back |
//! | [`play`] | motions at a fixed rate, and keep-alives |
//! | [`capture`] | the record stream and its losses |
//! | [`calibrate`] | values of the coil, and zeros of the sensors, measured and verified |
//! | [`strokes`] | recordings of a free hand, with its motion |
//! | [`self_test`] | measurements of the device, compared with limits |
//! | [`set`] | a recording set that grows trial by trial |
//!
//! Over TCP and the serial port a frame is COBS-encoded and ends with a zero byte; over USB it is a bulk transfer.
//!
//! Invariant: nothing here fits or evaluates a model, and nothing here prints.

mod address;
mod bulk;
pub mod calibrate;
pub mod capture;
pub mod consequences;
mod device;
mod error;
mod open;
pub mod play;
pub mod self_test;
pub mod set;
pub mod strokes;
pub mod upload;
mod usb;
mod version;
pub mod virtual_usb;
mod wire;

pub use address::LinkAddress;
pub use device::{Device, Timeouts};
pub use error::{LinkError, Result};
pub use version::Mismatch;
