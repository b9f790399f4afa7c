//! The accelerometer: directions, noise, saturation and roll-off of its axes.

use crate::chance::Chance;
use crate::fault::{Axis, Fault};
use crate::linear::{STEP_HZ, STEP_S};
use crate::parameters::{Accelerometer, Parameters};

/// The state of an accelerometer.
#[derive(Clone, Debug)]
pub struct Sensor {
    parameters: Accelerometer,
    faults: Vec<Fault>,
    /// The actuator's direction in the accelerometer's axes.
    direction: [f64; 3],
    chance: Chance,
    /// Input of each low-pass at the last step, m/s².
    before: [f64; 3],
    /// Output of each low-pass after the last step, and after the step before. The sensor shows the latter, so it has a
    /// delay of one step.
    filtered: [[f64; 3]; 2],
    steps: u64,
}

impl Sensor {
    /// Creates a sensor at rest. `seed` determines its noise.
    pub fn new(parameters: &Parameters, seed: u64) -> Self {
        let accelerometer = parameters.accelerometer;
        Self {
            parameters: accelerometer,
            faults: parameters.faults.clone(),
            direction: direction(&accelerometer),
            chance: Chance(seed),
            before: [0.0; 3],
            filtered: [[0.0; 3]; 2],
            steps: 0,
        }
    }

    /// Advances the sensor by one step, at the end of which the body has this `acceleration`, m/s².
    pub fn step(&mut self, acceleration: f64) {
        // Standard deviation per step of white noise with a density of one.
        let root_band = (STEP_HZ / 2.0).sqrt();
        self.filtered[1] = self.filtered[0];
        for axis in 0..3 {
            let noise = self.parameters.noise_m_s2_per_root_hz[axis] * root_band;
            let most = self.parameters.saturation_m_s2;
            let input = self.direction[axis] * acceleration + noise * self.chance.normal();
            // The element saturates before the filter, so a clipped peak comes out rounded.
            let input = input.clamp(-most, most);
            // Exact for an input that is linear between two steps.
            let pole = std::f64::consts::TAU * self.parameters.bandwidth_hz[axis];
            let kept = (-pole * STEP_S).exp();
            let slope = (input - self.before[axis]) / STEP_S;
            let start = self.filtered[0][axis] - self.before[axis] + slope / pole;
            self.filtered[0][axis] = input - slope / pole + start * kept;
            self.before[axis] = input;
        }
        self.steps += 1;
    }

    /// Returns the voltages of the axes, relative to mid-scale.
    pub fn volts(&self) -> [f64; 3] {
        let hum: f64 = self.faults.iter().map(|fault| fault.hum(self.steps)[1]).sum();
        std::array::from_fn(|axis| {
            let dead = |fault: &Fault| matches!(fault, Fault::DeadAxis { axis: dead } if *dead as usize == axis);
            let rest = self.parameters.rest_volts[axis];
            if self.faults.iter().any(dead) {
                rest
            } else {
                rest + hum + self.filtered[1][axis] * self.parameters.volts_per_m_s2
            }
        })
    }
}

/// The actuator's direction in the accelerometer's axes.
fn direction(accelerometer: &Accelerometer) -> [f64; 3] {
    let tilt = accelerometer.tilt_deg.to_radians();
    let azimuth = accelerometer.azimuth_deg.to_radians();
    let mut direction = [tilt.cos(), tilt.sin() * azimuth.cos(), tilt.sin() * azimuth.sin()];
    direction.rotate_right(match accelerometer.main_axis {
        Axis::X => 0,
        Axis::Y => 1,
        Axis::Z => 2,
    });
    direction
}
