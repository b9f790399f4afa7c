//! embassy's driver of the USB core, protected from what makes it fail (embassy-usb-synopsys-otg 0.3.3, embassy-usb
//! 0.6.0).
//!
//! Invariant: no host, whatever it sends or leaves out, makes the device panic, wait forever, or lose a frame
//! unnoticed.
//!
//! What a host may do, and how it is handled here:
//! - **A request to an endpoint that does not exist** makes embassy panic. Here the request is stalled ([`control`]).
//! - **A control transfer that begins before the last one ended, or a reset of the bus meanwhile,** makes embassy wait
//!   forever for the end of the last transfer. Here the last transfer is abandoned ([`control`]).
//! - **A cleared halt, or a choice of setting or configuration,** leaves embassy's data toggles as they were, so a
//!   packet is lost (USB 2.0, sections 9.1.1.5 and 9.4.5). Here the toggles are reset.
//! - **A choice of configuration while a packet waits to be fetched** makes embassy flush its FIFO while the endpoint
//!   stays enabled, after which nothing is ever sent. Here the endpoint is disabled first.
//! - **A reset of the bus, or a pulled cable, in the middle of a frame** makes embassy join the sent part to the next
//!   frame. Here a new session begins, and both parts of the frame are dropped.
//! - **A suspend followed by a reset while the tasks are busy** makes embassy serve the suspend after the reset, so the
//!   device sleeps through its enumeration. Here the reset clears the suspend.
//! - **A packet right after a reset, while the tasks are busy,** finds the device silent at its old address. Here the
//!   interrupt's handler resets the address.
//!
//! embassy has since fixed the toggles and the late suspend, but has not yet released these fixes.
//!
//! The driver is here: endpoints with sessions, and a bus that begins new sessions.

pub mod control;

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use embassy_futures::poll_once;
use embassy_stm32::interrupt::typelevel::{self, Handler};
use embassy_stm32::pac::USB_OTG_FS;
use embassy_stm32::{peripherals, usb};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_usb::driver::{
    self, Bus as _, Direction, Endpoint, EndpointAddress, EndpointAllocError, EndpointError, EndpointIn, EndpointInfo,
    EndpointOut, EndpointType, Event, Unsupported,
};

use control::{PACKET_BYTES, Pipe, cancel_in};

/// embassy's driver.
type Inner = usb::Driver<'static, peripherals::USB_OTG_FS>;
type InnerBus = <Inner as driver::Driver<'static>>::Bus;
type InnerIn = <Inner as driver::Driver<'static>>::EndpointIn;
type InnerOut = <Inner as driver::Driver<'static>>::EndpointOut;

/// Sessions of an endpoint. A session lasts from one configuration of the endpoint until anything ends it. There is one
/// bulk endpoint in each direction.
pub struct Sessions {
    count: AtomicU32,
    changed: AtomicWaker,
}

/// Sessions of the endpoint to the host.
static IN: Sessions = Sessions::new();

/// Sessions of the endpoint from the host.
static OUT: Sessions = Sessions::new();

impl Sessions {
    const fn new() -> Self {
        Self {
            count: AtomicU32::new(0),
            changed: AtomicWaker::new(),
        }
    }

    fn current(&self) -> u32 {
        self.count.load(Ordering::Acquire)
    }

    /// Ends the session, and every wait in it.
    fn end(&self) {
        // Only the interrupt's handler may write at the same time, and either order results in a new number.
        self.count.fetch_add(1, Ordering::AcqRel);
        self.changed.wake();
    }

    /// Returns the result of `work`, or an error if the session ends first.
    async fn within<T>(
        &self,
        session: u32,
        work: impl Future<Output = Result<T, EndpointError>>,
    ) -> Result<T, EndpointError> {
        let mut work = pin!(work);
        poll_fn(|context| {
            self.changed.register(context.waker());
            if self.current() == session {
                work.as_mut().poll(context)
            } else {
                Poll::Ready(Err(EndpointError::Disabled))
            }
        })
        .await
    }
}

