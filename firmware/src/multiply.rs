//! The kernel's inner loops in instructions of ARMv7E-M that no compiler finds by itself.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable, TURN_TAPS, Turn, rotated};
use stylus_kernel::rotation::Rotation;

/// The arithmetic of a Cortex-M4 and M7.
///
/// Instructions and their operands: ARM DDI 0403E, chapter A7; cycles of the Cortex-M4: ARM DDI 0439D, table 3-1.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

/// Stages of one turn of [`CortexM`]'s loop: their backward signals are loaded two at a time.
const TURN_STAGES: usize = 4;

/// Five products of words below `r10` and `r11`, added to `r8` and `r9`. Ten loads of a word each take eleven cycles.
macro_rules! five_products_loaded_singly {
    ($a:literal, $b:literal, $c:literal, $d:literal, $e:literal $(, $down:literal)?) => {
        concat!(
            "ldr r0, [r10, #", $a, "]\n",
            "ldr r1, [r10, #", $b, "]\n",
            "ldr r2, [r10, #", $c, "]\n",
            "ldr r3, [r10, #", $d, "]\n",
            "ldr r4, [r10, #", $e, "]", $($down,)? "\n",
            "ldr r5, [r11, #", $a, "]\n",
            "ldr r6, [r11, #", $b, "]\n",
            "ldr r7, [r11, #", $c, "]\n",
            "ldr r12, [r11, #", $d, "]\n",
            "ldr lr, [r11, #", $e, "]", $($down,)? "\n",
            five_products!(),
        )
    };
}

/// The same, loaded by two instructions, which take twelve.
macro_rules! five_products_loaded_at_once {
    () => {
        concat!(
            "ldmdb r10!, {{r0, r1, r2, r3, r4}}\n",
            "ldmdb r11!, {{r5, r6, r7, r12, lr}}\n",
            five_products!(),
        )
    };
}

macro_rules! five_products {
    () => {
        concat!(
            "smlal r8, r9, r0, r5\n",
            "smlal r8, r9, r1, r6\n",
            "smlal r8, r9, r2, r7\n",
            "smlal r8, r9, r3, r12\n",
            "smlal r8, r9, r4, lr\n",
        )
    };
}

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

/// One stage of a sample, whose forward signal is `$forward`, and what it puts up.
macro_rules! stage {
    ($cos:literal, $sin:literal, $neg_sin:literal, $forward:literal, $backward:literal, $up:literal) => {
        concat!(
            "smull r6, ",
            $up,
            ", ",
            $sin,
            ", ",
            $forward,
            "\n",
            "smlal r6, ",
            $up,
            ", ",
            $cos,
            ", ",
            $backward,
            "\n",
            "smull r6, ",
            $forward,
            ", ",
            $cos,
            ", ",
            $forward,
            "\n",
            "smlal r6, ",
            $forward,
            ", ",
            $neg_sin,
            ", ",
            $backward,
            "\n",
            "add ",
            $up,
            ", ",
            $up,
            ", ",
            $up,
            ", lsr #31\n",
            "add ",
            $forward,
            ", ",
            $forward,
            ", ",
            $forward,
            ", lsr #31\n",
            "qadd ",
            $up,
            ", ",
            $up,
            ", ",
            $up,
            "\n",
            "qadd ",
            $forward,
            ", ",
            $forward,
            ", ",
            $forward,
            "\n",
        )
    };
}

/// Two stages of two samples: the first sample's forward signal is `r8`, the second's, a stage behind, `r9`. The rotations of
/// the stage above are in `r3` to `r5`, as those of the lower stage are at the end. What the first sample puts up goes from
/// `r7` to the second and not to memory.
macro_rules! two_stages_of_two {
    () => {
        concat!(
            "ldrd r12, lr, [r11, #-8]!\n",
            "ldmdb r10!, {{r0, r1, r2}}\n",
            stage!("r0", "r1", "r2", "r8", "lr", "r7"),
            stage!("r3", "r4", "r5", "r9", "r7", "lr"),
            "str lr, [r11, #12]\n",
            "ldmdb r10!, {{r3, r4, r5}}\n",
            stage!("r3", "r4", "r5", "r8", "r12", "r7"),
            stage!("r0", "r1", "r2", "r9", "r7", "r12"),
            "str r12, [r11, #8]\n",
        )
    };
}

/// What [`CortexM`]'s loop over products takes in one turn: six times five and twice five.
const _: () = assert!(TURN_TAPS == 6 * 5 + 2 * 5);

