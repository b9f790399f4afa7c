//! Calibration of the response: what the tip does for a voltage, the equaliser that makes it what was asked, and the
//! proof that it does.
//!
//! | module | subject |
//! |---|---|
//! | `bench`, `device` | what plays waveforms and records them: a device, or in tests a model |
//! | `identify` | rest, levels upwards, the response at three levels, and what is wrong with it |
//! | `design` | equalisers and absolute level |
//! | `calibrate` | all of it, proved by a second measurement through the proposed equaliser |
//! | `check` | two seconds against the stored response |
//! | `headroom` | a library times the equaliser against what coil and limits give |
//!
//! Invariant: nothing is stored here before a proof has passed, and every way in which it does not pass is a
//! [`Fault`] of its own.

mod bench;
mod calibrate;
mod check;
mod design;
mod device;
mod headroom;
mod identify;
#[cfg(test)]
mod tests;

pub use bench::{Bench, Played, Probe};
pub use calibrate::{Calibrated, Flatness, calibrate};
pub use check::{Checked, check};
pub use device::DeviceBench;
pub use headroom::{BandHeadroom, Headroom, headroom};
pub use identify::{Identified, Level, Options};

use super::error::LinkError;

/// Reason for which a calibration did not pass. Nothing was changed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The link.
    #[error("{0}")]
    Link(#[from] LinkError),
    /// Ctrl-C.
    #[error("interrupted")]
    Interrupted,
    /// What is wrong with actuator, accelerometer or mounting.
    #[error("{name}: {0}", name = .0.name())]
    Fault(#[from] Fault),
}

/// A result with a [`Failure`].
pub type Result<T> = std::result::Result<T, Failure>;

/// What is wrong with an actuator, its amplifier, its mounting or the accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// Nothing moves.
    #[error(
        "nothing moves at {volts:.3} V of peak: measure the resistance at the amplifier's output; if it is none the wire \
         is open, if it is the coil's own the coil is dead or blocked, or the amplifier off"
    )]
    NothingMoves {
        /// Peak at the pin, V.
        volts: f64,
    },
    /// Nothing moves, and someone has measured that no current flows.
    #[error("nothing moves, and no current flows: mend the wire between amplifier and coil")]
    OpenWire,
    /// Nothing moves, and someone has measured that the coil is connected.
    #[error(
        "nothing moves, and the coil has {ohm} Ω: it is dead or blocked, or the amplifier is off"
    )]
    DeadCoil {
        /// Resistance at the amplifier's output, Ω.
        ohm: f64,
    },
    /// A positive voltage moves the tip against the accelerometer's positive axis.
    #[error(
        "a positive voltage moves the tip against the accelerometer's positive axis: exchange the coil's wires, or \
         calibrate with --invert if accelerometer or coil are mounted the other way around"
    )]
    Reversed,
    /// The gain falls with the level, at all frequencies alike.
    #[error(
        "the gain falls by {loss_db:.1} dB towards {volts:.3} V of peak: the amplifier or the accelerometer clips; lower \
         hard-limit, or raise the amplifier's supply"
    )]
    Clipped {
        /// Loss from the lowest to the highest level, dB.
        loss_db: f64,
        /// Highest peak at the pin, V.
        volts: f64,
    },
    /// An axis of the accelerometer that shows nothing, not even noise.
    #[error(
        "axis {axis} of the accelerometer shows nothing, not even noise: check its wiring and its supply"
    )]
    DeadAxis {
        /// The axis.
        axis: char,
    },
    /// Knocking.
    #[error(
        "{share:.0} % of what moves at {volts:.3} V of peak was not asked for, and came with the level: something \
         knocks or is loose; tighten the actuator's mount, or lower hard-limit"
    )]
    Loose {
        /// Distortion, percent.
        share: f64,
        /// Peak at the pin, V.
        volts: f64,
    },
    /// A resonance that depends on the level.
    #[error(
        "the resonance moves from {low_hz:.1} to {high_hz:.1} Hz with the level, so that no equaliser holds at all \
         levels: lower hard-limit, or use an actuator with more travel"
    )]
    MovingResonance {
        /// At the lowest level, Hz.
        low_hz: f64,
        /// At the highest level, Hz.
        high_hz: f64,
    },
    /// A hum at rest.
    #[error(
        "{m_s2:.2} m/s² of hum at {hz:.1} Hz while nothing is played: check grounds, shields and the supply of amplifier \
         and accelerometer"
    )]
    Hum {
        /// Frequency, Hz.
        hz: f64,
        /// Amplitude, m/s².
        m_s2: f64,
    },
    /// Too much noise.
    #[error(
        "noise leaves only {share:.0} % of the response from 30 to 800 Hz to be trusted at {volts:.3} V of peak: hold the \
         stylus still, check the accelerometer's wiring, or raise hard-limit"
    )]
    Noisy {
        /// Lines that can be trusted, percent.
        share: f64,
        /// Peak at the pin, V.
        volts: f64,
    },
    /// Limits that leave too little.
    #[error(
        "only {low_hz:.0} to {high_hz:.0} Hz can be corrected within the limits of gain, power and voltage: raise \
         hard-limit or power-limit if the coil bears it, or ask for less with --level"
    )]
    BeyondLimits {
        /// Lower edge of what can be corrected, Hz.
        low_hz: f64,
        /// Upper edge, Hz.
        high_hz: f64,
    },
    /// An output gain out of its range.
    #[error(
        "the output gain would be {gain:.2e} V/(m/s²), out of the range of output-gain: check amplifier and coil"
    )]
    OutputGain {
        /// The gain.
        gain: f64,
    },
    /// The proof.
    #[error(
        "through its equaliser the tip is off by {rms_db:.2} dB RMS and {worst_db:.2} dB at worst, level {level_db:+.2} \
         dB: hold the stylus as in use, unchanged all the time, and calibrate again"
    )]
    NotFlat {
        /// RMS deviation from flat, dB.
        rms_db: f64,
        /// Largest deviation, dB.
        worst_db: f64,
        /// Mean level, dB re what was asked.
        level_db: f64,
    },
    /// A stage of the device that changed the probe.
    #[error(
        "a limit of the output acted on the probe: wait until the coil is cool, then calibrate again"
    )]
    Limited,
    /// The converter's range.
    #[error(
        "the accelerometer left its range at {volts:.3} V of peak: check its zero and its supply"
    )]
    Saturated {
        /// Peak at the pin, V.
        volts: f64,
    },
}

impl Fault {
    /// Its name, as JSON has it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::NothingMoves { .. } => "nothing-moves",
            Self::OpenWire => "open-wire",
            Self::DeadCoil { .. } => "dead-coil",
            Self::Reversed => "reversed",
            Self::Clipped { .. } => "clipped",
            Self::DeadAxis { .. } => "dead-axis",
            Self::Loose { .. } => "loose",
            Self::MovingResonance { .. } => "moving-resonance",
            Self::Hum { .. } => "hum",
            Self::Noisy { .. } => "noisy",
            Self::BeyondLimits { .. } => "beyond-limits",
            Self::OutputGain { .. } => "output-gain",
            Self::NotFlat { .. } => "not-flat",
            Self::Limited => "limited",
            Self::Saturated { .. } => "saturated",
        }
    }
}
