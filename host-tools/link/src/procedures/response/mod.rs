//! Calibration of the response: how the tip responds to a voltage, the equaliser that makes the tip do what is asked
//! for, and the proof that it does.
//!
//! | module | subject |
//! |---|---|
//! | `bench` | what plays waveforms and records them: a device, or in tests a model |
//! | `identify` | noise at rest, rising levels, the response at three levels, and faults |
//! | `design` | equalisers and absolute level |
//! | `calibrate` | the whole calibration, proved by a second measurement through the proposed equaliser |
//! | `check` | a check of two seconds against the stored response |
//! | `headroom` | what a library demands through the equaliser, and what coil and limits allow |
//!
//! Invariant: nothing is stored here, and every fault has a [`Verdict`] of its own.

mod bench;
mod calibrate;
mod check;
mod design;
mod headroom;
mod identify;
#[cfg(test)]
mod tests;

pub use bench::{DeviceBench, Played, Probe, ProbedStylus};
pub use calibrate::{Calibrated, Flatness, calibrate};
pub use check::{Checked, check};
pub use headroom::{BandHeadroom, Headroom, headroom};
pub use identify::{Identified, Level, Options};

use crate::link::LinkError;

/// Reason why a calibration did not pass. Nothing was changed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// A failure of the link.
    #[error("{0}")]
    Link(#[from] LinkError),
    /// The user has pressed Ctrl-C.
    #[error("interrupted")]
    Interrupted,
    /// A fault of actuator, accelerometer or mounting.
    #[error("{0}")]
    Fault(#[from] Fault),
}

/// A result with a [`Failure`].
pub type Result<T> = std::result::Result<T, Failure>;

/// A fault, and the figures that show it.
#[derive(Clone, Debug, PartialEq, thiserror::Error, serde::Serialize)]
#[error("{}: {seen}; {verdict}", .verdict.name())]
pub struct Fault {
    /// The fault.
    pub verdict: Verdict,
    /// The observation, with its figures.
    pub seen: String,
}

/// A fault of an actuator, its amplifier, its mounting, the accelerometer or the limits, with its remedy in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing moves, and the cause was not measured.
    #[error(
        "measure the resistance at the amplifier's output: if it is none the wire is open, if it is the coil's own the \
         coil is dead or blocked, or the amplifier off"
    )]
    NothingMoves,
    /// Nothing moves, and no current flows.
    #[error("mend the wire between amplifier and coil")]
    OpenWire,
    /// Nothing moves, and the coil is connected.
    #[error("the coil is dead or blocked, or the amplifier is off")]
    DeadCoil,
    /// A positive voltage moves the tip against the accelerometer's positive axis.
    #[error(
        "exchange the coil's wires, or calibrate with --invert if accelerometer or coil are mounted the other way \
         around"
    )]
    Reversed,
    /// The mean gain from 100 to 800 Hz falls with the level.
    #[error("the amplifier or the accelerometer clips: lower hard-limit, or raise the amplifier's supply")]
    Clipped,
    /// An axis of the accelerometer shows nothing, not even noise.
    #[error("check the accelerometer's wiring and supply")]
    DeadAxis,
    /// A motion that was not asked for, and that no resonance explains.
    #[error("something knocks or is loose: tighten the actuator's mount, or lower hard-limit")]
    Loose,
    /// The resonance depends on the level, so that no equaliser holds at all levels.
    #[error("lower hard-limit, or use an actuator with more travel")]
    MovingResonance,
    /// A spectral line while the output is silent.
    #[error("check grounds, shields and the supply of amplifier and accelerometer")]
    Hum,
    /// Noise hides the response.
    #[error("hold the stylus still, check the accelerometer's wiring, or raise hard-limit")]
    Noisy,
    /// Limits of gain, power and voltage leave too little of the band.
    #[error("raise hard-limit or power-limit if the coil bears it, or ask for less with --level")]
    BeyondLimits,
    /// The output gain would be out of its range.
    #[error("check amplifier and coil")]
    OutputGain,
    /// The proof shows a deviation that is too large.
    #[error("hold the stylus as in use, unchanged all the time, and calibrate again")]
    NotFlat,
    /// A limit of the output changed the probe.
    #[error("wait until the coil is cool, then calibrate again")]
    Limited,
    /// A code of the accelerometer was at a rail.
    #[error("check the accelerometer's zero and supply")]
    Saturated,
}

impl Verdict {
    /// Name of the verdict, as in JSON.
    pub fn name(self) -> String {
        let name = serde_json::to_value(self).ok();
        name.and_then(|name| name.as_str().map(str::to_owned))
            .unwrap_or_default()
    }

    /// A fault of this verdict, with the observation that shows it.
    pub fn seen(self, seen: impl Into<String>) -> Fault {
        let seen = seen.into();
        Fault { verdict: self, seen }
    }

    fn failure(self, seen: impl Into<String>) -> Failure {
        Failure::Fault(self.seen(seen))
    }
}
