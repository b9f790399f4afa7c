//! Sums of products, for every Cortex-M with the DSP instructions.

use core::arch::asm;

use stylus_kernel::arithmetic::{SUMS, TURN_TAPS, Turn};

/// Two coefficients of three sums, with four samples, of which the first two were loaded before. The sums take turns,
/// so that none waits for its last product.
macro_rules! two_taps {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        concat!(
            "ldrd r8, r9, [r10], #8\n",
            "ldrd ",
            $c,
            ", ",
            $d,
            ", [r11], #8\n",
            "smlal r4, r5, r8, ",
            $a,
            "\n",
            "smlal r2, r3, r8, ",
            $b,
            "\n",
            "smlal r0, r1, r8, ",
            $c,
            "\n",
            "smlal r4, r5, r9, ",
            $b,
            "\n",
            "smlal r2, r3, r9, ",
            $c,
            "\n",
            "smlal r0, r1, r9, ",
            $d,
            "\n",
        )
    };
}

// Six times two taps are a turn, and three sums have six registers.
const _: () = assert!(TURN_TAPS == 6 * 2 && SUMS == 3);

/// The sums of [`stylus_kernel::arithmetic::Arithmetic::sums_of_products`] in 1 5/12 instructions per product. On a
/// Cortex-M4 without wait states these are 2 1/7 cycles.
#[inline]
pub fn sums_of_products(coefficients: &[Turn], samples: &[i32]) -> [i64; SUMS] {
    let taps = coefficients.as_flattened().len();
    let samples = &samples[..taps + SUMS - 1];
    if taps == 0 {
        return [0; SUMS];
    }
    let coefficients = coefficients.as_ptr_range();
    let mut words = [0u32; 2 * SUMS];
    let [low0, high0, low1, high1, low2, high2] = &mut words;
    // SAFETY: with n = `taps`, a positive multiple of 12, the loop reads words 0 to n - 1 of `coefficients`, two at a
    // time, and words 0 to n + 1 of `samples`: two before it, and then two for each two coefficients. All words are
    // aligned, as LDRD requires. It writes no memory except three words of its own on the stack, which it pops (so
    // `nostack` is not claimed). These hold r6 and r7 among others, which the compiler may reserve and which are
    // restored; no operand is in either. All other registers are named; the flags are declared as changed.
    #[expect(unsafe_code, reason = "the compiler's loop has too few registers")]
    unsafe {
        asm!(
            "push {{r6, r7, r12}}",
            "ldrd r6, r7, [r11], #8",
            "2:",
            two_taps!("r6", "r7", "r12", "lr"),
            two_taps!("r12", "lr", "r6", "r7"),
            two_taps!("r6", "r7", "r12", "lr"),
            two_taps!("r12", "lr", "r6", "r7"),
            two_taps!("r6", "r7", "r12", "lr"),
            two_taps!("r12", "lr", "r6", "r7"),
            "ldr r8, [sp, #8]",
            "cmp r10, r8",
            "bne 2b",
            "pop {{r6, r7, r12}}",
            inout("r10") coefficients.start => _,
            inout("r11") samples.as_ptr() => _,
            inout("r12") coefficients.end => _,
            inout("r0") *low0,
            inout("r1") *high0,
            inout("r2") *low1,
            inout("r3") *high1,
            inout("r4") *low2,
            inout("r5") *high2,
            out("r8") _,
            out("r9") _,
            out("lr") _,
            options(readonly),
        );
    }
    let [low0, high0, low1, high1, low2, high2] = words;
    [(low0, high0), (low1, high1), (low2, high2)]
        .map(|(low, high)| i64::from(high as i32) << 32 | i64::from(low))
}
