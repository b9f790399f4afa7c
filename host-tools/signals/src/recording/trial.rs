//! One recording of a recording set: what is known of it beforehand, and its samples, from a file or from memory.

use std::path::PathBuf;
use std::sync::Arc;

use model_format::limits::MAX_NAME_BYTES;
use model_format::{Provenance, SAMPLE_RATE_HZ};
use serde::{Deserialize, Serialize};
use stylus_dsp::high_pass;
use stylus_support::fnv::Fnv;
use stylus_support::{Error, Result};

use super::defects::{Defects, Timing, Truncation};
use super::rate::{MAX_CHANNELS, SampleRate, length_fault};
use super::times::TimeUnit;
use super::unit::{Stated, Unscaled};

/// Length of a trial of the paper's protocol, s.
pub const TRIAL_DURATION_S: f64 = 2.0;

/// Speed that is assumed for a recording whose speed is not known, mm/s.
pub const NOMINAL_SPEED_MM_S: f64 = 100.0;

/// Force that is assumed for a recording whose force is not known, N.
pub const NOMINAL_FORCE_N: f64 = 1.0;

/// Returns what is wrong with a texture's name, according to the rules of lists and libraries; `None` if it is valid.
pub fn texture_fault(name: &str) -> Option<String> {
    if name.trim().is_empty() {
        Some("must not be empty".into())
    } else if name.contains(char::is_control) {
        Some("must not have a control character, such as the end of a line".into())
    } else if name.len() > MAX_NAME_BYTES {
        Some(format!(
            "has {} bytes, and must have at most {MAX_NAME_BYTES}",
            name.len()
        ))
    } else {
        None
    }
}

/// One recording of one texture at one speed and force.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The file, or the name of samples in memory.
    pub file: PathBuf,
    /// Name of the texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Tangential speed, mm/s, before speeds of its texture were moved to nominal values; `None` if none were moved.
    pub measured_speed_mm_s: Option<f64>,
    /// Normal force, N.
    pub force_n: f64,
    /// Acceleration of a sample of 1, the full scale of a WAV file's integers, m/s². If not given, the scale in the
    /// file's header is used, or 1.
    pub scale_m_s2: Option<f64>,
    /// Start of the used part, s.
    pub start_s: f64,
    /// Longest duration of the used part, s; if not given, the part extends to the end of the file.
    pub duration_s: Option<f64>,
    /// Sample rate of the file, Hz, which counts before that of its header or its times.
    pub sample_rate_hz: Option<f64>,
    /// Unit of a CSV file's times; if not given, it is determined from the column's name or from the steps.
    pub time_unit: Option<TimeUnit>,
    /// True if a CSV file's samples are evenly spaced, regardless of their times; `None` if nothing states it.
    pub has_even_times: Option<bool>,
    /// Origin of the samples: recorded or simulated.
    pub provenance: Provenance,
    /// Samples in memory, which are used instead of the file.
    pub held: Option<Arc<HeldSamples>>,
}

impl Trial {
    /// Returns the trial that consists of the whole recording `file` of `texture` at a speed, mm/s, and a force, N. Its
    /// samples are in the unit of the file's header, or in m/s².
    pub fn of(file: impl Into<PathBuf>, texture: impl Into<String>, speed_mm_s: f64, force_n: f64) -> Self {
        Self {
            file: file.into(),
            texture: texture.into(),
            speed_mm_s,
            measured_speed_mm_s: None,
            force_n,
            scale_m_s2: None,
            start_s: 0.0,
            duration_s: None,
            sample_rate_hz: None,
            time_unit: None,
            has_even_times: None,
            provenance: Provenance::Recorded,
            held: None,
        }
    }

    /// Speed at which spectral lines are computed, mm/s: the measured speed, if the trial has one.
    pub fn line_speed_mm_s(&self) -> f64 {
        self.measured_speed_mm_s.unwrap_or(self.speed_mm_s)
    }

    /// Returns whether both speed and force are above zero. Otherwise the stylus is silent.
    pub fn is_in_motion_and_contact(&self) -> bool {
        self.speed_mm_s > 0.0 && self.force_n > 0.0
    }

    /// Returns whether the trial contains only the noise of the rig in motion, without contact with a surface.
    pub fn is_of_the_rig(&self) -> bool {
        self.speed_mm_s > 0.0 && self.force_n <= 0.0
    }
}

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

/// Samples of a recording that was never in a file, at their original rate. A fit treats them like samples from a WAV
/// file of 64-bit floats.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldSamples {
    rate: SampleRate,
    /// Rate at which the samples were recorded, Hz, if they were brought to another one.
    recorded_hz: Option<f64>,
    channels: Vec<Vec<f64>>,
    unscaled: Option<Unscaled>,
    /// Units by the names of columns.
    stated: Stated,
    remarks: Vec<String>,
}

