//! A plant between the output's pin and the accelerometer's pins. It stands for amplifier, coil and hand.
//!
//! The plant advances in steps as long as one code of the converter. A new code begins a step, because the codes come
//! at exactly that interval. A pin that nothing drives counts as mid-scale, because the amplifier's input holds it
//! there.

use stylus_board::Board;
use stylus_plant::Plant;

use crate::model::adc::Pins;
use crate::model::dac::Output;
use crate::sensors::{FULL_SCALE, MID_SCALE, REFERENCE_VOLTS};

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
