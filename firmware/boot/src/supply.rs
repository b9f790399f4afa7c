//! State of the supply, by a voltage detector whose level is above that at which flash can no longer be written.

use stm32_metapac::PWR;

/// Supply below which flash is neither erased nor programmed, and the amplifier's enable neither raised nor held, mV:
/// the falling threshold of [`DETECTOR_LEVEL`]. The rising one is 2.86 V (DS12110, embedded reset and power control
/// block, typical).
pub const LOW_MV: u16 = 2_760;

/// Level of the detector, PLS of PWR_CR1 (RM0433 section 6.5.3).
const DETECTOR_LEVEL: u8 = 6;

/// Turns the detector on.
pub fn watch() {
    PWR.cr1().modify(|w| w.set_pls(DETECTOR_LEVEL));
    PWR.cr1().modify(|w| w.set_pvde(true));
}

/// Returns true while the supply is below [`LOW_MV`].
#[inline(always)]
pub fn is_low() -> bool {
    PWR.csr1().read().pvdo()
}
