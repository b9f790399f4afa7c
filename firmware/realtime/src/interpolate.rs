//! The kernel's update in instructions of ARMv7E-M: weighted means of the codes of four nodes, and the rotations of
//! these means.
//!
//! A loop uses all fourteen registers, including r6 and r7, which the compiler may reserve. So each loop begins by
//! loading a list of its words from memory, and restores both of these registers at its end.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::{ANGLE, Rotation, SINES, SPARE_BITS, STEP_BITS, TABLE_STEPS};
use stylus_kernel::theta::{BIAS, Run, TAIL_BIAS};

/// Stages that a loop processes together. Two of the four loops process twice as many per turn. If the number of stages
/// is not a multiple of that, these loops begin in the middle of a turn.
const TURN: usize = 4;

/// Factor that converts a sum to an index into the table, by a product whose low 32 bits are dropped.
const PER_STEP: usize = 1 << (32 - STEP_BITS);

/// Mask of the bits of a shifted sum that remain after the index is removed.
const REST: usize = (usize::MAX << SPARE_BITS) << (32 - STEP_BITS);

const _: () = assert!(32 - STEP_BITS == 11);

/// Computes the sums of two stages in `r3` and `r0` and stores them. The codes of both stages are in one word for each
/// of the four nodes. The first three loads follow each other; the fourth waits for a register.
macro_rules! two_sums {
    () => {
        concat!(
            "ldr r0, [r4], #4\n",
            "ldr r1, [r5], #4\n",
            "ldr r2, [r6], #4\n",
            "smlawb r3, r8, r0, lr\n",
            "smlawt r0, r8, r0, lr\n",
            "smlawb r3, r9, r1, r3\n",
            "smlawt r0, r9, r1, r0\n",
            "ldr r1, [r7], #4\n",
            "smlawb r3, r10, r2, r3\n",
            "smlawt r0, r10, r2, r0\n",
            "smlawb r3, r11, r1, r3\n",
            "smlawt r0, r11, r1, r0\n",
            "strd r3, r0, [r12], #8\n",
        )
    };
}

/// Adds the fractions of four stages of one node, times the factor in `$factor`, to `r0` to `r3`.
macro_rules! four_fractions {
    ($pointer:literal, $factor:literal) => {
        concat!(
            "ldr r9, [",
            $pointer,
            "], #4\n",
            "sxtb16 r8, r9\n",
            "sxtb16 r9, r9, ror #8\n",
            four_products!($factor, "r8", "r9"),
        )
    };
}

/// Like [`four_fractions`], for codes of one byte, each moved to the upper half of its half word. `r11` is the mask of
/// these upper halves.
macro_rules! four_bytes {
    ($pointer:literal, $factor:literal) => {
        concat!(
            "ldr r9, [",
            $pointer,
            "], #4\n",
            "and r8, r11, r9, lsl #8\n",
            "and r9, r11, r9\n",
            four_products!($factor, "r8", "r9"),
        )
    };
}

macro_rules! four_products {
    ($factor:literal, $even:literal, $odd:literal) => {
        concat!(
            "smlawb r0, ",
            $factor,
            ", ",
            $even,
            ", r0\n",
            "smlawb r1, ",
            $factor,
            ", ",
            $odd,
            ", r1\n",
            "smlawt r2, ",
            $factor,
            ", ",
            $even,
            ", r2\n",
            "smlawt r3, ",
            $factor,
            ", ",
            $odd,
            ", r3\n",
        )
    };
}

/// Computes the rotation of the sum in `$sum` and stores it: twelve instructions, in the order of
/// [`Rotation::from_sum`].
macro_rules! rotation {
    ($sum:literal) => {
        concat!(
            "smmulr r2, ",
            $sum,
            ", r10\n",
            "and ",
            $sum,
            ", r7, ",
            $sum,
            ", lsl #11\n",
            "ldr r3, [r8, r2, lsl #2]\n",
            "ldr r4, [r9, r2, lsl #2]\n",
            "smmulr ",
            $sum,
            ", ",
            $sum,
            ", r11\n",
            "asr r5, ",
            $sum,
            ", #1\n",
            "smmlsr r6, r5, r3, r4\n",
            "smmlar r5, r5, r4, r3\n",
            "smmlsr r2, ",
            $sum,
            ", r5, r4\n",
            "smmlar r3, ",
            $sum,
            ", r6, r3\n",
            "rsb r4, r3, #0\n",
            "stmia r12!, {{r2, r3, r4}}\n",
        )
    };
}

