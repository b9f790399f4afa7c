//! The USB core OTG2 in device mode, whose FIFOs the firmware fills and empties, at 0x4008 0000 (chapter 57), and a
//! host at the other end of the cable.
//!
//! | What | Section |
//! |---|---|
//! | `GRSTCTL`: resets and flushes are done at once, the AHB is idle | 57.14 |
//! | Pull-up while `GCCFG.PWRDWN` is set, `DCTL.SDIS` is clear and the session is valid by `GOTGCTL` | 57.14 |
//! | One interrupt line, a level: `GINTSTS`, `GINTMSK`, `GAHBCFG.GINTMSK`, `DAINT`, `DAINTMSK` | 57.14 |
//! | and the endpoints' flags and masks, `DIEPEMPMSK` | 57.14 |
//! | The receive FIFO of `GRXFSIZ` words: entries popped by `GRXSTSP`, data read through any window | 57.14, 57.15 |
//! | A transmit FIFO per endpoint, of `DIEPTXFx` words; `DTXFSTSx` | 57.14 |
//! | `DxEPCTLx`, `DxEPTSIZx`: enable, disable, NAK, stall, packet and byte counts, data toggles | 57.14, 57.15 |
//! | An OUT transfer ends with its last packet or one that is not full; the endpoint answers NAK from then on | 57.15 |
//! | A SETUP is taken despite NAK and stall if the receive FIFO has room; it ends the stall of endpoint 0, | 57.15 |
//! | sets both NAKs, and is complete with the next token to the endpoint | 57.15 |
//! | A packet whose toggle is not due is acknowledged and dropped | USB 2.0, 8.6 |
//! | A reset of the bus disables all endpoints but endpoint 0 and changes nothing else of them | 57.14, 57.15 |
//! | Suspend after 3 ms of silence, with or without a cable, as the pull-up is the device's own; resume | 57.14 |
//! | Nothing is understood while the 48 MHz are off by more than 0.25 % | USB 2.0, 7.1.11 |
//! | A reset of the part or by `RCC_AHB1RSTR` clears all of it | 8.7.29 |
//!
//! Where the manual is not clear, the model chooses the alternative that is harder for the firmware: an IN endpoint
//! that is enabled stays enabled over a reset of the bus and over a SETUP, and its FIFO keeps its content. In one point
//! the model follows the drivers that work on such parts instead of the manual: an OUT endpoint answers according to
//! its NAK only, not to `EPENA` and the packet count, because embassy's driver does not change those for endpoint 0.
//!
//! Left out: host mode, OTG and its change of roles, DMA, high speed and the ULPI, isochronous endpoints and the end of
//! a periodic frame, remote wakeup, LPM, battery charging, the sensing of VBUS, and the clock cycles that a reset or a
//! flush takes. The run's report says so if the firmware asks for DMA or host mode (`told`).
//!
//! The emulator has no windows for the FIFOs. So the core's registers and FIFOs together are one window at
//! [`WINDOW_BASE`], to which `core.rs` redirects the accesses to [`BASE`].

/// The core itself: registers, FIFOs and endpoints, without a bus and without time. The bus passes the packets on the
/// wire to it, and receives the handshakes.
pub mod core {
    mod access;
    mod bus;
    mod state;

    pub use super::{Handshake, InAnswer, Pid};
    pub use state::{Core, RegisterMisuse};
}

/// The host at the other end of the cable: its root port and its controller, in virtual time.
///
/// | What | USB 2.0 |
/// |---|---|
/// | 12 Mbit/s, frames of 1 ms after a start of frame; no transaction crosses a frame's end | 7.1.11, 8.4.3, 11.3 |
/// | A transaction lasts its packets' bits, data with the worst bit stuffing (7/6) | 5.11.3, 7.1.9 |
/// | and the longest turnaround between its packets | 7.1.18 |
/// | Control, bulk IN and bulk OUT, one transfer of a pipe at a time, pipes in turn | 5.5, 5.8, 8.5 |
/// | Data toggles at both ends; a packet that arrives twice is acknowledged and dropped | 8.6 |
/// | NAK: tried again without limit; STALL: the transfer ends | 8.4.5 |
/// | No answer or a broken one: three attempts, then the transfer ends | 10.2.6 |
/// | Reset, suspend by silence, resume; a cable that is pulled | 7.1.7 |
///
/// Packets are broken at random, at a rate and from a seed. A token or data packet that breaks on its way to the device
/// is not answered. After a broken handshake, host and device disagree on what happened.
///
/// While the device would refuse everything that is due, no token is sent and none is counted, because the firmware
/// cannot notice the difference. The next token is sent at the instant at which it would have been sent otherwise. Left
/// out: low and high speed, hubs, isochronous and interrupt transfers, and the host's software, which is in `usb_host`.
pub mod host {
    mod bus;
    mod state;
    mod transfer;

    pub use state::{Host, Mishap, RESET_NS, Traffic};
    pub use transfer::{Completion, PACKET_BYTES, Transfer, TransferError, TransferId};
}

#[expect(missing_docs, reason = "the names are the manual's")]
pub mod registers;

use core::Core;
use std::num::NonZeroU64;

