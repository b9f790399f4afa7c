//! The host's side of the link to a stylus: over USB, a serial port, or TCP (a virtual stylus).
//!
//! [`model_format::link`] defines the messages; this module carries them. A caller needs only [`Device`]: it opens a
//! link, reads the device's identity, refuses a device that speaks another protocol, and then makes requests and
//! receives streams.
//!
//! | module | subject |
//! |---|---|
//! | `address` | addresses of devices, as a user writes them |
//! | `open` | opening of an address; `wire` and `bulk` carry frames, `health` is the state of a link |
//! | `links` | the links to attached devices |
//! | `holder` | the program that has a link open |
//! | [`discovery`] | the devices that are attached |
//! | `usb`, [`virtual_usb`] | the bulk endpoints of a stylus, and of a virtual one |
//! | `version` | differences of version between device and host, and the older side |
//! | [`Device`] | every request as a function, with its timeout; `limit` measures it in the device's time |
//! | [`upload`] | upload of a library, resumed after broken links, and read back |
//! | [`update`] | update of the image, up to its confirmation |
//! | [`play`] | motions at a fixed rate, keep-alives, and why a play counts as failed |
//! | [`capture`] | the record stream and its losses |
//! | [`settings`] | settings as a user writes and reads them, and what follows from a change |
//!
//! A link serves one program at a time. A second one is refused, and the first goes on; a stylus has two links.
//!
//! Over TCP and the serial port a frame is COBS-encoded and ends with a zero byte; over USB it is a bulk transfer.
//!
//! Invariant: nothing here fits or evaluates a model, and nothing here prints.

mod address;
mod bulk;
pub mod capture;
mod device;
pub mod discovery;
mod error;
mod health;
mod holder;
mod limit;
mod links;
mod open;
pub mod play;
pub mod settings;
pub mod update;
pub mod upload;
mod usb;
mod version;
pub mod virtual_usb;
mod wire;

pub use address::LinkAddress;
pub use device::{Device, SlotContent, TextureEntry, Timeouts};
pub use error::{LinkError, Result};
pub use version::Mismatch;
pub use wire::{BrokenFrame, FrameDecoder};
