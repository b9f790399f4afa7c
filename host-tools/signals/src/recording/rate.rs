//! Sample rates, channels and lengths of recordings.

use std::ops::RangeInclusive;

/// Range of sample rates that a recording may have, Hz.
///
/// Below the range, a recording contains nothing of a texture, because skin feels up to about 1000 Hz; a sensor named
/// after 100 Hz may be 5 % slower. Above it, no converter for accelerations is known. The limits prevent a wrong number
/// in a file from determining the size of memory: conversion to the models' rate makes at most 53 samples from one, and
/// works in blocks of at most two seconds or a few thousand samples of the lower rate.
pub const RATES_HZ: RangeInclusive<f64> = 95.0..=768_000.0;

/// Largest number of channels of a recording: three axes.
pub const MAX_CHANNELS: usize = 3;

/// Largest number of frames of a recording with three axes, or with a speed and a force in addition to its axes: 28
/// minutes at 5 kHz.
pub const MAX_FRAMES: usize = 1 << 23;

/// Returns the largest number of frames of a recording with `channels` channels, before and after conversion to the
/// models' rate. Such a recording takes as much memory as [`MAX_FRAMES`] of three axes, 800 MB in a fit. The axis to
/// which the channels are reduced takes as much memory as one channel.
pub const fn most_frames(channels: usize) -> usize {
    MAX_FRAMES * (MAX_CHANNELS + 1) / (channels + 1)
}

/// A sample rate within [`RATES_HZ`]. Every reader of samples returns one, so that none can pass by the range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleRate(f64);

impl SampleRate {
    /// Checks a rate, Hz.
    ///
    /// # Errors
    /// A rate that no recording has, in words; `remedy` states how to correct it.
    pub fn new(rate_hz: f64, remedy: &str) -> Result<Self, String> {
        let (least, most) = (RATES_HZ.start(), RATES_HZ.end());
        // NaN is in no range.
        if RATES_HZ.contains(&rate_hz) {
            return Ok(Self(rate_hz));
        }
        let slow = if rate_hz > 0.0 && rate_hz < *least {
            let half_hz = rate_hz / 2.0;
            format!("; if it is right, the file holds nothing above {half_hz} Hz: a contact microphone records it all")
        } else {
            String::new()
        };
        Err(format!(
            "a sample rate of {rate_hz} Hz, where {least} to {most} Hz can be: {remedy}{slow}"
        ))
    }

    /// The rate, Hz.
    pub fn hz(self) -> f64 {
        self.0
    }
}

/// Returns the remark, in words, that a `given` rate counts before the one that a file states; none if they are the
/// same but for rounding.
pub(super) fn counts_before(given_hz: f64, states: &str, told_hz: f64) -> Option<String> {
    let is_other = (told_hz / given_hz - 1.0).abs() > NEAR_WHOLE;
    is_other.then(|| format!("{states} {told_hz:.1} Hz, and the rate that was given counts: {given_hz} Hz"))
}

/// Largest relative deviation of a rate from a whole number to which it is rounded.
pub(super) const NEAR_WHOLE: f64 = 5e-4;

/// Returns the fault, in words, if `frames` of `channels` exceed [`most_frames`].
pub(super) fn length_fault(frames: f64, channels: usize) -> Option<String> {
    let most = most_frames(channels);
    (frames > most as f64)
        .then(|| format!("more than {most} samples per channel: give start_s and duration_s, or cut the file"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    #[test]
    fn rates_of_converters_pass_and_others_are_named_with_the_remedy() {
        for rate_hz in [95.1, 99.999, 1000.0, 2800.0, 44_100.0, 768_000.0] {
            assert_eq!(SampleRate::new(rate_hz, "").map(SampleRate::hz), Ok(rate_hz));
        }
        holds(
            &SampleRate::new(50.0, "").unwrap_err(),
            &["above 25 Hz", "contact microphone"],
        );
        for rate_hz in [0.0, 1.0, 94.9, -1.0, 768_001.0, 4e9, f64::NAN, f64::INFINITY] {
            let message = SampleRate::new(rate_hz, "mend it").unwrap_err();
            holds(&message, &["768000", "mend it"]);
        }
    }
}
