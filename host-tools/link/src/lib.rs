//! The host and a device: the link between them, and procedures of several requests over it.
//!
//! Invariant: nothing here fits a texture.

/// The host's side of the link to a stylus: over USB, a serial port, or TCP (a virtual stylus).
///
/// [`model_format::link`] defines the messages; this module carries them. A caller needs only [`Device`](link::Device):
/// it opens a link, reads the device's identity, refuses a device that speaks another protocol, and then makes requests
/// and receives streams.
///
/// | module | subject |
/// |---|---|
/// | `address` | addresses of devices, as a user writes them |
/// | `links` | the links to attached devices, and opening of one; `wire` carries frames |
/// | `holder` | the program that has a link open |
/// | `discovery` | the devices that are attached |
/// | `usb` | the bulk endpoints of a stylus, and of a virtual one |
/// | `error` | failures, refusals, and differences of version between device and host |
/// | `Device` | every request as a function, with its timeout; `limit` measures it in the device's time |
/// | `upload` | upload of a library, resumed after broken links, and read back; update of the image |
/// | `play` | motions at a fixed rate, keep-alives, and why a play counts as failed |
/// | `capture` | the record stream and its losses |
/// | `settings` | settings as a user writes and reads them, and what follows from a change |
///
/// A link serves one program at a time. A second one is refused, and the first goes on; a stylus has two links.
///
/// Over TCP and the serial port a frame is COBS-encoded and ends with a zero byte; over USB it is a bulk transfer.
///
/// Invariant: nothing here fits or evaluates a model, and nothing here prints.
pub mod link {
    mod address;

    /// The record stream: the codes of the device's converters at each tick, which of them were lost, and the physical
    /// values that the codes stand for.
    pub mod capture {
        mod calibration;
        mod contiguous;
        mod stream;

        pub use calibration::{Calibration, Level, Loss};
        pub(crate) use contiguous::mend;
        pub use contiguous::{Capture, capture};
        pub use stream::{Arrival, Stream};
    }

    /// One device: each request is a function that waits for the answer until a timeout.
    ///
    /// `connection` opens the link and carries requests; the other modules add the requests to
    /// [`Device`](device::Device).
    mod device {
        mod connection;
        mod requests;
        mod transfers;

        pub use connection::{Device, Timeouts};
        pub(super) use requests::Blocks;
        pub use requests::{SlotContent, TextureEntry};
    }

    pub mod discovery;
    mod error;
    mod holder;
    mod limit;
    mod links;
    pub mod play;
    pub mod settings;
    pub mod upload;
    pub mod usb;
    mod wire;

    pub use address::LinkAddress;
    pub use device::{Device, SlotContent, TextureEntry, Timeouts};
    pub use error::{LinkError, Mismatch, Result};
    pub use wire::{BrokenFrame, FrameDecoder};
}

/// Procedures that a person carries out with a stylus. Each makes several requests over a [`link`].
///
/// | module | subject |
/// |---|---|
/// | `self_test` | measurements of the device, compared with limits |
/// | `calibrate` | values of the coil, and zeros and scales of the sensors, measured and verified |
/// | `response` | the actuator's response: measured, equalised, proved and checked; headroom of a library |
/// | `set` | a recording set that grows trial by trial |
/// | `strokes` | recordings of a free hand, with its motion |
///
/// Invariant: nothing here prints or asks; a person's answers are arguments.
pub mod procedures {
    /// Calibration of a stylus: the coil's measured values, checked against each other, and its sensors, measured.
    ///
    /// The device cannot measure its coil, because it has no current sense. So resistance, amplifier gain and power
    /// limit are measured by a person, and [`Coil`](calibrate::Coil) says what follows from them. The sensors' codes
    /// without force and acceleration are measured by the device itself, with their noise, and measured again after
    /// they were set. The scale of the force comes from known weights ([`ForceScale`](calibrate::ForceScale)), the
    /// scale of the path from a known distance ([`PathScale`](calibrate::PathScale)).
    pub mod calibrate {
        mod coil;
        mod force;
        mod path;
        mod rest;

        pub use coil::Coil;
        pub use force::{ForceFault, ForceScale, Weighed, order};
        pub use path::{PathFault, PathScale, Travel};
        pub use rest::{AtRest, acceleration_zeros, verify};
    }

    pub mod response;
    pub mod self_test;
    pub mod set;
    pub mod strokes;
}
