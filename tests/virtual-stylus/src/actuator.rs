//! A plant between the output's pin and the accelerometer's, in the place of amplifier, coil and hand.
//!
//! The plant goes on in steps of one code's time, and a new code begins a step: the converter's codes come at just that
//! interval. A pin that nothing drives is at mid-scale, as the amplifier's input holds it.

use stylus_plant::Plant;

use crate::model::adc::Pins;
use crate::model::dac::Output;
use crate::sensors::{FULL_SCALE, MID_SCALE, REFERENCE_VOLTS};

/// Channels of the accelerometer's axes.
const AXES: [u8; 3] = [15, 10, 6];
/// Time of a step.
const STEP_NS: u64 = 25_000;
/// Code of the output's mid-scale, and its codes.
const OUTPUT_MID_SCALE: f64 = 2048.0;
const OUTPUT_CODES: f64 = 4096.0;

/// Pins with the accelerometer of a plant; the other channels are those of other pins.
#[derive(Debug)]
pub struct ActuatedPins {
    plant: Plant,
    others: Box<dyn Pins>,
    volts: f64,
    enabled: bool,
    /// Instant up to which the plant has gone.
    now_ns: u64,
}

impl ActuatedPins {
    /// The accelerometer of `plant`, and `others`.
    pub fn new(plant: Plant, others: Box<dyn Pins>) -> Self {
        Self {
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
        let Some(axis) = AXES.iter().position(|&of| of == channel) else {
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
