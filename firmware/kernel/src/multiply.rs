//! The one multiplication that a compiler does not find by itself, as a trait: a processor with an instruction for it
//! brings its own, the portable one is the reference.

/// Dual 16-bit multiply-accumulate, which the Cortex-M4 and M7 do in one instruction (SMLALD).
pub trait DualMultiply {
    /// `sum` + low(a)·low(b) + high(a)·high(b), where low and high are the signed halves of a word.
    ///
    /// Exact; wraps only where the 64-bit sum itself overflows, which no valid library's coefficients can bring about.
    fn multiply_accumulate(sum: i64, a: u32, b: u32) -> i64;
}

/// Dual multiplication in plain Rust.
#[derive(Clone, Copy, Debug, Default)]
pub struct Portable;

impl DualMultiply for Portable {
    #[inline(always)]
    fn multiply_accumulate(sum: i64, a: u32, b: u32) -> i64 {
        let low = i32::from(a as i16) * i32::from(b as i16);
        let high = i32::from((a >> 16) as i16) * i32::from((b >> 16) as i16);
        sum.wrapping_add(i64::from(low))
            .wrapping_add(i64::from(high))
    }
}

/// Two 16-bit numbers as one word, the first in the low half.
#[inline(always)]
pub fn pack(pair: [i16; 2]) -> u32 {
    u32::from(pair[0] as u16) | u32::from(pair[1] as u16) << 16
}
