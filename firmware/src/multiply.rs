//! Dual multiplication by the DSP extension of ARMv7E-M.

use core::arch::asm;

use stylus_kernel::multiply::DualMultiply;

/// Dual multiplication by SMLALD: one instruction, one cycle on a Cortex-M4 and M7 (ARM DDI 0403E, A7.7.138).
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

impl DualMultiply for CortexM {
    #[inline(always)]
    fn multiply_accumulate(sum: i64, a: u32, b: u32) -> i64 {
        let (mut low, mut high) = (sum as u32, (sum >> 32) as u32);
        // SAFETY: SMLALD reads and writes the four registers it names and nothing else: no memory, no stack and no flag, not
        // even Q. RdLo and RdHi are two operands that live at once, so that they are never one register, which alone would be
        // unpredictable. Every core of this target (thumbv7em) has it.
        #[expect(unsafe_code, reason = "an instruction without an intrinsic in core")]
        unsafe {
            asm!(
                "smlald {low}, {high}, {a}, {b}",
                low = inout(reg) low,
                high = inout(reg) high,
                a = in(reg) a,
                b = in(reg) b,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        i64::from(high as i32) << 32 | i64::from(low)
    }
}
