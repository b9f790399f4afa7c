//! Errors that memories have corrected or found: the RAMECC monitors (RM0433 chapter 3) and the flash's counters.
#![expect(unsafe_code, reason = "the PAC has no RAMECC")]

use core::ptr::{read_volatile, write_volatile};

use model_format::link::{ErrorCorrectionValues, RAM_MONITORS};

use crate::flash::errors;

/// Base and number of monitors of RAMECC1 to RAMECC3 (RM0433 tables 7 and 8, section 3.3).
const CONTROLLERS: [(usize, usize); 3] = [(0x5200_9000, 5), (0x4802_3000, 5), (0x5802_7000, 2)];

/// Distance of two monitors, and of the first from the base.
const MONITOR_BYTES: usize = 0x20;

/// `MxSR` after `MxCR` (RM0433 section 3.4).
const STATUS_OFFSET: usize = 4;

/// `ECCELEN`: latches the failing address.
const LATCHES: u32 = 1 << 5;

/// `SEDCF`, `DEDF` and `DEBWDF`.
const FLAGS: u32 = 0b111;

/// Addresses of the monitors' `MxCR`.
fn monitors() -> impl Iterator<Item = usize> {
    CONTROLLERS
        .into_iter()
        .flat_map(|(base, count)| (1..=count).map(move |monitor| base + monitor * MONITOR_BYTES))
}

/// Lets the monitors watch from now on. Errors before, of memory that nobody had written, are forgotten.
pub fn watch() {
    for monitor in monitors() {
        // SAFETY: registers of RAMECC, which only this module touches and which change no memory.
        unsafe {
            write_volatile((monitor + STATUS_OFFSET) as *mut u32, 0);
            write_volatile(monitor as *mut u32, LATCHES);
        }
    }
}

/// Errors since the start.
pub fn errors() -> ErrorCorrectionValues {
    let mut ram = [0; RAM_MONITORS];
    for (status, monitor) in ram.iter_mut().zip(monitors()) {
        // SAFETY: as in `watch`.
        *status = (unsafe { read_volatile((monitor + STATUS_OFFSET) as *const u32) } & FLAGS) as u8;
    }
    let [first, second] = errors::counts();
    ErrorCorrectionValues {
        ram,
        flash_corrected: [first.corrected, second.corrected],
        flash_failed: [first.failed, second.failed],
    }
}
