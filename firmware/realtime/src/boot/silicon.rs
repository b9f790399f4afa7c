//! Revision of the silicon, and the remedy that an old one needs.
#![expect(unsafe_code, reason = "a register that the register crate lacks")]

use embassy_stm32::pac::DBGMCU;
use model_format::link::SiliconRevision;

/// AXI_TARG7_FN_MOD: issuing overrides of the switch towards the AXI SRAM (RM0433 section 2.2, AXI interconnect
/// registers).
const AXI_SRAM_ISSUING: *mut u32 = 0x5100_8108 as *mut u32;

/// READ_ISS_OVERRIDE of it: one read at a time.
const ONE_READ: u32 = 1;

/// Revision of the silicon (RM0433 section 60.5.8).
pub fn revision() -> SiliconRevision {
    SiliconRevision(DBGMCU.idc().read().rev_id())
}

/// Applies the workaround of ES0392 section 2.2.9 where `revision` needs it: reads of the AXI SRAM, where the library
/// lies, may be corrupted unless they are issued one at a time. To be called before the first of them.
pub fn remedy(revision: SiliconRevision) {
    if revision.misreads_axi_sram() {
        // SAFETY: the register exists on every revision, its clock is always on, and reads that are issued one at a
        // time mean the same.
        unsafe { AXI_SRAM_ISSUING.write_volatile(ONE_READ) };
        cortex_m::asm::dsb();
    }
}
