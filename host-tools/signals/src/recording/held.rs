//! Samples of a recording that a program holds in memory, instead of in a file.

use stylus_support::fnv::Fnv;
use stylus_support::{Error, Result};

use super::defects::Timing;
use super::rate::{MAX_CHANNELS, SampleRate, length_fault};
use super::source::{Cut, Source};
use super::unit::{Stated, Unscaled};

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
    use super::*;
    use test_helpers::holds;

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
