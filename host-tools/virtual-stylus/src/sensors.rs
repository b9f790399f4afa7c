//! Signals for the converter's pins, and the scales of the sensors on the board. The scales are the defaults of a
//! device whose settings were never changed, so the image reads the force and the path that a motion specifies.

use std::fmt;

use model_format::link::Setting;

use crate::model::adc::Pins;
use crate::motion::MotionLine;

/// Code of half the reference voltage, where an accelerometer is at rest.
pub const MID_SCALE: u16 = 0x8000;

/// A constant code per channel; further channels read zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConstantPins(pub [u16; 20]);

impl Default for ConstantPins {
    fn default() -> Self {
        Self([MID_SCALE; 20])
    }
}

impl Pins for ConstantPins {
    fn code(&mut self, channel: u8, _at_ns: u64) -> u16 {
        self.0.get(usize::from(channel)).copied().unwrap_or_default()
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

/// Voltage of the converter's full scale.
pub const REFERENCE_VOLTS: f64 = 3.3;
/// Code of the converter's full scale.
pub const FULL_SCALE: f64 = 65_535.0;

/// The default of `setting`. It is read from its text, because a default such as 0.01 is a little off as an `f32`.
fn default_of(setting: Setting) -> f64 {
    setting
        .spec()
        .default
        .to_string()
        .parse()
        .expect("a number in decimals is a number")
}

/// Newtons per volt of the force sensor.
pub fn newtons_per_volt() -> f64 {
    default_of(Setting::ForcePerVolt)
}

/// Volts of the force sensor if no force acts on it.
pub fn force_zero_volts() -> f64 {
    let volts = default_of(Setting::ForceZero) / FULL_SCALE * REFERENCE_VOLTS;
    (volts * 1e6).round() / 1e6
}

/// Millimetres per count of the encoder.
pub fn mm_per_count() -> f64 {
    default_of(Setting::PathPerCount)
}

/// The force at an instant, N: linear between lines, constant before the first and after the last, and zero without
/// lines.
pub fn force_at(lines: &[MotionLine], time_s: f64) -> f64 {
    let next = lines.partition_point(|line| line.time_s <= time_s);
    match (next.checked_sub(1).and_then(|last| lines.get(last)), lines.get(next)) {
        (Some(last), Some(next)) => {
            let share = (time_s - last.time_s) / (next.time_s - last.time_s);
            last.force_n + share * (next.force_n - last.force_n)
        }
        (Some(only), None) | (None, Some(only)) => only.force_n,
        (None, None) => 0.0,
    }
}
