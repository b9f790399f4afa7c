//! The silicon: its revision and the remedy that an old revision needs, the cause of its last reset, and the level of
//! its brown-out reset.
//!
//! Option bytes are only read. If the debug probe could not set them for the supply, a person has to see to it.
#![expect(unsafe_code, reason = "a register that the register crate lacks")]

use embassy_stm32::pac::{DBGMCU, FLASH, RCC};
use model_format::link::{FLASH_SUPPLY_MV, ResetReason, SiliconRevision};
use stylus_app::update;
use stylus_boot::supply;

/// AXI_TARG7_FN_MOD: issuing overrides of the switch towards the AXI SRAM (RM0433 section 2.2, AXI interconnect
/// registers).
const AXI_SRAM_ISSUING: *mut u32 = 0x5100_8108 as *mut u32;

/// READ_ISS_OVERRIDE of that register: one read at a time.
const ONE_READ: u32 = 1;

/// Revision of the silicon (RM0433 section 60.5.8).
pub fn revision() -> SiliconRevision {
    SiliconRevision(DBGMCU.idc().read().rev_id())
}

/// Applies the workaround of ES0392 section 2.2.9 if `revision` needs it: reads of the AXI SRAM, where the library
/// lies, may be corrupted unless they are issued one at a time. Must be called before the first such read.
pub fn remedy(revision: SiliconRevision) {
    if revision.misreads_axi_sram() {
        // SAFETY: the register exists on every revision, its clock is always on, and reads that are issued one at a
        // time mean the same.
        unsafe { AXI_SRAM_ISSUING.write_volatile(ONE_READ) };
        cortex_m::asm::dsb();
    }
}

/// Reads and clears the cause of the last reset (RM0433 section 8.7.38, RCC_RSR).
pub fn take_reset_cause() -> ResetReason {
    let rsr = RCC.rsr();
    let flags = rsr.read().0 >> 21;
    rsr.modify(|w| w.set_rmvf(true));
    update::cause(flags as u8)
}

const _: () = assert!(FLASH_SUPPLY_MV == supply::LOW_MV);

/// Level of the brown-out reset in the option bytes, 0 to 3; 0 is off (RM0433 section 4.9, BOR_LEV of FLASH_OPTSR_CUR).
pub fn brown_out_level() -> u8 {
    FLASH.optsr_cur().read().bor_lev()
}