/// Handler that sees resets of the bus and SETUP packets before embassy's handler.
pub struct Watch;

#[expect(
    unsafe_code,
    reason = "handlers of embassy's interrupts are unsafe to call; this one reads registers and counts"
)]
// SAFETY: it requires nothing of its caller.
impl Handler<typelevel::OTG_FS> for Watch {
    // SAFETY: as above.
    unsafe fn on_interrupt() {
        let raised = USB_OTG_FS.gintsts().read();
        // embassy's handler masks the reset until its task has served the reset, so a masked reset is not a new one.
        if raised.usbrst() && USB_OTG_FS.gintmsk().read().usbrst() {
            // The host soon uses address 0, possibly before the task has run (USB 2.0, section 7.1.7.5).
            USB_OTG_FS.dcfg().modify(|w| w.set_dad(0));
            control::bus_was_reset();
            IN.end();
            OUT.end();
        }
        if raised.oepint() && USB_OTG_FS.doepint(0).read().stup() {
            control::setup_came();
        }
    }
}

/// Handler that unmasks resets of the bus after embassy's handler, which masks them while its task serves another
/// event.
pub struct Listen;

#[expect(
    unsafe_code,
    reason = "handlers of embassy's interrupts are unsafe to call; this one clears a mask"
)]
// SAFETY: it requires nothing of its caller.
impl Handler<typelevel::OTG_FS> for Listen {
    // SAFETY: as above.
    unsafe fn on_interrupt() {
        // A pending reset has been seen already, and stays masked until the task has served it.
        if !USB_OTG_FS.gintsts().read().usbrst() {
            USB_OTG_FS.gintmsk().modify(|w| w.set_usbrst(true));
        }
    }
}

/// The driver.
pub struct Driver(pub Inner);

impl driver::Driver<'static> for Driver {
    type EndpointOut = BulkOut;
    type EndpointIn = BulkIn;
    type ControlPipe = Pipe;
    type Bus = Bus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet_bytes: u16,
        interval_ms: u8,
    ) -> Result<BulkOut, EndpointAllocError> {
        let inner = self.0.alloc_endpoint_out(kind, address, packet_bytes, interval_ms)?;
        Ok(BulkOut { inner, session: 0 })
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet_bytes: u16,
        interval_ms: u8,
    ) -> Result<BulkIn, EndpointAllocError> {
        let inner = self.0.alloc_endpoint_in(kind, address, packet_bytes, interval_ms)?;
        Ok(BulkIn { inner })
    }

    fn start(self, packet_bytes: u16) -> (Bus, Pipe) {
        let (bus, control) = self.0.start(packet_bytes);
        (Bus(bus), Pipe::new(control))
    }
}

/// The bus.
pub struct Bus(InnerBus);

impl Bus {
    /// Puts a bulk endpoint into use from the beginning: it holds no earlier packet, and the next packet is DATA0.
    fn begin(&mut self, address: EndpointAddress) {
        let index = address.index();
        match address.direction() {
            Direction::In => {
                IN.end();
                cancel_in(index);
                self.0.endpoint_set_enabled(address, true);
                critical_section::with(|_| {
                    USB_OTG_FS.diepctl(index).modify(|w| w.set_sd0pid_sevnfrm(true));
                });
            }
            Direction::Out => {
                OUT.end();
                critical_section::with(|_| {
                    self.0.endpoint_set_enabled(address, true);
                    // No packet may come until the reader has dropped the earlier packets.
                    USB_OTG_FS.doepctl(index).modify(|w| {
                        w.set_sd0pid_sevnfrm(true);
                        w.set_snak(true);
                    });
                });
            }
        }
    }

