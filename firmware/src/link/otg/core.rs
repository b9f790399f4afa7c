//! The USB core itself, below endpoints and control pipe: its packet length, and how a packet to the host is taken
//! back.

use embassy_stm32::pac::USB_OTG_FS;

/// Longest packet of an endpoint at full speed, bytes (USB 2.0, section 5.8.3).
pub const PACKET_BYTES: usize = 64;

/// Number of times that a bit is read which the core clears within some cycles of its clocks (RM0433 section 57.14):
/// far more than it takes, and less than a millisecond.
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

/// Takes back the packet that endpoint `index` was to send. Interrupts stay on while the core does it.
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