impl HeldSamples {
    /// Creates samples of one to three axes of equal length, at `rate_hz`, Hz. A sample of 1 is the trial's scale,
    /// m/s². `are_integers` states that the samples were integers before they were divided by their full scale.
    ///
    /// # Errors
    /// The number of axes is not possible, axes have different lengths or no samples, there are more samples than a
    /// recording may have, or the rate is not possible for a recording.
    pub fn new(rate_hz: f64, channels: Vec<Vec<f64>>, are_integers: bool) -> Result<Self> {
        let refused = |problem: String| Err(Error::Request(format!("samples: {problem}")));
        let rate = match SampleRate::new(rate_hz, "give the recording's own rate") {
            Ok(rate) => rate,
            Err(fault) => return refused(fault),
        };
        let frames = channels.first().map_or(0, Vec::len);
        if !(1..=MAX_CHANNELS).contains(&channels.len()) {
            return refused(format!(
                "{} channels: give 1 to {MAX_CHANNELS}, one per axis",
                channels.len()
            ));
        }
        if channels.iter().any(|channel| channel.len() != frames) {
            return refused("axes of different lengths: give them in one array".into());
        }
        if frames == 0 {
            return refused("there are none: give at least one".into());
        }
        if let Some(fault) = length_fault(frames as f64, channels.len()) {
            return refused(fault);
        }
        Ok(Self {
            rate,
            recorded_hz: None,
            channels,
            unscaled: are_integers.then_some(Unscaled::OfFullScale),
            stated: Stated::default(),
            remarks: Vec::new(),
        })
    }

    /// Returns the samples with what the `source` of a table states about them.
    pub(super) fn stated(self, source: &Source) -> Self {
        Self {
            unscaled: source.unscaled,
            stated: source.stated.clone(),
            remarks: source.remarks.clone(),
            ..self
        }
    }

    /// Returns the samples as ones that were recorded at `recorded_hz`, Hz, and hold no more than that rate carries.
    #[must_use]
    pub fn recorded_at(self, recorded_hz: f64) -> Self {
        Self {
            recorded_hz: Some(recorded_hz),
            ..self
        }
    }

    /// Rate at which the samples were recorded, Hz, if it is another one than theirs.
    pub(super) fn recorded_hz(&self) -> Option<f64> {
        self.recorded_hz
    }

    /// Sample rate, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.rate.hz()
    }

    /// Samples of each axis.
    pub fn channels(&self) -> &[Vec<f64>] {
        &self.channels
    }

    /// Hash of rate and samples, by which the record of a fit identifies them.
    pub fn content(&self) -> u64 {
        let rate = Fnv::default()
            .then(&self.rate_hz().to_le_bytes())
            .then(self.stated.units.as_bytes());
        let all = self.channels.iter().fold(rate, |hash, channel| {
            // Without lengths, samples moved from one axis to the next would have the same hash.
            let length = (channel.len() as u64).to_le_bytes();
            channel.iter().fold(hash.then(&length), |hash, sample| {
                hash.then_words(&sample.to_le_bytes())
            })
        });
        all.value()
    }

    /// Returns the part of the samples within `cut`.
    pub(super) fn source(&self, cut: &Cut) -> Source {
        let (first, end) = cut.frames(self.rate_hz());
        let part = |channel: &Vec<f64>| {
            let end = end.min(channel.len());
            // The part may begin after the last sample.
            channel[first.min(end)..end].to_vec()
        };
        Source {
            rate: self.rate,
            first_frame: first,
            channels: self.channels.iter().map(part).collect(),
            times_s: None,
            truncation: None,
            stated: self.stated.clone(),
            unscaled: self.unscaled,
            remarks: self.remarks.clone(),
            timing: Timing::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use test_helpers::holds;

    use super::*;

    #[test]
    fn samples_that_are_no_recording_are_refused_with_the_remedy() {
        let axis = vec![0.0; 10];
        for (rate_hz, channels, word) in [
            (5.0, vec![axis.clone()], "rate"),
            (f64::NAN, vec![axis.clone()], "rate"),
            (5000.0, vec![], "0 channels"),
            (5000.0, vec![axis.clone(); 4], "4 channels"),
            (5000.0, vec![axis.clone(), vec![0.0; 9]], "lengths"),
            (5000.0, vec![Vec::new()], "none"),
        ] {
            let message = HeldSamples::new(rate_hz, channels, false).unwrap_err().to_string();
            holds(&message, &[word]);
        }
    }

    #[test]
    fn a_cut_of_held_samples_is_that_of_a_file() {
        let axis: Vec<f64> = (0..100).map(f64::from).collect();
        let held = HeldSamples::new(100.0, vec![axis], false).unwrap();
        for (start_s, duration_s, expected) in [
            (0.0, f64::INFINITY, 0..100),
            (0.25, 0.5, 25..75),
            (0.5, 9.0, 50..100),
            (2.0, 1.0, 100..100),
        ] {
            let source = held.source(&Cut { start_s, duration_s });
            let found: Vec<usize> = source.channels[0].iter().map(|&x| x as usize).collect();
            assert_eq!(found, expected.collect::<Vec<_>>());
        }
    }
}
