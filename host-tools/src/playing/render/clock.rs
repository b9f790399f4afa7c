//! Clock of a rendering, common to textures and scenes.

use stylus_kernel::update_interval_samples;

use crate::support::error::{Error, Result};

/// Longest rendering, s: one day.
pub const MAX_SECONDS: f64 = 24.0 * 3600.0;

/// Iterator over the samples of a rendering: the time, s, at which the motion is to be taken over before the sample, or
/// none between two updates.
///
/// An update is due every [`update_interval_samples`], as on the device.
#[derive(Clone, Debug)]
pub struct SampleClock {
    sample_rate_hz: u32,
    position: usize,
    len: usize,
}

impl SampleClock {
    /// A clock over `seconds`, from the first sample.
    ///
    /// # Errors
    /// A duration that is not a number, is shorter than a sample, or is longer than [`MAX_SECONDS`].
    pub fn new(seconds: f64, sample_rate_hz: u32) -> Result<Self> {
        let samples = (seconds * f64::from(sample_rate_hz)).round();
        if !(seconds <= MAX_SECONDS && samples >= 1.0) {
            return Err(Error::Request(format!(
                "cannot render {seconds} s: give at least the duration of one sample and at most {MAX_SECONDS} s"
            )));
        }
        Ok(Self {
            sample_rate_hz,
            position: 0,
            len: samples as usize,
        })
    }

    /// Time from a block's first sample to its last one, s.
    pub fn block_s(&self) -> f64 {
        f64::from(self.block_samples() - 1) / f64::from(self.sample_rate_hz)
    }

    /// Samples of a block.
    pub fn block_samples(&self) -> u32 {
        update_interval_samples(self.sample_rate_hz)
    }

    /// Sample rate, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }
}

impl Iterator for SampleClock {
    type Item = Option<f64>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.position == self.len {
            return None;
        }
        let is_due = self.position.is_multiple_of(self.block_samples() as usize);
        let time_s = self.position as f64 / f64::from(self.sample_rate_hz);
        self.position += 1;
        Some(is_due.then_some(time_s))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.len - self.position;
        (left, Some(left))
    }
}

impl ExactSizeIterator for SampleClock {}
