//! The amplifier's enable, active high.
//!
//! In every reset the pin floats, so a pull-down on the board must hold it low. `boot/startup.rs` drives it low before
//! anything else runs. The enable is raised last, after mid-scale has been put out for a while (`tick/raising.rs`), and
//! is dropped first whenever the output ends.

use core::sync::atomic::{AtomicBool, Ordering};

use stylus_board::{BOARD, Pin};
use stylus_boot::supply;

const PIN: Pin = BOARD.pins.amplifier;

/// True while the amplifier is to be on.
static WANTED: AtomicBool = AtomicBool::new(false);

/// True while the amplifier is on.
static ON: AtomicBool = AtomicBool::new(false);

/// Requests the amplifier: it is turned on as soon as mid-scale has been put out long enough. Until then the output is
/// mute.
pub fn enable() {
    WANTED.store(true, Ordering::Relaxed);
}

/// Turns the amplifier off at once. It stays off until [`enable`].
pub fn disable() {
    WANTED.store(false, Ordering::Relaxed);
    off_now();
}

/// Returns true while the amplifier is to be on, from [`enable`] to [`disable`].
pub fn is_wanted() -> bool {
    WANTED.load(Ordering::Relaxed)
}

/// Returns true while the amplifier is on.
#[inline(always)]
pub fn is_on() -> bool {
    ON.load(Ordering::Relaxed)
}

/// Returns true while the amplifier is to be on but is not on yet.
#[inline(always)]
pub fn is_to_be_raised() -> bool {
    WANTED.load(Ordering::Relaxed) && !ON.load(Ordering::Relaxed)
}

/// Turns the amplifier on if it is still to be on and the supply holds. The output must be driven at mid-scale.
pub fn raise() {
    critical_section::with(|_| {
        if !supply::is_low() && WANTED.load(Ordering::Relaxed) {
            ON.store(true, Ordering::Relaxed);
            PIN.registers().bsrr().write(|w| w.set_bs(PIN.number, true));
        }
    });
}

/// Turns the amplifier off, whatever state the program is in.
#[inline(always)]
pub fn off_now() {
    // A fault may come before the clock of the port is on.
    PIN.start_clock();
    PIN.registers().bsrr().write(|w| w.set_br(PIN.number, true));
    ON.store(false, Ordering::Relaxed);
}