/// [`Arithmetic::mean_rotations`], with the instructions that multiply a word by half a word.
#[inline]
pub fn mean_rotations(run: &Run<'_>, rotations: &mut [Rotation]) {
    let stages = rotations.len() - rotations.len() % TURN;
    if stages > 0 {
        let rotations = &mut rotations[..stages];
        match run {
            Run::Codes(codes) => sums_of_codes(codes.codes, codes.factors, rotations),
            Run::Fine {
                codes,
                fractions,
                factors,
            } => {
                sums_of_codes(codes.codes, codes.factors, rotations);
                add_fractions(*fractions, *factors, rotations);
            }
            Run::Tail { codes, factors } => sums_of_tails(*codes, *factors, rotations),
        }
        turn(rotations);
    }
    if stages < rotations.len() {
        Portable::mean_rotations(&run.after(stages), &mut rotations[stages..]);
    }
}

/// Returns the addresses of the first sum in `rotations` and of the end of the sums, which are the last third of the
/// words of `rotations`.
///
/// A rotation overwrites only sums that have been read: rotation i ends at word 3 i + 3; of n sums, sum i + 1 is word 2
/// n + i + 1.
fn sums_in(rotations: &mut [Rotation]) -> core::ops::Range<usize> {
    let words = rotations.as_mut_ptr_range();
    let stages = rotations.len();
    words.start as usize + 8 * stages..words.end as usize
}

/// Writes the sums of `codes` times `factors` to the last third of the words of `rotations`, whose number is a positive
/// multiple of [`TURN`].
fn sums_of_codes(codes: [&[[u8; 2]]; 4], factors: [i32; 4], rotations: &mut [Rotation]) {
    let stages = rotations.len();
    let [a, b, c, d] = codes.map(|codes| codes[..stages].as_ptr() as usize);
    let [fa, fb, fc, fd] = factors.map(|factor| factor as usize);
    let sums = sums_in(rotations);
    let words = [a, b, c, d, fa, fb, fc, fd, sums.start, BIAS as usize, sums.end];
    // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads 2 n bytes from the beginning of each of the
    // four slices, which are long enough, by loads that need no alignment. It writes the last n of the 3 n words of
    // `rotations` (`Rotation` is `repr(C)` of three words), which are aligned, as STRD requires. It reads `words`, and
    // pushes four words and pops them (so `nostack` is not claimed). The pop restores r6 and r7; no operand is in
    // either. All other registers are named; Q and the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
    unsafe {
        asm!(
            "cmp r2, #0",
            "ldr r1, [r0, #40]",
            "push {{r1, r5, r6, r7}}",
            "ldm r0, {{r4, r5, r6, r7, r8, r9, r10, r11, r12, lr}}",
            "bne 3f",
            "2:",
            two_sums!(),
            two_sums!(),
            "3:",
            two_sums!(),
            two_sums!(),
            "ldr r0, [sp]",
            "cmp r12, r0",
            "bne 2b",
            "pop {{r1, r5, r6, r7}}",
            inout("r0") words.as_ptr() => _,
            out("r1") _,
            inout("r2") stages & TURN => _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            out("r9") _,
            out("r10") _,
            out("r11") _,
            out("r12") _,
            out("lr") _,
        );
    }
}

/// Adds `fractions` times `factors` to the sums in the last third of the words of `rotations`.
fn add_fractions(fractions: [&[u8]; 4], factors: [i32; 4], rotations: &mut [Rotation]) {
    let stages = rotations.len();
    let [a, b, c, d] = fractions.map(|bytes| bytes[..stages].as_ptr() as usize);
    let sums = sums_in(rotations);
    let words = [a, b, c, d, sums.start, sums.end];
    // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads n bytes from the beginning of each of the
    // four slices, which are long enough, by loads that need no alignment. It reads and writes the last n of the 3 n
    // words of `rotations`, which are aligned, as LDM requires. It reads `words` and `factors`, both aligned. It pushes
    // four words and pops them (so `nostack` is not claimed). Two of these restore r6 and r7; no operand is in either.
    // All other registers are named; Q and the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
    unsafe {
        asm!(
            "push {{r6, r7}}",
            "ldm r0, {{r4, r5, r6, r7, r11, r12}}",
            "push {{r10, r12}}",
            "mov r12, r11",
            "2:",
            "ldm r12, {{r0, r1, r2, r3}}",
            "ldr r11, [sp]",
            "ldrd r10, lr, [r11]",
            four_fractions!("r4", "r10"),
            four_fractions!("r5", "lr"),
            "ldrd r10, lr, [r11, #8]",
            four_fractions!("r6", "r10"),
            four_fractions!("r7", "lr"),
            "stmia r12!, {{r0, r1, r2, r3}}",
            "ldr r11, [sp, #4]",
            "cmp r12, r11",
            "bne 2b",
            "pop {{r10, r12}}",
            "pop {{r6, r7}}",
            inout("r0") words.as_ptr() => _,
            inout("r10") factors.as_ptr() => _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            out("r9") _,
            out("r11") _,
            out("r12") _,
            out("lr") _,
        );
    }
}

