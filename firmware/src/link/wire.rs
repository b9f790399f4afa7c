//! The way of a frame to the host: header and message of postcard-rpc, over the serial port or over USB.
//!
//! A frame that cannot be sent is counted as unsent by its [`Outlet`]. `main` opens both outlets; requests, storage and
//! recording send through [`Wire`]. All of it runs in tasks.

use model_format::link::LinkId;
use postcard_rpc::header::{VarHeader, VarKeyKind};
use postcard_rpc::server::{WireTx, WireTxErrorKind};
use serde::Serialize;

use crate::link::counters::{self, Counters};
use crate::link::outlet::{Frame, Outlet};
use crate::link::{serial, usb};

/// Length of a message's key: all 8 bytes of postcard-rpc's hash of path and type.
pub const KEY_KIND: VarKeyKind = VarKeyKind::Key8;

/// Writes header and message into `frame`. Returns their length, bytes; `None` if they do not fit.
fn encode<T: Serialize + ?Sized>(
    header: &VarHeader,
    message: &T,
    frame: &mut Frame,
) -> Option<usize> {
    let (head, rest) = header.write_to_slice(frame)?;
    let head = head.len();
    let body = postcard::to_slice(message, rest).ok()?.len();
    Some(head + body)
}

/// Outlet of the serial link. Until `main` opens it, frames are dropped and counted as unsent.
pub static SERIAL: Outlet<serial::Sender> = Outlet::new(&counters::SERIAL);

/// Outlet of the USB link. Until `main` opens it, frames are dropped and counted as unsent.
pub static USB: Outlet<usb::Sender> = Outlet::new(&counters::USB);

/// A link by which a frame goes to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// The serial port, USART3.
    Serial,
    /// USB bulk.
    Usb,
}

impl Wire {
    /// Counters of this wire's link.
    pub fn counters(self) -> &'static Counters {
        match self {
            Self::Serial => &counters::SERIAL,
            Self::Usb => &counters::USB,
        }
    }

    /// This wire in the protocol's words.
    pub const fn id(self) -> LinkId {
        match self {
            Self::Serial => LinkId::Serial,
            Self::Usb => LinkId::Usb,
        }
    }

    async fn send_with(
        self,
        write: impl FnOnce(&mut Frame) -> Option<usize>,
    ) -> Result<(), WireTxErrorKind> {
        match self {
            Self::Serial => SERIAL.send(write).await,
            Self::Usb => USB.send(write).await,
        }
    }
}

impl WireTx for Wire {
    type Error = WireTxErrorKind;

    async fn send<T: Serialize + ?Sized>(
        &self,
        header: VarHeader,
        message: &T,
    ) -> Result<(), WireTxErrorKind> {
        self.send_with(|frame| encode(&header, message, frame))
            .await
    }

    async fn send_raw(&self, bytes: &[u8]) -> Result<(), WireTxErrorKind> {
        self.send_with(|frame| {
            frame.get_mut(..bytes.len())?.copy_from_slice(bytes);
            Some(bytes.len())
        })
        .await
    }

    /// Does nothing: logs go over RTT, not over a link.
    async fn send_log_str(&self, _kind: VarKeyKind, _text: &str) -> Result<(), WireTxErrorKind> {
        Ok(())
    }

    /// Does nothing: logs go over RTT, not over a link.
    async fn send_log_fmt(
        &self,
        _kind: VarKeyKind,
        _text: core::fmt::Arguments<'_>,
    ) -> Result<(), WireTxErrorKind> {
        Ok(())
    }
}