    /// Takes a bulk endpoint out of use.
    fn end(&mut self, address: EndpointAddress) {
        let index = address.index();
        match address.direction() {
            Direction::In => {
                cancel_in(index);
                self.0.endpoint_set_enabled(address, false);
                IN.end();
            }
            Direction::Out => {
                // embassy would disable the endpoint, which requires the global OUT NAK first (RM0433 section 57.14,
                // OTG_DOEPCTLx.EPDIS). An endpoint that is not in use receives nothing anyway.
                critical_section::with(|_| {
                    USB_OTG_FS.doepctl(index).modify(|w| {
                        w.set_snak(true);
                        w.set_usbaep(false);
                    });
                });
                OUT.end();
            }
        }
    }

    fn is_in_use(address: EndpointAddress) -> bool {
        match address.direction() {
            Direction::In => USB_OTG_FS.diepctl(address.index()).read().usbaep(),
            Direction::Out => USB_OTG_FS.doepctl(address.index()).read().usbaep(),
        }
    }
}

impl driver::Bus for Bus {
    async fn enable(&mut self) {
        self.0.enable().await;
    }

    async fn disable(&mut self) {
        self.0.disable().await;
    }

    async fn poll(&mut self) -> Event {
        let event = self.0.poll().await;
        if event == Event::Reset {
            USB_OTG_FS.gintsts().write(|w| w.set_usbsusp(true));
        }
        event
    }

    fn endpoint_set_enabled(&mut self, address: EndpointAddress, enabled: bool) {
        if enabled {
            self.begin(address);
        } else {
            self.end(address);
        }
    }

    fn endpoint_set_stalled(&mut self, address: EndpointAddress, stalled: bool) {
        self.0.endpoint_set_stalled(address, stalled);
        if !stalled && Self::is_in_use(address) {
            self.begin(address);
        }
    }

    fn endpoint_is_stalled(&mut self, address: EndpointAddress) -> bool {
        self.0.endpoint_is_stalled(address)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}

/// The endpoint from the host.
pub struct BulkOut {
    inner: InnerOut,
    session: u32,
}

impl Endpoint for BulkOut {
    fn info(&self) -> &EndpointInfo {
        self.inner.info()
    }

    async fn wait_enabled(&mut self) {
        loop {
            self.inner.wait_enabled().await;
            let session = OUT.current();
            if session == self.session {
                return;
            }
            // An unread packet of the previous session would be mistaken for the first packet of this session, which
            // would be lost.
            let mut dropped = [0; PACKET_BYTES];
            let _ = poll_once(self.inner.read(&mut dropped));
            let index = self.inner.info().addr.index();
            critical_section::with(|_| {
                if OUT.current() == session {
                    self.session = session;
                    USB_OTG_FS.doepctl(index).modify(|w| w.set_cnak(true));
                }
            });
        }
    }
}

impl EndpointOut for BulkOut {
    /// Reads one packet of this session. Once the session has ended, the endpoint is disabled until
    /// [`BulkOut::wait_enabled`].
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, EndpointError> {
        OUT.within(self.session, self.inner.read(buffer)).await
    }
}

/// The endpoint to the host.
pub struct BulkIn {
    inner: InnerIn,
}

impl BulkIn {
    /// The present session.
    pub fn session() -> u32 {
        IN.current()
    }
}

impl Endpoint for BulkIn {
    fn info(&self) -> &EndpointInfo {
        self.inner.info()
    }

    async fn wait_enabled(&mut self) {
        self.inner.wait_enabled().await;
    }
}

impl EndpointIn for BulkIn {
    async fn write(&mut self, packet: &[u8]) -> Result<(), EndpointError> {
        IN.within(IN.current(), self.inner.write(packet)).await
    }

    /// Writes all packets in one session.
    async fn write_transfer(&mut self, data: &[u8], ends: bool) -> Result<(), EndpointError> {
        let session = IN.current();
        for packet in data.chunks(PACKET_BYTES) {
            IN.within(session, self.inner.write(packet)).await?;
        }
        if ends && data.len().is_multiple_of(PACKET_BYTES) {
            IN.within(session, self.inner.write(&[])).await?;
        }
        Ok(())
    }
}