/// Like [`sums_of_codes`], for codes of one byte.
fn sums_of_tails(codes: [&[u8]; 4], factors: [i32; 4], rotations: &mut [Rotation]) {
    const UPPER_BYTES: u32 = 0xFF00_FF00;
    const START: usize = TAIL_BIAS as usize;
    let stages = rotations.len();
    let [a, b, c, d] = codes.map(|bytes| bytes[..stages].as_ptr() as usize);
    let [fa, fb, fc, fd] = factors.map(|factor| factor as usize);
    let sums = sums_in(rotations);
    let words = [
        START, START, START, START, fa, fb, fc, fd, sums.end, sums.start, a, b, c, d,
    ];
    // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads n bytes from the beginning of each of the
    // four slices, which are long enough, by loads that need no alignment. It writes the last n of the 3 n words of
    // `rotations`, which are aligned, as STM requires. It reads `words`. It pushes twelve words and removes them (so
    // `nostack` is not claimed). Three of them restore r6 and r7 and keep the stack aligned; no operand is in either.
    // All other registers are named; Q and the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
    unsafe {
        asm!(
            "push {{r5, r6, r7}}",
            "ldm r0!, {{r1, r2, r3, r4, r5, r6, r7, r8, r9}}",
            "push {{r1, r2, r3, r4, r5, r6, r7, r8, r9}}",
            "ldm r0, {{r3, r4, r5, r6, r7}}",
            "mov r12, r3",
            "2:",
            "ldm sp, {{r0, r1, r2, r3}}",
            "ldrd r10, lr, [sp, #16]",
            four_bytes!("r4", "r10"),
            four_bytes!("r5", "lr"),
            "ldrd r10, lr, [sp, #24]",
            four_bytes!("r6", "r10"),
            four_bytes!("r7", "lr"),
            "stmia r12!, {{r0, r1, r2, r3}}",
            "ldr r9, [sp, #32]",
            "cmp r12, r9",
            "bne 2b",
            "add sp, sp, #36",
            "pop {{r5, r6, r7}}",
            inout("r0") words.as_ptr() => _,
            inout("r11") UPPER_BYTES => _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            out("r9") _,
            out("r10") _,
            out("r12") _,
            out("lr") _,
        );
    }
}

/// Converts the sums in the last third of the words of `rotations` to rotations. The number of rotations is a positive
/// multiple of [`TURN`]. Takes 13 instructions per stage.
fn turn(rotations: &mut [Rotation]) {
    let sums = sums_in(rotations);
    let sines = SINES[TABLE_STEPS..].as_ptr() as usize;
    let cosines = SINES[2 * TABLE_STEPS..].as_ptr() as usize;
    let words = [
        REST,
        sines,
        cosines,
        PER_STEP,
        ANGLE as usize,
        rotations.as_mut_ptr() as usize,
        sums.start,
    ];
    // SAFETY: with n the number of rotations, a positive multiple of 4, the loop reads the last n of their 3 n words
    // and writes all of them, from the first to the last. All are aligned, as LDRD and STM require. As `sums_in`
    // explains, the loop reads a word before it writes it, and both pointers reach the end at the same time. It reads
    // the table at the index of each sum and TABLE_STEPS further on. Sums of valid nodes are at most a quarter turn, so
    // the index is -TABLE_STEPS to TABLE_STEPS, and the table extends that far before and after `sines` and `cosines`.
    // It reads `words`, and pushes two words and pops them (so `nostack` is not claimed). The pop restores r6 and r7;
    // no operand is in either. All other registers are named; the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
    unsafe {
        asm!(
            "push {{r6, r7}}",
            "cmp r2, #0",
            "ldm r0, {{r7, r8, r9, r10, r11, r12, lr}}",
            "bne 3f",
            "2:",
            "ldrd r0, r1, [lr], #8",
            rotation!("r0"),
            rotation!("r1"),
            "ldrd r0, r1, [lr], #8",
            rotation!("r0"),
            rotation!("r1"),
            "3:",
            "ldrd r0, r1, [lr], #8",
            rotation!("r0"),
            rotation!("r1"),
            "ldrd r0, r1, [lr], #8",
            rotation!("r0"),
            rotation!("r1"),
            "cmp r12, lr",
            "bne 2b",
            "pop {{r6, r7}}",
            inout("r0") words.as_ptr() => _,
            out("r1") _,
            inout("r2") rotations.len() & TURN => _,
            out("r3") _,
            out("r4") _,
            out("r5") _,
            out("r8") _,
            out("r9") _,
            out("r10") _,
            out("r11") _,
            out("r12") _,
            out("lr") _,
        );
    }
}
