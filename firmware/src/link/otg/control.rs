//! The control pipe: it stalls requests that would make embassy panic or hang, and ends a transfer that the host has
//! abandoned. The end of this file holds the length of packets, and how a packet to the host is cancelled.
//!
//! A host that begins another transfer sends another SETUP packet, which ends the previous transfer at any stage (USB
//! 2.0, section 5.5.5). A reset of the bus also ends any transfer.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use embassy_futures::poll_once;
use embassy_stm32::pac::USB_OTG_FS;
use embassy_stm32::peripherals;
use embassy_stm32::usb;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_usb::control::Request;
use embassy_usb::driver::{self, ControlPipe, EndpointError};

type Inner = <usb::Driver<'static, peripherals::USB_OTG_FS> as driver::Driver<'static>>::ControlPipe;

/// Largest number of an endpoint of the device.
const LAST_ENDPOINT: u8 = 1;

/// Descriptor types that exist only with index zero (USB 2.0 table 9-5, and 15, BOS). A device qualifier is not among
/// them, because this device has only one speed (section 9.6.2).
const SINGLE_DESCRIPTORS: [u8; 3] = [1, 2, 15];

/// Type of string descriptors, which have indices.
const STRING_DESCRIPTOR: u8 = 3;

/// Number of resets of the bus.
static RESETS: AtomicU32 = AtomicU32::new(0);

/// Number of SETUP packets.
static SETUPS: AtomicU32 = AtomicU32::new(0);

/// Number of resets before the last SETUP packet.
static RESETS_AT_SETUP: AtomicU32 = AtomicU32::new(0);

/// Waker of the task that waits for the host to continue a transfer.
static BROKEN_OFF: AtomicWaker = AtomicWaker::new();

/// Counts a reset of the bus. Called by the interrupt's handler only.
pub fn bus_was_reset() {
    RESETS.fetch_add(1, Ordering::Relaxed);
    BROKEN_OFF.wake();
}

/// Counts a SETUP packet. Called by the interrupt's handler only.
pub fn setup_came() {
    RESETS_AT_SETUP.store(RESETS.load(Ordering::Relaxed), Ordering::Relaxed);
    SETUPS.fetch_add(1, Ordering::Relaxed);
    BROKEN_OFF.wake();
}

/// Numbers of resets and SETUP packets so far.
fn now() -> (u32, u32) {
    (RESETS.load(Ordering::Relaxed), SETUPS.load(Ordering::Relaxed))
}

/// Returns true if embassy's stack can handle the request of this SETUP packet.
fn is_answerable(setup: [u8; 8]) -> bool {
    let [kind, request, value, detail, index, index_high, length, length_high] = setup;
    let is_read = kind & 0x80 != 0;
    if is_read && length == 0 && length_high == 0 {
        // embassy would never end this transfer.
        return false;
    }
    match kind & 0x7F {
        // Requests to the device.
        0x00 if is_read && request == Request::GET_DESCRIPTOR => {
            detail == STRING_DESCRIPTOR || SINGLE_DESCRIPTORS.contains(&detail) && value == 0
        }
        // Requests to an interface.
        0x01 => index_high == 0,
        // Requests to an endpoint. A host cannot halt endpoint 0.
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
    /// Value of [`now`] when the present transfer began.
    began: (u32, u32),
}

impl Pipe {
    /// A pipe around embassy's.
    pub fn new(inner: Inner) -> Self {
        Self { inner, began: (0, 0) }
    }

    /// Returns the next SETUP packet that no reset has invalidated.
    async fn next(&mut self) -> [u8; 8] {
        poll_fn(|context| {
            let happened = now();
            let has_come = happened.1 != self.began.1;
            if has_come {
                // Cancels an answer of the previous transfer that the host has not fetched.
                cancel_in(0);
            }
            critical_section::with(|_| {
                if now() != happened {
                    // Another packet or reset has come meanwhile.
                    context.waker().wake_by_ref();
                    return Poll::Pending;
                }
                if has_come {
                    // Drops an unread packet of the previous transfer.
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

/// Returns the result of `work`, a part of the transfer that began at `began`; none once the host has abandoned the
/// transfer.
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

    async fn data_out(&mut self, buffer: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
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
        // A stall that came late would apply to the next transfer.
        let _ = unless_broken_off(self.began, self.inner.reject()).await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        let _ = unless_broken_off(self.began, self.inner.accept_set_address(address)).await;
    }
}

/// Longest packet of an endpoint at full speed, bytes (USB 2.0, section 5.8.3).
pub const PACKET_BYTES: usize = 64;

/// Largest number of reads of a bit that the core clears within some cycles of its clocks (RM0433 section 57.14). It is
/// far more than the core needs, and takes less than a millisecond.
const READS: u32 = 5_000;

/// Waits until `done`, for at most [`READS`] reads.
fn spin_until(done: impl Fn() -> bool) {
    for _ in 0..READS {
        if done() {
            return;
        }
    }
    defmt::warn!("USB core: a command has not finished in time");
}

/// Cancels the packet that IN endpoint `index` was to send. Interrupts stay on while the USB core disables the
/// endpoint.
pub fn cancel_in(index: usize) {
    critical_section::with(|_| {
        if USB_OTG_FS.diepctl(index).read().epena() {
            USB_OTG_FS.diepctl(index).modify(|w| {
                w.set_snak(true);
                w.set_epdis(true);
            });
        }
    });
    spin_until(|| !USB_OTG_FS.diepctl(index).read().epena());
    critical_section::with(|_| {
        USB_OTG_FS.grstctl().write(|w| {
            w.set_txfflsh(true);
            w.set_txfnum(index as u8);
        });
    });
    spin_until(|| !USB_OTG_FS.grstctl().read().txfflsh());
}
