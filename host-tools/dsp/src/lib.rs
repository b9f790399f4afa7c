//! Signal processing: spectra, linear prediction, and the conditioning and reduction of three axes to one.
//!
//! Invariant: slices in, numbers out. No files, no progress, no bytes of a library. Of the library's format, only types
//! and limits are used, and of the command line, only the names of the reductions.

pub mod autocorrelation;
pub mod binomial;
pub mod equaliser;
pub mod fourier;
pub mod high_pass;
pub mod line_spectral_frequencies;
pub mod linear_prediction;
pub mod liveliness;
pub mod log_spectrum;
pub mod model;
pub mod model_error;
pub mod motion_law;
pub mod reduction;
pub mod response;
pub mod spectrum;
pub mod sums;

/// Runs `work` with AVX2 instructions if this processor has them. Only code that is inlined into `work` is compiled for
/// AVX2.
///
/// The order of the sums is the same with and without AVX2, and no multiplication is fused with an addition. So the
/// results are the same to the bit.
#[inline(always)]
pub fn wide<T>(work: impl FnOnce() -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    if let Some(instructions) = pulp::x86::V3::try_new() {
        return instructions.vectorize(work);
    }
    work()
}
