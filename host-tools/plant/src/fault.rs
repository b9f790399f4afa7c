//! Faults of a plant.

use serde::{Deserialize, Serialize};

use crate::linear::STEP_S;

/// An axis of the accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// X.
    X,
    /// Y.
    Y,
    /// Z.
    Z,
}

/// A fault; in TOML a table of `[[faults]]` with its `kind` in kebab case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Fault {
    /// A coil that takes current and produces no force.
    DeadCoil,
    /// No current.
    OpenWire,
    /// The coil's two wires exchanged.
    Reversed,
    /// An amplifier that clips early.
    Clipped {
        /// Largest voltage at the coil to either side, V.
        volts: f64,
    },
    /// An accelerometer's axis that stays at its rest voltage, without noise.
    DeadAxis {
        /// The axis.
        axis: Axis,
    },
    /// A loose mount: beyond a gap the moving mass knocks against the body.
    LooseMount {
        /// Displacement of the moving mass at which it begins to knock, m.
        gap_m: f64,
        /// Stiffness of the contact, N/m.
        stiffness_n_per_m: f64,
    },
    /// A spring that stiffens with displacement, so that the resonance rises with the level: its stiffness is the
    /// linear one times 1 + (displacement / `doubles_at_m`)².
    MovingResonance {
        /// Displacement at which the stiffness has doubled, m.
        doubles_at_m: f64,
    },
    /// Hum of the mains.
    Hum {
        /// Frequency of the hum, Hz.
        hz: f64,
        /// Amplitude of the hum at the coil, V.
        coil_volts: f64,
        /// Amplitude of the hum at each output of the accelerometer, V.
        accelerometer_volts: f64,
    },
}

impl Fault {
    /// Returns the voltages of a hum at coil and accelerometer after `steps` steps, V; 0 for any other fault.
    pub(crate) fn hum(&self, steps: u64) -> [f64; 2] {
        match *self {
            Self::Hum {
                hz,
                coil_volts,
                accelerometer_volts,
            } => {
                let phase = (std::f64::consts::TAU * hz * steps as f64 * STEP_S).sin();
                [coil_volts * phase, accelerometer_volts * phase]
            }
            _ => [0.0; 2],
        }
    }
}
