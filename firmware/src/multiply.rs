//! The kernel's inner loops in instructions of ARMv7E-M that no compiler finds by itself.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::Rotation;

/// The arithmetic of a Cortex-M4 and M7.
///
/// Instructions and their operands: ARM DDI 0403E, chapter A7; cycles of the Cortex-M4: ARM DDI 0439D, table 3-1.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

/// Stages of one turn of [`CortexM`]'s loop: their backward signals are loaded two at a time.
const TURN_STAGES: usize = 4;

/// Two stages, of 21 instructions: five loads of a word a stage take two and a half, and each of the two sums takes two multiplications,
/// one step that truncates toward zero and one that doubles. A stage's forward signal ends in the register of the other sum, so
/// that two stages bring it back.
macro_rules! two_stages {
    () => {
        concat!(
            "ldrd {lower}, {upper}, [{backward}, #-8]!\n",
            "ldmdb {rotation}!, {{r0, r1, r2}}\n",
            "smull {low}, {other}, r0, {forward}\n",
            "smlal {low}, {other}, r2, {upper}\n",
            "smull {low}, {forward}, r1, {forward}\n",
            "smlal {low}, {forward}, r0, {upper}\n",
            "add {other}, {other}, {other}, lsr #31\n",
            "add {forward}, {forward}, {forward}, lsr #31\n",
            "qadd {other}, {other}, {other}\n",
            "qadd {forward}, {forward}, {forward}\n",
            "str {forward}, [{backward}, #8]\n",
            "ldmdb {rotation}!, {{r0, r1, r2}}\n",
            "smull {low}, {forward}, r0, {other}\n",
            "smlal {low}, {forward}, r2, {lower}\n",
            "smull {low}, {other}, r1, {other}\n",
            "smlal {low}, {other}, r0, {lower}\n",
            "add {forward}, {forward}, {forward}, lsr #31\n",
            "add {other}, {other}, {other}, lsr #31\n",
            "qadd {forward}, {forward}, {forward}\n",
            "qadd {other}, {other}, {other}\n",
            "str {other}, [{backward}, #4]\n",
        )
    };
}

impl Arithmetic for CortexM {
    /// SMLALD: one instruction, one cycle.
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

    /// 11 instructions a stage and, on a Cortex-M4 without wait states, 15 cycles.
    #[inline]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        let (turns, rest) = rotations.as_chunks::<TURN_STAGES>();
        let stages = turns.as_flattened().len();
        // The stages beyond whole turns come first, as the last stages do.
        let mut forward = Portable::rotate(rest, &mut backward[stages..], forward);
        if stages == 0 {
            return forward;
        }
        let turns = turns.as_flattened().as_ptr_range();
        let ends = backward[..=stages].as_mut_ptr_range();
        // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads rotations n - 1 to 0, three words each (`Rotation` is
        // `repr(C)` of three), reads words n - 1 to 0 of `backward`, and writes words n to 1: it begins at the end of
        // `rotations` and at word n, the slice of n + 1 words less one, and runs until the first rotation is done. All words are
        // aligned, as LDRD and LDM want them; all registers are named, Q and the flags are said to change, the stack is not used.
        #[expect(unsafe_code, reason = "a compiler's loop is a quarter longer")]
        unsafe {
            asm!(
                "2:",
                two_stages!(),
                two_stages!(),
                "cmp {rotation}, {first}",
                "bne 2b",
                rotation = inout(reg) turns.end => _,
                first = in(reg) turns.start,
                backward = inout(reg) ends.end.sub(1) => _,
                forward = inout(reg) forward,
                other = out(reg) _,
                low = out(reg) _,
                lower = out(reg) _,
                upper = out(reg) _,
                out("r0") _,
                out("r1") _,
                out("r2") _,
                options(nostack),
            );
        }
        forward
    }
}
