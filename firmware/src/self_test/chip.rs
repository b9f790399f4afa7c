//! Identity of the silicon, and its option bytes.
#![expect(
    unsafe_code,
    reason = "two identities of the part have no register of the PAC"
)]

use core::ptr::read_volatile;

use embassy_stm32::pac::{DBGMCU, FLASH, RCC, SYSCFG};
use model_format::link::{ChipValues, OptionByteValues};

use crate::boot::silicon;

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
