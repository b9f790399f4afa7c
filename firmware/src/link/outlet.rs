//! The ends of one link: its receiver, its sender for one frame at a time, and its counters.

use core::cell::Cell;

use critical_section::Mutex as CriticalMutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, with_timeout};
use model_format::link::LinkCounters;

/// Longest time that a frame may take: the longest frame takes 12 ms on the serial wire.
const SEND_LIMIT: Duration = Duration::from_millis(100);

/// Receiver of a link.
pub trait ReceiveFrame {
    /// Receives one frame into `buffer` and returns its length, which is 0 if the bytes received do not decode to a
    /// frame. Returns none if the frame is too long, which is counted, or if the link's session has ended.
    async fn receive_frame(&mut self, buffer: &mut [u8]) -> Option<usize>;
}

/// Sender of a link.
pub trait SendFrame {
    /// Sends one frame; returns false if the link does not accept it.
    async fn send_frame(&mut self, frame: &[u8]) -> bool;
}

/// The sender of a link. One frame is sent at a time.
pub struct Outlet<S> {
    sender: Mutex<ThreadModeRawMutex, Option<S>>,
    counters: &'static Counters,
}

impl<S: SendFrame> Outlet<S> {
    /// An outlet that is not open: its frames are dropped and counted as unsent.
    pub const fn new(counters: &'static Counters) -> Self {
        Self {
            sender: Mutex::new(None),
            counters,
        }
    }

    /// Opens the outlet onto `sender`.
    pub async fn open(&self, sender: S) {
        *self.sender.lock().await = Some(sender);
    }

    /// Sends a frame. If the link is not open or does not accept the frame in time, the loss is counted. The link stays
    /// in use, because the host may come back at any time.
    pub async fn send(&self, frame: &[u8]) {
        let sent = with_timeout(SEND_LIMIT, async {
            match self.sender.lock().await.as_mut() {
                Some(sender) => sender.send_frame(frame).await,
                None => false,
            }
        });
        if !sent.await.unwrap_or(false) {
            self.counters.count(|counters| &mut counters.unsent);
        }
    }
}

/// Counters of one link.
pub struct Counters(CriticalMutex<Cell<LinkCounters>>);

/// Counters of the serial link.
pub static SERIAL_COUNTERS: Counters = Counters::new();

/// Counters of the USB link.
pub static USB_COUNTERS: Counters = Counters::new();

/// Counters of both links: USB, serial.
pub fn all_counters() -> [LinkCounters; 2] {
    [USB_COUNTERS.get(), SERIAL_COUNTERS.get()]
}

impl Counters {
    const fn new() -> Self {
        Self(CriticalMutex::new(Cell::new(LinkCounters {
            frames: 0,
            malformed: 0,
            oversized: 0,
            line_errors: 0,
            unsent: 0,
        })))
    }

    /// Values of the counters.
    fn get(&self) -> LinkCounters {
        critical_section::with(|section| self.0.borrow(section).get())
    }

    /// Adds one to the counter that `which` selects.
    pub fn count(&self, which: impl FnOnce(&mut LinkCounters) -> &mut u32) {
        critical_section::with(|section| {
            let cell = self.0.borrow(section);
            let mut counters = cell.get();
            let counter = which(&mut counters);
            *counter = counter.saturating_add(1);
            cell.set(counters);
        });
    }
}
