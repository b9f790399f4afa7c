//! The control pipe: requests that embassy would not survive are stalled, and a transfer that its host has given up is given
//! up here too.
//!
//! A host that begins another transfer sends another SETUP packet; the one before is over then, however far it was (USB 2.0,
//! section 5.5.5). So is any transfer after a reset of the bus.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use embassy_futures::poll_once;
use embassy_stm32::peripherals;
use embassy_stm32::usb;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_usb::control::Request;
use embassy_usb::driver::{self, ControlPipe, EndpointError};

use crate::link::otg::core::{PACKET_BYTES, cancel_in};

type Inner =
    <usb::Driver<'static, peripherals::USB_OTG_FS> as driver::Driver<'static>>::ControlPipe;

/// Numbers of the device's endpoints go up to this one.
const LAST_ENDPOINT: u8 = 1;

/// Descriptor types that the device has with an index of zero alone (USB 2.0 table 9-5, and 15, BOS). A device qualifier is
/// not among them: this device has one speed (section 9.6.2).
const SINGLE_DESCRIPTORS: [u8; 3] = [1, 2, 15];

/// The type of string descriptors, which have indices.
const STRING_DESCRIPTOR: u8 = 3;

/// Resets of the bus.
static RESETS: AtomicU32 = AtomicU32::new(0);

/// SETUP packets.
static SETUPS: AtomicU32 = AtomicU32::new(0);

/// Resets before the last SETUP packet.
static RESETS_AT_SETUP: AtomicU32 = AtomicU32::new(0);

/// Wakes what waits for the host to go on with a transfer.
static BROKEN_OFF: AtomicWaker = AtomicWaker::new();

/// A reset of the bus came. Called by the interrupt's handler alone.
pub fn bus_was_reset() {
    RESETS.fetch_add(1, Ordering::Relaxed);
    BROKEN_OFF.wake();
}

/// A SETUP packet came. Called by the interrupt's handler alone.
pub fn setup_came() {
    RESETS_AT_SETUP.store(RESETS.load(Ordering::Relaxed), Ordering::Relaxed);
    SETUPS.fetch_add(1, Ordering::Relaxed);
    BROKEN_OFF.wake();
}

/// What has happened on the bus.
fn now() -> (u32, u32) {
    (
        RESETS.load(Ordering::Relaxed),
        SETUPS.load(Ordering::Relaxed),
    )
}

/// Whether embassy's stack may see the request of this SETUP packet.
fn is_answerable(setup: [u8; 8]) -> bool {
    let [
        kind,
        request,
        value,
        detail,
        index,
        index_high,
        length,
        length_high,
    ] = setup;
    let is_read = kind & 0x80 != 0;
    if is_read && length == 0 && length_high == 0 {
        // embassy would never end it.
        return false;
    }
    match kind & 0x7F {
        // Of the device.
        0x00 if is_read && request == Request::GET_DESCRIPTOR => {
            detail == STRING_DESCRIPTOR || SINGLE_DESCRIPTORS.contains(&detail) && value == 0
        }
        // Of an interface.
        0x01 => index_high == 0,
        // Of an endpoint; endpoint 0 has no halt that a host sets.
        0x02 => {
            let number = index & 0x7F;
            index_high == 0 && number <= LAST_ENDPOINT && (is_read || number != 0)
        }
        _ => true,
    }
}

/// The control pipe.
pub struct Pipe {
    inner: Inner,
    /// What had happened as the transfer under way began.
    began: (u32, u32),
}

impl Pipe {
    /// Around embassy's.
    pub fn new(inner: Inner) -> Self {
        Self {
            inner,
            began: (0, 0),
        }
    }

    /// The next SETUP packet that no reset has made void.
    async fn next(&mut self) -> [u8; 8] {
        poll_fn(|context| {
            let happened = now();
            let has_come = happened.1 != self.began.1;
            if has_come {
                // An answer of the transfer before that nobody fetched.
                cancel_in(0);
            }
            critical_section::with(|_| {
                if now() != happened {
                    // Something more has come meanwhile.
                    context.waker().wake_by_ref();
                    return Poll::Pending;
                }
                if has_come {
                    // A packet of the transfer before that nobody read.
                    let mut dropped = [0; PACKET_BYTES];
                    let _ = poll_once(self.inner.data_out(&mut dropped, true, true));
                }
                let setup = pin!(self.inner.setup()).poll(context);
                if setup.is_pending() {
                    return Poll::Pending;
                }
                self.began = happened;
                if RESETS_AT_SETUP.load(Ordering::Relaxed) == happened.0 {
                    return setup;
                }
                context.waker().wake_by_ref();
                Poll::Pending
            })
        })
        .await
    }
}

/// The outcome of `work`, a part of the transfer that began when `began` had happened; none once its host has given it up.
async fn unless_broken_off<T>(began: (u32, u32), work: impl Future<Output = T>) -> Option<T> {
    let mut work = pin!(work);
    poll_fn(|context| {
        BROKEN_OFF.register(context.waker());
        if now() == began {
            work.as_mut().poll(context).map(Some)
        } else {
            Poll::Ready(None)
        }
    })
    .await
}

impl ControlPipe for Pipe {
    fn max_packet_size(&self) -> usize {
        self.inner.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        loop {
            let setup = self.next().await;
            if is_answerable(setup) {
                return setup;
            }
            self.reject().await;
        }
    }

    async fn data_out(
        &mut self,
        buffer: &mut [u8],
        first: bool,
        last: bool,
    ) -> Result<usize, EndpointError> {
        unless_broken_off(self.began, self.inner.data_out(buffer, first, last))
            .await
            .unwrap_or(Err(EndpointError::Disabled))
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        unless_broken_off(self.began, self.inner.data_in(data, first, last))
            .await
            .unwrap_or(Err(EndpointError::Disabled))
    }

    async fn accept(&mut self) {
        let _ = unless_broken_off(self.began, self.inner.accept()).await;
    }

    async fn reject(&mut self) {
        // A stall that came late would be the next transfer's.
        let _ = unless_broken_off(self.began, self.inner.reject()).await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        let _ = unless_broken_off(self.began, self.inner.accept_set_address(address)).await;
    }
}
