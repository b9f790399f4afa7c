//! Rate of the codes at the pin.

use crate::SAMPLE_RATE_HZ;

/// Number of codes for the converter per tick. They are put out at equal intervals.
pub const OVERSAMPLING: usize = 8;

/// Codes per second at the pin.
pub const PIN_RATE_HZ: u32 = SAMPLE_RATE_HZ * OVERSAMPLING as u32;
