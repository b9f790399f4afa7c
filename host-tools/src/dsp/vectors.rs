//! Loops over samples in the processor's widest vectors.
//!
//! The build is for any processor of its kind, so that its own vectors are those that all of them have. What runs
//! through [`wide`] is compiled a second time, for AVX2. The order of the sums is that of the code in both, and no
//! product is fused with a sum, so that the bits are the same.

/// Runs `work` with AVX2 where this processor has it. Only what is inlined into `work` is compiled for it.
#[inline(always)]
pub(crate) fn wide<T>(work: impl FnOnce() -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    if let Some(instructions) = pulp::x86::V3::try_new() {
        return instructions.vectorize(work);
    }
    work()
}
