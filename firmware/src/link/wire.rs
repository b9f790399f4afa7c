//! Frames of postcard-rpc to the host, over either wire.

use postcard_rpc::header::{VarHeader, VarKeyKind};
use postcard_rpc::server::{WireTx, WireTxErrorKind};
use serde::Serialize;

use crate::link::counters::{self, Counters};
use crate::link::outlet::{Frame, Outlet};
use crate::link::{serial, usb};

/// Length of keys on the wire: they are sent whole.
pub const KEY_KIND: VarKeyKind = VarKeyKind::Key8;

/// Writes header and message into `frame` and returns their length.
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

/// Outlet of the serial link.
pub static SERIAL: Outlet<serial::Sender> = Outlet::new(&counters::SERIAL);

/// Outlet of the USB link.
pub static USB: Outlet<usb::Sender> = Outlet::new(&counters::USB);

/// Wire that a frame takes to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// USART3.
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
