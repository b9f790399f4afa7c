//! Turns the amplifier off when the supply falls.
//!
//! The output falls with the supply, while the enable stays above the amplifier's threshold, so the coil would receive
//! the remaining voltage as DC. The voltage detector (`stylus_boot::supply`) sees the fall first, and its interrupt
//! drops the enable. Once the supply is back, the amplifier is raised again like after a start.
#![expect(unsafe_code, reason = "the handler of an interrupt")]

use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::EXTI;

use crate::boot::priority::SUPPLY;
use crate::tick::output::amplifier;

/// Line of the detector's output (RM0433 table 153).
const DETECTOR: usize = 16;

/// Makes the detector's rising edge, which is a falling supply, turn the amplifier off from now on.
pub fn guard() {
    EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR, true));
    EXTI.imr(0).modify(|w| w.set_line(DETECTOR, true));
    // SAFETY: the handler uses only the enable's pin and the detector's flag, and no critical section masks by
    // priority.
    unsafe { SUPPLY.enable() };
}

#[unsafe(no_mangle)]
#[unsafe(link_section = ".itcm.supply")]
extern "C" fn PVD_AVD() {
    amplifier::off_now();
    EXTI.pr(0).write(|w| w.set_line(DETECTOR, true));
}
