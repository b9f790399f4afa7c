//! Part of a recording's file, at the file's own sample rate.

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};
use stylus_dsp::high_pass;

use super::defects::{Defects, Timing, Truncation};
use super::rate::SampleRate;
use super::unit::{Stated, Unscaled};

/// Part of a file that is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Start of the part, s from the beginning of the file.
    pub start_s: f64,
    /// Longest duration of the part, s; infinite to the end of the file.
    pub duration_s: f64,
}

impl Cut {
    /// The whole file.
    pub const WHOLE: Self = Self {
        start_s: 0.0,
        duration_s: f64::INFINITY,
    };

    /// Returns the first frame and the one after the last, at `rate_hz`.
    pub(super) fn frames(&self, rate_hz: f64) -> (usize, usize) {
        let first = (self.start_s * rate_hz).round() as usize;
        let count = (self.duration_s * rate_hz).round() as usize;
        (first, first.saturating_add(count))
    }
}

/// Samples of a file at its own sample rate, from the cut's first frame on.
#[derive(Clone, Debug)]
pub struct Source {
    /// Sample rate of the file.
    pub rate: SampleRate,
    /// Frame of the file at which the channels begin.
    pub first_frame: usize,
    /// One to three channels of equal length.
    pub channels: Vec<Vec<f64>>,
    /// Time of each sample, s, if they are uneven.
    pub times_s: Option<Vec<f64>>,
    /// Lengths, if the file ends before the length that its header states.
    pub truncation: Option<Truncation>,
    /// Units that the header names.
    pub(super) stated: Stated,
    /// Kind of the samples, if they are in m/s² only if something else states so.
    pub unscaled: Option<Unscaled>,
    /// Changes made in reading beyond what the file states, one line each.
    pub remarks: Vec<String>,
    /// Faults in the times.
    pub timing: Timing,
}

/// What is known about the samples from the file, a list or an option.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Account {
    /// Changes to the samples in reading, such as a conversion of units, one line each.
    pub remarks: Vec<String>,
    /// Contradictions and gaps in the information about the unit, one line each.
    pub doubts: Vec<String>,
    /// Kind of the samples, if nothing states their acceleration.
    pub unscaled: Option<Unscaled>,
    /// True if a header, a list or an option states the acceleration of a sample of 1.
    pub has_scale: bool,
}

/// The samples of a trial.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One to three axes of equal length, m/s²: at [`SAMPLE_RATE_HZ`], unless another rate was asked for.
    pub axes: Vec<Vec<f64>>,
    /// The file's own sample rate, rounded to whole hertz, or the sensor's own if the file holds its values, Hz.
    pub source_rate_hz: f64,
    /// Findings in the samples at that rate, before conversion.
    pub defects: Defects,
    /// What is known about the samples.
    pub account: Account,
}

impl Samples {
    /// Returns the fraction of the power of axes at [`SAMPLE_RATE_HZ`] that is the motion of hand or rig; see
    /// [`slow_share`](high_pass::slow_share).
    pub fn slow_share(&self) -> f64 {
        high_pass::slow_share(&self.axes, f64::from(SAMPLE_RATE_HZ))
    }
}
