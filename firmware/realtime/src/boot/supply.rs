//! The supply: the level of the brown-out reset, and a detector above it.
//!
//! Option bytes are read, never written. A supply that the probe could not set right is for a person to see to.

use embassy_stm32::pac::{FLASH, PWR};
use model_format::link::FLASH_SUPPLY_MV;

/// Level of the voltage detector, PLS of PWR_CR1: the output is set below 2.76 V falling, and clear again above 2.86 V
/// (RM0433 section 6.5.3; DS12110, embedded reset and power control block, typical).
const DETECTOR_LEVEL: u8 = 6;

const _: () = assert!(FLASH_SUPPLY_MV == 2_760);

/// Turns the detector on.
pub fn watch() {
    PWR.cr1().modify(|w| w.set_pls(DETECTOR_LEVEL));
    PWR.cr1().modify(|w| w.set_pvde(true));
}

/// Returns true while the supply is below [`FLASH_SUPPLY_MV`].
pub fn is_low() -> bool {
    PWR.csr1().read().pvdo()
}

/// Level of the brown-out reset in the option bytes, 0 to 3; 0 is off (RM0433 section 4.9, BOR_LEV of FLASH_OPTSR_CUR).
pub fn brown_out_level() -> u8 {
    FLASH.optsr_cur().read().bor_lev()
}
