//! The kernel's inner loops, in instructions of ARMv7E-M that no compiler generates for them.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable, TURN_TAPS, Turn, rotated};
use stylus_kernel::rotation::Rotation;

/// The arithmetic of a Cortex-M4 and M7.
///
/// The instructions and their operands are those of ARM DDI 0403E, chapter A7; the cycles of the Cortex-M4 those of ARM
/// DDI 0439D, table 3-1.
#[derive(Clone, Copy, Debug, Default)]
pub struct CortexM;

/// Stages per turn of [`CortexM`]'s loop, whose backward signals are loaded two at a time.
const TURN_STAGES: usize = 4;

/// Five products of words below `r10` and `r11`, added to `r8` and `r9`. The ten loads of one word take eleven cycles.
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

/// The same five products, with their words loaded by two instructions, which take twelve cycles.
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

/// Two stages in 21 instructions. The five words that a stage loads or stores take two and a half instructions. Each of
/// the two sums per stage takes two multiplications, one step that truncates toward zero and one that doubles. A stage
/// leaves its forward signal in the register of the other sum, so two stages bring it back.
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

/// One stage of a sample with forward signal `$forward`; `$up` is the backward signal that it passes on.
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

/// Two stages of two samples: the first sample's forward signal is `r8`, the second's, a stage behind, `r9`. The
/// rotations of the stage above are in `r3` to `r5`, as those of the lower stage are at the end. The backward signal of
/// the first sample goes to the second in `r7` and not through memory.
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

// One turn of the loop over products takes six times five products loaded singly and twice five loaded at once.
const _: () = assert!(TURN_TAPS == 6 * 5 + 2 * 5);

impl Arithmetic for CortexM {
    /// Takes 2 2/3 instructions per product and, on a Cortex-M4 without wait states, 3 3/8 cycles.
    #[inline]
    fn sum_of_products(coefficients: &[Turn], samples: &[Turn]) -> i64 {
        let turns = coefficients.len().min(samples.len());
        if turns == 0 {
            return 0;
        }
        let coefficients = coefficients[..turns].as_ptr_range();
        let samples = samples[..turns].as_ptr_range();
        let (mut low, mut high) = (0u32, 0u32);
        // SAFETY: with n the number of words of `turns` turns, at least one, the loop reads words n - 1 to 0 of both
        // slices, from their ends down. It writes no memory except three words of its own on the stack, which it pops
        // (so `nostack` is not claimed). These hold r6 and r7 among others, which the compiler may reserve and which
        // are restored; no operand is in either. All other registers are named; the flags are declared as changed.
        // SMLAL's two results live at once, so they are never in one register.
        #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
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

    /// Takes 11 instructions per stage and, on a Cortex-M4 without wait states, 15 cycles.
    #[inline]
    fn rotate(rotations: &[Rotation], backward: &mut [i32], forward: i32) -> i32 {
        let (turns, rest) = rotations.as_chunks::<TURN_STAGES>();
        let stages = turns.as_flattened().len();
        // The stages beyond whole turns are the last ones, which come first.
        let mut forward = Portable::rotate(rest, &mut backward[stages..], forward);
        if stages == 0 {
            return forward;
        }
        let turns = turns.as_flattened().as_ptr_range();
        let ends = backward[..=stages].as_mut_ptr_range();
        // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads rotations n - 1 to 0, three words each
        // (`Rotation` is `repr(C)` of three), reads words n - 1 to 0 of `backward`, and writes words n to 1. It begins
        // at the end of `rotations` and at word n, the last of the slice of n + 1 words, and runs until the first
        // rotation is done. All words are aligned, as LDRD and LDM require. All registers are named, Q and the flags
        // are declared as changed, and the stack is not used.
        #[expect(unsafe_code, reason = "the compiler's loop is a quarter longer")]
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

    /// Takes 9 3/4 instructions per stage and sample and, on a Cortex-M4 without wait states, 11 5/8 cycles.
    #[inline]
    fn rotate_two(
        rotations: &[Rotation],
        backward: &mut [i32],
        [mut first, mut second]: [i32; 2],
    ) -> [i32; 2] {
        let Some((&last, others)) = rotations.split_last() else {
            return [first, second];
        };
        // The last stage of the first sample, and the stages beyond whole turns.
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
            // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads rotation n, which exists because
            // `rotations` holds one more than `others`, and then n - 1 to 0, three words each (`Rotation` is `repr(C)`
            // of three). It reads words n - 1 to 0 of `backward` and writes words n + 1 to 2, all of the slice of n + 2
            // words, whose end minus two is word n. All words are aligned, as LDRD and LDM require. It pushes three
            // words and pops them (so `nostack` is not claimed). These hold r6 and r7 among others, which the compiler
            // may reserve and which are restored; no operand is in either. All other registers are named; Q and the
            // flags are declared as changed.
            #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
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
