//! The two links, and how a frame is sent to the host: over the serial port or over USB.
//!
//! A frame that cannot be sent is counted as unsent by its [`Outlet`]. `main` opens both outlets; requests, storage and
//! recording send through [`Wire`]. All of it runs in tasks.

use model_format::link::LinkId;

use crate::link::outlet::{Counters, Outlet, SERIAL_COUNTERS, USB_COUNTERS};
use crate::link::{serial, usb};

/// Outlet of the serial link. Until `main` opens it, frames are dropped and counted as unsent.
pub static SERIAL: Outlet<serial::Sender> = Outlet::new(&SERIAL_COUNTERS);

/// Outlet of the USB link. Until `main` opens it, frames are dropped and counted as unsent.
pub static USB: Outlet<usb::Sender> = Outlet::new(&USB_COUNTERS);

/// A link by which a frame goes to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// The serial port, USART3.
    Serial,
    /// USB bulk.
    Usb,
}

impl Wire {
    /// The wire of `link`, an identifier of the protocol.
    pub const fn of(link: LinkId) -> Self {
        match link {
            LinkId::Serial => Self::Serial,
            LinkId::Usb => Self::Usb,
        }
    }

    /// The protocol's identifier of this wire's link.
    pub const fn id(self) -> LinkId {
        match self {
            Self::Serial => LinkId::Serial,
            Self::Usb => LinkId::Usb,
        }
    }

    /// Counters of this wire's link.
    pub fn counters(self) -> &'static Counters {
        match self {
            Self::Serial => &SERIAL_COUNTERS,
            Self::Usb => &USB_COUNTERS,
        }
    }

    /// Sends a frame, or counts its loss.
    pub async fn send(self, frame: &[u8]) {
        match self {
            Self::Serial => SERIAL.send(frame).await,
            Self::Usb => USB.send(frame).await,
        }
    }
}
