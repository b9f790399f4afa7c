//! A bench that plays waveforms and records them.

use model_format::link::{ProbeThrough, RAIL_CODES, RecordSample, Response, Settings};

use super::{Result, Verdict};
use crate::link::capture::Calibration;

/// A waveform to be played.
#[derive(Clone, Copy, Debug)]
pub struct Probe<'a> {
    /// One period, in steps of 1/32767 of the peak.
    pub codes: &'a [i16],
    /// Peak, m/s².
    pub peak_m_s2: f64,
    /// Periods to be recorded.
    pub periods: usize,
    /// The equaliser that the waveform passes.
    pub through: ProbeThrough,
}

/// The recording of a waveform.
#[derive(Clone, Debug)]
pub struct Played {
    /// Acceleration of the three axes over whole periods, m/s².
    pub axes: [Vec<f64>; 3],
    /// True if a code of the accelerometer was within [`RAIL_CODES`] of an end of the range.
    pub saturated: bool,
    /// True if a limit of the output or the thermal limiter acted.
    pub limited: bool,
}

impl Played {
    /// The recording in physical units.
    pub fn of(samples: &[RecordSample], settings: &Settings, limited: bool) -> Self {
        let calibration = Calibration::new(settings, None);
        let rail = RAIL_CODES;
        let at_rail = |sample: &RecordSample| {
            sample
                .acceleration
                .iter()
                .any(|code| !(rail..=u16::MAX - rail).contains(&code.0))
        };
        let axis = |axis: usize| {
            samples
                .iter()
                .map(|sample| calibration.acceleration(sample)[axis])
                .collect()
        };
        Self {
            axes: [axis(0), axis(1), axis(2)],
            saturated: samples.iter().any(at_rail),
            limited,
        }
    }
}

/// A stylus that plays waveforms and records them.
pub trait ProbedStylus {
    /// The settings in force.
    fn settings(&self) -> &Settings;

    /// Makes `response` the one that [`ProbeThrough::Proposed`] stands for.
    fn propose(&mut self, response: &Response) -> Result<()>;

    /// Plays a waveform and records it.
    fn play(&mut self, probe: &Probe<'_>) -> Result<Played>;

    /// Time for which the device has played, s.
    fn seconds(&self) -> f64;
}

/// Returns the recording of a probe with a peak of `volts`, or the fault that makes it unusable.
pub(super) fn usable(played: Played, volts: f64) -> Result<Played> {
    if played.limited {
        return Err(Verdict::Limited.failure("a limit of the output acted on the probe"));
    }
    if played.saturated {
        let seen = format!("the accelerometer left its range at {volts:.3} V of peak");
        return Err(Verdict::Saturated.failure(seen));
    }
    Ok(played)
}
