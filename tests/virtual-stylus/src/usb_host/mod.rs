//! Software of the host on USB, as far as tests and sockets need it: enumeration and control requests, as of an
//! operating system, and a bulk interface with transfers that wait both ways, as of a program on it.
//!
//! | step of an enumeration | USB 2.0 |
//! |---|---|
//! | the cable, 100 ms until the contacts are still | 7.1.7.3 |
//! | a reset of 10 ms, 10 ms to recover | 7.1.7.5 |
//! | the device descriptor's first 8 bytes, a second reset, the address, 2 ms to recover | 9.1.2, 9.2.6.3 |
//! | descriptors of device, configuration, BOS and Microsoft OS 2.0, strings, the configuration | 9.4, 9.6 |

mod bulk_frames;
pub mod descriptor;
mod enumeration;
mod request;

pub use bulk_frames::BulkFrames;
pub use descriptor::{MICROSOFT_PLATFORM, bulk_endpoints, microsoft_set, parts};
pub use enumeration::{Arrived, Descriptors, Timing, Transferred, UsbHost};
pub use request::Request;
