//! The arithmetic of the processor that the image is built for.

use kernel_vectors::report;

/// The arithmetic in the order for this processor. The other order gives the same bits, at another cost.
#[cfg(cortex_m7)]
pub type Native = stylus_firmware::CortexM7;

/// The arithmetic in the order for this processor. The other order gives the same bits, at another cost.
#[cfg(not(cortex_m7))]
pub type Native = stylus_firmware::CortexM4;

/// The name of [`Native`] in a report.
pub const NAME: &str = if cfg!(cortex_m7) {
    report::CORTEX_M7
} else {
    report::CORTEX_M4
};