use host::Host;
use rigless::device::{DeviceContext, ErasedDevice, InterruptChange, Level, RegisterFile, RequestChange};
use rigless::soc::{Gate, RegisterSpec, Width, Window};
use rigless::time::{EventId, VirtualNanos};

/// Address at which the firmware accesses the core (table 8).
pub const BASE: u64 = 0x4008_0000;
/// Length of the core's registers and FIFOs, bytes.
pub const BYTES: u64 = 0x4_0000;
/// Address of the model, in a range that the part does not use.
pub const WINDOW_BASE: u64 = 0x5F00_0000;
/// Name of the window.
pub const WINDOW: &str = "OTG2";
/// The emulator's instance that receives a reset by the clock controller.
pub const GLOBAL: &str = "OTG2_HS_GLOBAL";

/// Position of the core's interrupt (table 148: 101, OTG_FS global).
const INTERRUPTS: &[u16] = &[101];

/// The window, as the emulator's bus needs it.
pub fn window() -> Window {
    let size = NonZeroU64::new(BYTES).expect("not zero");
    Window::new(WINDOW, WINDOW_BASE, size)
        .gated(Gate::by("RCC", "AHB1ENR", "USB2OTGHSEN"))
        .raising(INTERRUPTS)
}

/// The core, the cable and the host.
#[derive(Debug)]
pub struct Usb {
    /// The core.
    pub core: Core,
    /// The host.
    pub host: Host,
    due: Option<(u64, EventId)>,
    asserted: bool,
    layout: &'static [RegisterSpec],
}

impl Usb {
    /// The core after power-on, with the cable out. `layout` is the window's layout, by which the emulator identifies
    /// it.
    pub fn new(layout: &'static [RegisterSpec]) -> Self {
        Self {
            core: Core::default(),
            host: Host::default(),
            due: None,
            asserted: false,
            layout,
        }
    }

    /// Makes the host's software do `work`, and then serves the bus.
    pub fn drive<T>(&mut self, context: &mut DeviceContext<'_>, work: impl FnOnce(&mut Host, u64) -> T) -> T {
        let done = work(&mut self.host, context.now().0);
        self.settle(context);
        done
    }

    /// Resets the core. The host and its transfers stay as they are.
    pub fn core_reset(&mut self) {
        self.core = Core::default();
    }

    /// Handles a reset of the part, after which no scheduled event comes.
    pub fn part_reset(&mut self, context: &mut DeviceContext<'_>) {
        self.due = None;
        self.asserted = false;
        self.core_reset();
        self.settle(context);
    }

    fn settle(&mut self, context: &mut DeviceContext<'_>) {
        let due_ns = self.host.advance(context.now().0, &mut self.core);
        match (due_ns, self.due) {
            (Some(due_ns), Some((at_ns, _))) if due_ns == at_ns => {}
            (Some(due_ns), _) => {
                self.due = Some((due_ns, context.schedule(VirtualNanos(due_ns))));
            }
            // An event that is no longer needed still comes, and does nothing.
            (None, _) => self.due = None,
        }
        for (register, reason) in self.core.take_told() {
            context.tell(register, reason);
        }
        let wanted = self.core.interrupt();
        if wanted != self.asserted {
            self.asserted = wanted;
            context.interrupt(0, Level::from(wanted));
        }
    }
}

impl ErasedDevice for Usb {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.layout
    }

    fn read(&mut self, _row: usize, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) -> Option<u64> {
        None
    }

    fn write(&mut self, _row: usize, _value: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {}

    fn on_event(&mut self, event: EventId, _registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.due.take_if(|(_, due)| *due == event).is_some() {
            self.settle(context);
        }
    }

    fn on_request(&mut self, _request: RequestChange, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
    }

    fn on_interrupt(
        &mut self,
        _change: InterruptChange,
        _registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) {
    }

    fn on_clock(&mut self, _hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {}

    fn reset(&mut self) {
        self.core_reset();
    }

    fn on_access(&mut self, _token: u64, _value: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
    }

    fn on_refused(&mut self, _token: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {}

    fn read_window(&mut self, offset: u64, _width: Width, context: &mut DeviceContext<'_>) -> u64 {
        // The read sees what has happened on the bus until now, even without an event since.
        self.host.advance(context.now().0, &mut self.core);
        let value = self.core.read(offset);
        self.settle(context);
        u64::from(value)
    }

    fn write_window(&mut self, offset: u64, _width: Width, value: u64, context: &mut DeviceContext<'_>) {
        self.core.write(offset, value as u32);
        self.settle(context);
    }

    fn peek_window(&self, offset: u64, _width: Width, _now: VirtualNanos) -> Option<u64> {
        Some(u64::from(self.core.peek(offset)))
    }
}

/// The data packet's identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pid {
    /// A packet with an even number.
    Data0,
    /// A packet with an odd number.
    Data1,
}

impl Pid {
    /// The identifier of the next packet.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Data0 => Self::Data1,
            Self::Data1 => Self::Data0,
        }
    }
}

/// Handshake of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// The packet was accepted.
    Ack,
    /// The device cannot accept or send a packet at present.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}

/// Answer of a device to an IN token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InAnswer {
    /// A data packet, which awaits its handshake.
    Data(Pid, Vec<u8>),
    /// The device cannot send a packet at present.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
}
