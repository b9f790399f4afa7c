//! The kernel's update, in instructions of ARMv7E-M: means of four nodes' codes, and rotations.
//!
//! A loop has all fourteen registers, r6 and r7 among them, which the compiler may reserve: each begins with a list of
//! its words in memory and restores both.

use core::arch::asm;

use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::rotation::{ANGLE, Rotation, SINES, SPARE_BITS, STEP_BITS, TABLE_STEPS};
use stylus_kernel::theta::{BIAS, Run, TAIL_BIAS};

/// Stages that a loop takes together. Most loops take twice as many per turn, and begin in its middle if that
/// leaves some over.
const TURN: usize = 4;

/// A factor that takes a sum to the index in the table, by a product that loses 32 bits.
const PER_STEP: usize = 1 << (32 - STEP_BITS);

/// The digits of a shifted sum that are its rest.
const REST: usize = (usize::MAX << SPARE_BITS) << (32 - STEP_BITS);

const _: () = assert!(32 - STEP_BITS == 11);

/// Two stages of four nodes, whose codes are in a word for each node: their sums in `r3` and `r0`, to memory. The first
/// three loads follow each other, the fourth waits for a register.
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

/// The fractions of one node, of four stages, times the factor in `$factor`, added to `r0` to `r3`.
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

/// As [`four_fractions`], of codes of one byte, each in the upper half of its half word. `r11` is a mask of these.
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

/// The rotation of the sum in `$sum`, to memory: twelve instructions, in the order of [`Rotation::from_sum`].
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

/// [`Arithmetic::mean_rotations`], by the instructions that multiply a word and half a word.
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

/// Addresses of the first and of the last sum of `rotations`: the last third of their words.
///
/// A rotation is written where sums were that have been read: rotation i ends at word 3 i + 3, and sum i + 1 of n is
/// word 2 n + i + 1.
fn sums_in(rotations: &mut [Rotation]) -> core::ops::Range<usize> {
    let words = rotations.as_mut_ptr_range();
    let stages = rotations.len();
    words.start as usize + 8 * stages..words.end as usize
}

/// Writes the sums of `codes` times `factors` to the last third of the words of `rotations`, a whole number of turns
/// and not none.
fn sums_of_codes(codes: [&[[u8; 2]]; 4], factors: [i32; 4], rotations: &mut [Rotation]) {
    let stages = rotations.len();
    let [a, b, c, d] = codes.map(|codes| codes[..stages].as_ptr() as usize);
    let [fa, fb, fc, fd] = factors.map(|factor| factor as usize);
    let sums = sums_in(rotations);
    let words = [
        a,
        b,
        c,
        d,
        fa,
        fb,
        fc,
        fd,
        sums.start,
        BIAS as usize,
        sums.end,
    ];
    // SAFETY: with n = `stages`, a positive multiple of 4, the loop reads 2 n bytes from the beginning of each of the
    // four slices, which have as many, by loads that need no alignment; and writes the last n of the 3 n words of
    // `rotations` (`Rotation` is `repr(C)` of three words), which are aligned, as STRD requires. It reads `words`, and
    // pushes four words that it takes back (so `nostack` is not claimed). These restore r6 and r7; no operand is in
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
    // four slices, which have as many, by loads that need no alignment; and reads and writes the last n of the 3 n
    // words of `rotations`, which are aligned, as LDM requires. It reads `words` and `factors`, both aligned. It pushes
    // two words and pops them (so `nostack` is not claimed). These restore r6 and r7; no operand is in either. All
    // other registers are named; Q and the flags are declared as changed.
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

/// As [`sums_of_codes`], of codes of one byte.
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
    // four slices, which have as many, by loads that need no alignment; and writes the last n of the 3 n words of
    // `rotations`, which are aligned, as STM requires. It reads `words`. It pushes twelve words and takes them back (so
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

/// Makes `rotations`, a whole number of turns and not none, those of the sums in the last third of their words. Takes
/// 13 instructions per stage.
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
    // and writes all of them, from the first to the last; both are aligned, as LDRD and STM require. By `sums_in` it
    // reads a word before it writes it, and both pointers come to the end at once. It reads the table at the index of
    // each sum and TABLE_STEPS further on: sums of valid nodes are at most a quarter turn, so that the index is
    // -TABLE_STEPS to TABLE_STEPS, and the table has as many words on both sides of `sines` and of `cosines`. It reads
    // `words`, and pushes two words and pops them (so `nostack` is not claimed). These restore r6 and r7; no operand is
    // in either. All other registers are named; the flags are declared as changed.
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
