//! Frames of postcard-rpc on their way to the host, whichever wire they take.

use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, with_timeout};
use model_format::link::MAX_DEVICE_FRAME_BYTES;
use postcard_rpc::header::{VarHeader, VarKeyKind};
use postcard_rpc::server::{WireTx, WireTxErrorKind};
use serde::Serialize;

use crate::link::counters::{self, Counters};
use crate::link::{serial, usb};

/// How long a frame may take: the longest one takes 12 ms on the serial wire.
const SEND_LIMIT: Duration = Duration::from_millis(100);

/// Length of keys on the wire: they are sent whole.
pub const KEY_KIND: VarKeyKind = VarKeyKind::Key8;

/// One frame before it is sent.
pub type Frame = [u8; MAX_DEVICE_FRAME_BYTES];

/// What takes frames to the host: a link's sending half and its buffer, one frame at a time.
pub struct Outlet<S> {
    inner: Mutex<ThreadModeRawMutex, Option<(S, Frame)>>,
    counters: &'static Counters,
}

/// A link's sending half.
pub trait SendFrame {
    /// Sends one frame; false if the link does not take it.
    async fn send_frame(&mut self, frame: &[u8]) -> bool;
}

impl<S: SendFrame> Outlet<S> {
    /// Not yet open; frames are dropped and counted as unsent.
    pub const fn new(counters: &'static Counters) -> Self {
        Self {
            inner: Mutex::new(None),
            counters,
        }
    }

    /// Opens it.
    pub async fn open(&self, half: S) {
        *self.inner.lock().await = Some((half, [0; MAX_DEVICE_FRAME_BYTES]));
    }

    async fn send(
        &self,
        write: impl FnOnce(&mut Frame) -> Option<usize>,
    ) -> Result<(), WireTxErrorKind> {
        let sent = with_timeout(SEND_LIMIT, async {
            let mut inner = self.inner.lock().await;
            let (half, frame) = inner.as_mut()?;
            let length = write(frame)?;
            half.send_frame(&frame[..length]).await.then_some(())
        });
        if let Ok(Some(())) = sent.await {
            return Ok(());
        }
        // A frame that is lost is counted and the link goes on: it may come back at any moment.
        self.counters.count(|counters| &mut counters.unsent);
        Err(WireTxErrorKind::Other)
    }
}

/// Header and message in `frame`; their length.
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

/// The serial link's outlet.
pub static SERIAL: Outlet<serial::Half> = Outlet::new(&counters::SERIAL);

/// The USB link's outlet.
pub static USB: Outlet<usb::Half> = Outlet::new(&counters::USB);

/// Which way a frame goes to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// USART3.
    Serial,
    /// USB bulk.
    Usb,
}

impl Wire {
    /// What this link counts.
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

    /// Logs go over RTT, not over a link.
    async fn send_log_str(&self, _kind: VarKeyKind, _text: &str) -> Result<(), WireTxErrorKind> {
        Ok(())
    }

    /// Logs go over RTT, not over a link.
    async fn send_log_fmt(
        &self,
        _kind: VarKeyKind,
        _text: core::fmt::Arguments<'_>,
    ) -> Result<(), WireTxErrorKind> {
        Ok(())
    }
}
