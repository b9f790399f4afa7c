//! Identity of the silicon, its option bytes, and errors that its memories have corrected or found: the RAMECC monitors
//! (RM0433 chapter 3) and the flash's counters.
#![expect(
    unsafe_code,
    reason = "two identities of the part have no register of the PAC, nor has RAMECC"
)]

use core::ptr::{read_volatile, write_volatile};

use embassy_stm32::pac::{DBGMCU, FLASH, RCC, SYSCFG};
use model_format::link::{ChipValues, ErrorCorrectionValues, OptionByteValues, RAM_MONITORS};

use crate::boot::silicon;
use crate::flash::errors;

/// The unique id, three words (RM0433 section 61.1).
const UNIQUE_ID: *const u32 = 0x1FF1_E800 as *const u32;

/// Size of the flash, KB (RM0433 section 61.2).
const FLASH_SIZE: *const u16 = 0x1FF1_E880 as *const u16;

/// Identity of the silicon.
pub fn identity() -> ChipValues {
    RCC.apb4enr().modify(|w| w.set_syscfgen(true));
    let _ = RCC.apb4enr().read();
    // SAFETY: system memory that is always readable, at aligned addresses.
    let (unique_id, flash_kb) = unsafe {
        (
            [0, 1, 2].map(|word| read_volatile(UNIQUE_ID.add(word))),
            read_volatile(FLASH_SIZE),
        )
    };
    ChipValues {
        device: DBGMCU.idc().read().dev_id(),
        revision: silicon::revision().0,
        unique_id,
        flash_kb,
        package: SYSCFG.pkgr().read().pkg(),
    }
}

/// The option bytes in use.
pub fn option_bytes() -> OptionByteValues {
    let banks = [0, 1].map(|bank| FLASH.bank(bank));
    OptionByteValues {
        status: FLASH.optsr_cur().read().0,
        banks_swapped: FLASH.optcr().read().swap_bank(),
        writable_sectors: banks.map(|bank| bank.wpsn_curr().read().wrpsn()),
        read_protected: banks.map(|bank| bank.prar_cur().read().0),
        secure: banks.map(|bank| bank.scar_cur().read().0),
        boot: FLASH.boot_curr().read().0,
    }
}

/// Base and number of monitors of RAMECC1 to RAMECC3 (RM0433 tables 7 and 8, section 3.3).
const CONTROLLERS: [(usize, usize); 3] = [(0x5200_9000, 5), (0x4802_3000, 5), (0x5802_7000, 2)];

/// Bytes from one monitor to the next, and from the base to the first monitor.
const MONITOR_BYTES: usize = 0x20;

/// Offset of `MxSR` from `MxCR`, bytes (RM0433 section 3.4).
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

/// Clears and starts the monitors. Earlier errors are discarded, because they are of memory that nothing had written.
pub fn watch_memories() {
    for monitor in monitors() {
        // SAFETY: these are registers of RAMECC, which only this module uses and which change no memory.
        unsafe {
            write_volatile((monitor + STATUS_OFFSET) as *mut u32, 0);
            write_volatile(monitor as *mut u32, LATCHES);
        }
    }
}

/// Errors since the start.
pub fn memory_errors() -> ErrorCorrectionValues {
    let mut ram = [0; RAM_MONITORS];
    for (status, monitor) in ram.iter_mut().zip(monitors()) {
        // SAFETY: as in `watch_memories`.
        *status = (unsafe { read_volatile((monitor + STATUS_OFFSET) as *const u32) } & FLAGS) as u8;
    }
    let [first, second] = errors::counts();
    ErrorCorrectionValues {
        ram,
        flash_corrected: [first.corrected, second.corrected],
        flash_failed: [first.failed, second.failed],
    }
}
