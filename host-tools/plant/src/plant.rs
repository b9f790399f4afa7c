//! The plant, step by step.

use std::f64::consts::TAU;

use num_complex::Complex;

use crate::accelerometer::Sensor;
use crate::fault::Fault;
use crate::linear::{Rows, STATES, STEP_S, advance, exponential, steady_state};
use crate::parameters::Parameters;

/// Number of parts of a step if a force is not linear.
const PARTS: u32 = 8;

/// Indices of the states: voltage at the coil, current, velocity and displacement of the body, and velocity and
/// displacement of the moving mass relative to the body.
const VOLTAGE: usize = 0;
const CURRENT: usize = 1;
const BODY_SPEED: usize = 2;
const BODY_AT: usize = 3;
const SPEED: usize = 4;
const AT: usize = 5;
/// Indices of the inputs: voltage of the amplifier's output stage, and a force on the moving mass that reacts on the
/// body.
const STAGE: usize = STATES;
const FORCE: usize = STATES + 1;

/// A plant.
#[derive(Clone, Debug)]
pub struct Plant {
    parameters: Parameters,
    derivatives: Rows,
    /// Matrix that gives the states after a part of a step.
    rows: Rows,
    parts: u32,
    states: [f64; STATES],
    /// Nonlinear force on the moving mass at the end of the last step, N.
    force: f64,
    /// The previous pin voltage, V. The amplifier uses it, which is its delay of one step.
    delayed: f64,
    /// Charge of the high-pass, V.
    high_pass: f64,
    /// Number of steps so far.
    steps: u64,
    /// The step from which on the amplifier is awake; none while its enable is off.
    awake_at: Option<u64>,
    sensor: Sensor,
}

impl Plant {
    /// Creates a plant at rest with its amplifier off. `seed` determines its noise.
    ///
    /// # Panics
    /// [`Parameters::check`] refuses `parameters`.
    pub fn new(parameters: &Parameters, seed: u64) -> Self {
        let checked = parameters.check();
        assert!(checked.is_ok(), "{checked:?}");
        let derivatives = derivatives(parameters);
        let is_bent = |fault: &Fault| matches!(fault, Fault::LooseMount { .. } | Fault::MovingResonance { .. });
        // A linear plant is exact in steps of any length, so it needs no parts.
        let parts = if parameters.faults.iter().any(is_bent) {
            PARTS
        } else {
            1
        };
        Self {
            parameters: parameters.clone(),
            rows: exponential(&derivatives, STEP_S / f64::from(parts)),
            derivatives,
            parts,
            states: [0.0; STATES],
            force: 0.0,
            delayed: 0.0,
            high_pass: 0.0,
            steps: 0,
            awake_at: None,
            sensor: Sensor::new(parameters, seed),
        }
    }

    /// Advances the plant by one code's interval of 25 µs, with `pin_volts` above mid-scale and the amplifier's enable.
    pub fn step(&mut self, pin_volts: f64, enabled: bool) {
        let stage = self.stage_volts(pin_volts, enabled);
        let part_s = STEP_S / f64::from(self.parts);
        for _ in 0..self.parts {
            // The force is taken at the middle of the part, so that to first order it neither adds nor removes energy.
            let at = self.states[AT] + self.states[SPEED] * part_s / 2.0;
            let force = self.bent_force(at);
            self.states = advance(&self.rows, &self.states, [stage, force]);
        }
        self.force = self.bent_force(self.states[AT]);
        self.steps += 1;
        self.sensor.step(self.tip_m_s2());
    }

    /// Voltage that the amplifier's output stage holds for this step.
    fn stage_volts(&mut self, pin_volts: f64, enabled: bool) -> f64 {
        let amplifier = &self.parameters.amplifier;
        let input = std::mem::replace(&mut self.delayed, pin_volts);
        let (kept, mean) = high_pass(amplifier.low_hz);
        // The capacitor charges within the step, so the mean over the step is what the stage passes on.
        let passed = (input - self.high_pass) * mean;
        self.high_pass += (input - self.high_pass) * (1.0 - kept);
        if !enabled {
            self.awake_at = None;
            return 0.0;
        }
        let wake_steps = (amplifier.wake_s / STEP_S).round() as u64;
        let awake_at = self.awake_at.get_or_insert(self.steps + wake_steps);
        if self.steps < *awake_at {
            return 0.0;
        }
        let mut volts = passed * amplifier.gain + amplifier.offset_volts;
        let mut clip = amplifier.clip_volts;
        let mut sign = 1.0;
        for fault in &self.parameters.faults {
            match *fault {
                Fault::Reversed => sign = -sign,
                Fault::Clipped { volts } => clip = clip.min(volts),
                _ => volts += fault.hum(self.steps)[0],
            }
        }
        sign * volts.clamp(-clip, clip)
    }

