//! Signals for the converter's pins.

use std::fmt;

use crate::model::adc::Pins;

/// The code of half the reference: an accelerometer at rest.
pub const MID_SCALE: u16 = 0x8000;

/// A constant code per channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConstantPins(pub [u16; 20]);

impl Default for ConstantPins {
    fn default() -> Self {
        Self([MID_SCALE; 20])
    }
}

impl Pins for ConstantPins {
    fn code(&mut self, channel: u8, _at_ns: u64) -> u16 {
        self.0
            .get(usize::from(channel))
            .copied()
            .unwrap_or_default()
    }
}

/// Codes given by a function of channel and instant in nanoseconds.
pub struct FunctionPins<F>(pub F);

impl<F> fmt::Debug for FunctionPins<F> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("FunctionPins")
    }
}

impl<F: FnMut(u8, u64) -> u16 + Send> Pins for FunctionPins<F> {
    fn code(&mut self, channel: u8, at_ns: u64) -> u16 {
        (self.0)(channel, at_ns)
    }
}