impl Arithmetic for CortexM {
    /// Of a product two and two thirds of an instruction and, on a Cortex-M4 without wait states, three and three eighths of a
    /// cycle.
    #[inline]
    fn sum_of_products(coefficients: &[Turn], samples: &[Turn]) -> i64 {
        let turns = coefficients.len().min(samples.len());
        if turns == 0 {
            return 0;
        }
        let coefficients = coefficients[..turns].as_ptr_range();
        let samples = samples[..turns].as_ptr_range();
        let (mut low, mut high) = (0u32, 0u32);
        // SAFETY: with n the words of `turns` turns, at least one, the loop reads words n - 1 to 0 of both slices, from their ends down, and
        // writes no memory but its own three words of stack, which it gives back (so `nostack` is not claimed). r6 and r7,
        // which the compiler may hold for itself, are among them and restored; no operand is in either. All other registers
        // are named; the flags are said to change. SMLAL's two results live at once, so that they are never one register.
        #[expect(unsafe_code, reason = "a compiler's loop has too few registers")]
        unsafe {
            asm!(
                "push {{r6, r7, r12}}",
                "2:",
                five_products_loaded_singly!("-4", "-8", "-12", "-16", "-20"),
                five_products_loaded_singly!("-24", "-28", "-32", "-36", "-40"),
                five_products_loaded_singly!("-44", "-48", "-52", "-56", "-60"),
                five_products_loaded_singly!("-64", "-68", "-72", "-76", "-80"),
                five_products_loaded_singly!("-84", "-88", "-92", "-96", "-100"),
                five_products_loaded_singly!("-104", "-108", "-112", "-116", "-120", "!"),
                five_products_loaded_at_once!(),
                five_products_loaded_at_once!(),
                "ldr r0, [sp, #8]",
                "cmp r10, r0",
                "bne 2b",
                "pop {{r6, r7, r12}}",
                inout("r10") coefficients.end => _,
                inout("r11") samples.end => _,
                inout("r12") coefficients.start => _,
                inout("r8") low,
                inout("r9") high,
                out("r0") _,
                out("r1") _,
                out("r2") _,
                out("r3") _,
                out("r4") _,
                out("r5") _,
                out("lr") _,
                options(readonly),
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

    /// Nine and three quarters of an instruction a stage and sample and, on a Cortex-M4 without wait states, eleven and five eighths
    /// of a cycle.
    #[inline]
    fn rotate_two(
        rotations: &[Rotation],
        backward: &mut [i32],
        [mut first, mut second]: [i32; 2],
    ) -> [i32; 2] {
        let Some((&last, others)) = rotations.split_last() else {
            return [first, second];
        };
        // The first sample's last stage, and the stages beyond whole turns.
        let mut up;
        (first, up) = rotated(last, first, backward[others.len()]);
        backward[rotations.len()] = up;
        let stages = others.len() - others.len() % TURN_STAGES;
        for stage in (stages..others.len()).rev() {
            (first, up) = rotated(rotations[stage], first, backward[stage]);
            (second, up) = rotated(rotations[stage + 1], second, up);
            backward[stage + 2] = up;
        }
        if stages > 0 {
            let ends = rotations[..stages].as_ptr_range();
            let signals = backward[..stages + 2].as_mut_ptr_range();
            // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads rotation n, which is there since `rotations` holds
            // one more than `others`, and then n - 1 to 0, three words each (`Rotation` is `repr(C)` of three); it reads words n - 1 to 0
            // of `backward` and writes words n + 1 to 2, all of the slice of n + 2, whose end less two is word n. All words are
            // aligned, as LDRD and LDM want them. It pushes three words and gives them back (so `nostack` is not claimed); r6 and
            // r7, which the compiler may hold for itself, are among them and restored, and no operand is in either. All other
            // registers are named; Q and the flags are said to change.
            #[expect(unsafe_code, reason = "a compiler's loop has too few registers")]
            unsafe {
                asm!(
                    "push {{r6, r7, lr}}",
                    "ldm r10, {{r3, r4, r5}}",
                    "2:",
                    two_stages_of_two!(),
                    two_stages_of_two!(),
                    "ldr r7, [sp, #8]",
                    "cmp r10, r7",
                    "bne 2b",
                    "pop {{r6, r7, lr}}",
                    inout("r8") first,
                    inout("r9") second,
                    inout("r10") ends.end => _,
                    inout("r11") signals.end.sub(2) => _,
                    inout("lr") ends.start => _,
                    out("r0") _,
                    out("r1") _,
                    out("r2") _,
                    out("r3") _,
                    out("r4") _,
                    out("r5") _,
                    out("r12") _,
                );
            }
        }
        (second, up) = rotated(rotations[0], second, first);
        backward[1] = up;
        [first, second]
    }
}