    /// Returns the nonlinear force on the moving mass at the displacement `at`, N.
    fn bent_force(&self, at: f64) -> f64 {
        let stiffness = self.parameters.coil.stiffness_n_per_m;
        let force = |fault: &Fault| match *fault {
            Fault::MovingResonance { doubles_at_m } => stiffness * at * (at / doubles_at_m).powi(2),
            Fault::LooseMount {
                gap_m,
                stiffness_n_per_m,
            } => stiffness_n_per_m * (at - at.clamp(-gap_m, gap_m)),
            _ => 0.0,
        };
        -self.parameters.faults.iter().map(force).sum::<f64>()
    }

    /// Acceleration of the tip along the actuator's axis, m/s². It is the acceleration of the body, which is rigid.
    pub fn tip_m_s2(&self) -> f64 {
        let row = &self.derivatives[BODY_SPEED];
        let linear: f64 = row.iter().zip(self.states).map(|(a, b)| a * b).sum();
        linear + row[FORCE] * self.force
    }

    /// Voltages of the accelerometer's axes relative to mid-scale, before the converter.
    pub fn accelerometer_volts(&self) -> [f64; 3] {
        self.sensor.volts()
    }

    /// Power that heats the coil, W.
    pub fn coil_watts(&self) -> f64 {
        self.parameters.coil.resistance_ohm * self.states[CURRENT].powi(2)
    }

    /// The transfer function from volts at the pin to m/s² at the tip, at `hz` below half of
    /// [`STEP_HZ`](crate::STEP_HZ).
    ///
    /// The function is exact for the steps of a plant that does not clip, with its delay and the hold of the codes, but
    /// without its faults.
    pub fn response(&self, hz: f64) -> Complex<f64> {
        let amplifier = &self.parameters.amplifier;
        let sound = Parameters {
            faults: Vec::new(),
            ..self.parameters.clone()
        };
        let derivatives = derivatives(&sound);
        let z = Complex::cis(TAU * hz * STEP_S);
        let states = steady_state(&exponential(&derivatives, STEP_S), z);
        let row = &derivatives[BODY_SPEED];
        let tip: Complex<f64> = states.iter().zip(row).map(|(state, of)| state * of).sum();
        let (kept, mean) = high_pass(amplifier.low_hz);
        // At zero frequency without a high-pass, the quotient would be 0 / 0.
        let charge = if kept == 1.0 {
            Complex::from(0.0)
        } else {
            (1.0 - kept) / (z - kept)
        };
        tip * amplifier.gain * mean * (1.0 - charge) / z
    }
}

/// Returns the fraction of its charge that a high-pass with a corner at `hz` keeps over a step, and the mean of its
/// output over a step, per output at the step's begin.
fn high_pass(hz: f64) -> (f64, f64) {
    if hz == 0.0 {
        return (1.0, 1.0);
    }
    let exponent = TAU * hz * STEP_S;
    // `exp_m1`, because the difference of two numbers near 1 would lose digits at low corners.
    ((-exponent).exp(), -(-exponent).exp_m1() / exponent)
}

/// The derivatives of the states by states and inputs.
fn derivatives(parameters: &Parameters) -> Rows {
    let Parameters {
        coil,
        amplifier,
        body,
        hand,
        faults,
        ..
    } = parameters;
    let is_dead = faults.contains(&Fault::DeadCoil);
    let factor = if is_dead { 0.0 } else { coil.force_n_per_a };
    let mut rows = Rows::default();
    let pole = TAU * amplifier.high_hz;
    rows[VOLTAGE][VOLTAGE] = -pole;
    rows[VOLTAGE][STAGE] = pole;
    if !faults.contains(&Fault::OpenWire) {
        rows[CURRENT][VOLTAGE] = 1.0 / coil.inductance_h;
        rows[CURRENT][CURRENT] = -coil.resistance_ohm / coil.inductance_h;
        // The moving mass feels the force -B·i, so the back-EMF is -B·w: otherwise energy would arise from nothing.
        rows[CURRENT][SPEED] = factor / coil.inductance_h;
    }
    // Forces on the body: of the coil, of the spring and damper to the moving mass, and of the grip's spring and
    // damper.
    let body_speed = &mut rows[BODY_SPEED];
    body_speed[CURRENT] = factor;
    body_speed[AT] = coil.stiffness_n_per_m;
    body_speed[SPEED] = coil.damping_n_s_per_m;
    body_speed[BODY_AT] = -hand.stiffness_n_per_m;
    body_speed[BODY_SPEED] = -hand.damping_n_s_per_m;
    body_speed[FORCE] = -1.0;
    body_speed.iter_mut().for_each(|force| *force /= body.mass_kg);
    // Forces on the moving mass: the opposite of all of these but the grip's. The body's acceleration is subtracted,
    // because the displacement is relative to the body.
    let of_body = rows[BODY_SPEED];
    let mass = coil.moving_mass_kg;
    rows[SPEED] = of_body.map(|of_body| -of_body);
    rows[SPEED][CURRENT] -= factor / mass;
    rows[SPEED][AT] -= coil.stiffness_n_per_m / mass;
    rows[SPEED][SPEED] -= coil.damping_n_s_per_m / mass;
    rows[SPEED][FORCE] += 1.0 / mass;
    rows[BODY_AT][BODY_SPEED] = 1.0;
    rows[AT][SPEED] = 1.0;
    rows
}

#[cfg(test)]
mod tests;
