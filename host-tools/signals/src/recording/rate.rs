//! Sample rates, channels and lengths of recordings.

use std::ops::RangeInclusive;

/// Sample rates that a recording may have, Hz.
///
/// Below, there is nothing of a texture: what is felt reaches up to some 1000 Hz. Above, no converter for accelerations
/// is known. The bounds keep a wrong number in a file from sizing memory: conversion to the models' rate makes at most
/// 50 samples of one, and works in blocks of at most two seconds.
pub const RATES_HZ: RangeInclusive<f64> = 100.0..=768_000.0;

/// Largest number of channels of a recording: three axes.
pub const MAX_CHANNELS: usize = 3;

/// Most frames of a recording with three axes, or with a speed and a force beside its axes: 28 minutes at 5 kHz.
pub const MAX_FRAMES: usize = 1 << 23;

/// Most frames of a recording of so many channels, before and after conversion to the models' rate. They take as much
/// memory as [`MAX_FRAMES`] of three axes: 800 MB in a fit, because the axis that they become takes that of a channel.
pub const fn most_frames(channels: usize) -> usize {
    MAX_FRAMES * (MAX_CHANNELS + 1) / (channels + 1)
}

/// Returns the problem of a rate that no recording has, in words; `remedy` tells how to mend it.
pub fn rate_fault(rate_hz: f64, remedy: &str) -> Option<String> {
    // Not a number is in no range.
    if RATES_HZ.contains(&rate_hz) {
        return None;
    }
    let (least, most) = (RATES_HZ.start(), RATES_HZ.end());
    Some(format!(
        "a sample rate of {rate_hz} Hz, where {least} to {most} Hz can be: {remedy}"
    ))
}

/// Returns the problem of `frames` of `channels` that are more than [`most_frames`], in words.
pub(super) fn length_fault(frames: f64, channels: usize) -> Option<String> {
    let most = most_frames(channels);
    (frames > most as f64).then(|| {
        format!(
            "more than {most} samples per channel: give start_s and duration_s, or cut the file"
        )
    })
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
        for rate_hz in [
            0.0,
            1.0,
            99.9,
            -1.0,
            768_001.0,
            4e9,
            f64::NAN,
            f64::INFINITY,
        ] {
            let message = rate_fault(rate_hz, "mend it").unwrap();
            holds(&message, &["768000", "mend it"]);
        }
    }
}
