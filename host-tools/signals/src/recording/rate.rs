//! Sample rates, channels and lengths of recordings.

use std::ops::RangeInclusive;

/// Range of sample rates that a recording may have, Hz.
///
/// Below the range, a recording contains nothing of a texture, because skin feels up to about 1000 Hz. Above it, no
/// converter for accelerations is known. The limits prevent a wrong number in a file from determining the size of
/// memory: conversion to the models' rate makes at most 50 samples from one, and works in blocks of at most two seconds
/// or a few thousand samples of the lower rate.
pub const RATES_HZ: RangeInclusive<f64> = 100.0..=768_000.0;

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

/// Returns, in words, what is wrong with a rate that no recording has; `remedy` states how to correct it.
pub fn rate_fault(rate_hz: f64, remedy: &str) -> Option<String> {
    // NaN is in no range.
    if RATES_HZ.contains(&rate_hz) {
        return None;
    }
    let (least, most) = (RATES_HZ.start(), RATES_HZ.end());
    Some(format!(
        "a sample rate of {rate_hz} Hz, where {least} to {most} Hz can be: {remedy}"
    ))
}

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
        for rate_hz in [100.0, 1000.0, 2800.0, 44_100.0, 768_000.0] {
            assert_eq!(rate_fault(rate_hz, ""), None);
        }
        for rate_hz in [0.0, 1.0, 99.9, -1.0, 768_001.0, 4e9, f64::NAN, f64::INFINITY] {
            let message = rate_fault(rate_hz, "mend it").unwrap();
            holds(&message, &["768000", "mend it"]);
        }
    }
}
