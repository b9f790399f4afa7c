//! Signals for the converter's pins, and the scales of the sensors on the board. The scales are the defaults of a
//! device whose settings were never changed, so the image reads the force and the path that a motion specifies.
//!
//! [`ActuatedPins`] have a plant between the output's pin and the accelerometer's pins. It stands for amplifier, coil
//! and hand. The plant advances in steps as long as one code of the converter. A new code begins a step, because the
//! codes come at exactly that interval. A pin that nothing drives counts as mid-scale, because the amplifier's input
//! holds it there.

use std::fmt;

use model_format::link::Setting;
use stylus_board::Board;
use stylus_plant::Plant;

use crate::model::adc::Pins;
use crate::model::dac::Output;
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

/// Duration of a step, nanoseconds.
const STEP_NS: u64 = 25_000;
/// The output's code at mid-scale, and the number of its codes.
const OUTPUT_MID_SCALE: f64 = 2048.0;
const OUTPUT_CODES: f64 = 4096.0;

/// Pins on which the accelerometer of a plant is connected. All other channels are read from `others`.
#[derive(Debug)]
pub struct ActuatedPins {
    /// Channels of axes and force.
    inputs: [u8; 4],
    plant: Plant,
    others: Box<dyn Pins>,
    volts: f64,
    enabled: bool,
    /// Instant that the plant has reached, nanoseconds.
    now_ns: u64,
}

impl ActuatedPins {
    /// Connects the accelerometer of `plant` on `board`; `others` has all other channels.
    pub fn new(board: &Board, plant: Plant, others: Box<dyn Pins>) -> Self {
        Self {
            inputs: board.inputs,
            plant,
            others,
            volts: 0.0,
            enabled: false,
            now_ns: 0,
        }
    }

    fn go_on(&mut self, until_ns: u64) {
        while self.now_ns + STEP_NS <= until_ns {
            self.plant.step(self.volts, self.enabled);
            self.now_ns += STEP_NS;
        }
    }
}

impl Pins for ActuatedPins {
    fn code(&mut self, channel: u8, at_ns: u64) -> u16 {
        let Some(axis) = self.inputs[..3].iter().position(|&of| of == channel) else {
            return self.others.code(channel, at_ns);
        };
        self.go_on(at_ns);
        let volts = self.plant.accelerometer_volts()[axis];
        let code = f64::from(MID_SCALE) + volts / REFERENCE_VOLTS * FULL_SCALE;
        code.round().clamp(0.0, FULL_SCALE) as u16
    }

    fn follow(&mut self, output: Output, enabled: bool) {
        self.go_on(output.at_ns);
        self.now_ns = self.now_ns.max(output.at_ns);
        let code = output.code.map_or(OUTPUT_MID_SCALE, f64::from);
        self.volts = (code - OUTPUT_MID_SCALE) / OUTPUT_CODES * REFERENCE_VOLTS;
        self.enabled = enabled;
    }
}
