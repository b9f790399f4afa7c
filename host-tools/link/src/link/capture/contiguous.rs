//! Captures of a given length without a hole.

use model_format::AdcCode;
use model_format::link::{BLOCK_SAMPLES, RecordSample};

use super::calibration::Loss;
use super::stream::Stream;
use crate::link::device::Device;
use crate::link::error::{LinkError, Result};

/// Longest search for a stretch without a hole, as a multiple of the stretch's length.
const MAX_LENGTHS: u64 = 4;

/// Samples of successive ticks, without a hole.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The samples.
    pub samples: Vec<RecordSample>,
    /// Sample rate, Hz.
    pub rate_hz: u32,
    /// Tick of the first sample.
    pub first_tick: u64,
    /// Losses of the whole recording. Within this stretch no block is lost, but samples may be torn.
    pub loss: Loss,
    /// Number of holes. After each hole the capture began again.
    pub holes: u32,
    /// Number of samples of this stretch that were torn. Their codes are interpolated between their whole neighbours.
    pub interpolated: u32,
}

/// Fraction of torn samples above which a stretch is rejected.
const MOST_TORN: f64 = 0.01;

/// Records `seconds` without a hole, after `settle_s` seconds that are left out. Returns `None` as soon as `goes_on`
/// returns false.
///
/// After each block, `heard` is called with all samples of the stretch so far, the number of samples that the stretch
/// will have at its end, and the sample rate in Hz.
///
/// # Errors
/// A lost link, a recording that another program has stopped, more samples than a recording can have, no stretch
/// without a hole in four times its length, or more than 1 % torn samples.
pub fn capture(
    device: &Device,
    seconds: f64,
    settle_s: f64,
    mut goes_on: impl FnMut() -> bool,
    mut heard: impl FnMut(&[RecordSample], usize, u32),
) -> Result<Option<Capture>> {
    let mut stream = Stream::start(device)?;
    let rate_hz = stream.rate_hz();
    let settle = stream.samples_in(settle_s)?;
    let wanted = stream.samples_in(seconds)?.max(1);
    let most_ticks = (settle + wanted + BLOCK_SAMPLES) as u64 * MAX_LENGTHS;
    // Samples come in blocks, so the last block may exceed the wanted number by nearly its length.
    let mut samples: Vec<RecordSample> = Vec::with_capacity(settle + wanted + BLOCK_SAMPLES);
    let mut whole: Vec<bool> = Vec::with_capacity(samples.capacity());
    let (mut begin, mut first_tick, mut holes) = (None, 0, 0);
    while samples.len() < settle + wanted {
        if !goes_on() {
            return stream.stop().map(|_| None);
        }
        let arrival = stream.wait()?;
        if !arrival.is_continuous {
            holes += 1;
            samples.clear();
            whole.clear();
        }
        if samples.is_empty() {
            first_tick = arrival.first_tick;
        }
        // The first tick of the whole search, not of this stretch. Otherwise the search would never end on a link that
        // keeps losing blocks.
        let start = *begin.get_or_insert(arrival.first_tick);
        samples.extend(arrival.samples);
        whole.extend(arrival.whole);
        heard(&samples, settle + wanted, rate_hz);
        // Without a hole the loop ends by itself.
        if holes > 0 && arrival.first_tick.saturating_sub(start) > most_ticks {
            let loss = stream.stop()?;
            return Err(LinkError::Lossy {
                link: device.address().to_string(),
                what: format!(
                    "{:.1} s were recorded, and no {seconds} s of them without a hole ({loss}): close other programs \
                     that use the link or keep this computer busy, or use USB",
                    most_ticks as f64 / f64::from(rate_hz)
                ),
            });
        }
    }
    let loss = stream.stop()?;
    samples.truncate(settle + wanted);
    samples.drain(..settle);
    whole.truncate(settle + wanted);
    whole.drain(..settle);
    let interpolated = mend(device, &mut samples, &whole)?;
    Ok(Some(Capture {
        interpolated,
        samples,
        rate_hz,
        first_tick: first_tick + settle as u64,
        loss,
        holes,
    }))
}

/// Interpolates the samples that are not `whole`; returns their number, or an error if there are too many.
pub(crate) fn mend(device: &Device, samples: &mut [RecordSample], whole: &[bool]) -> Result<u32> {
    let interpolated = whole.iter().filter(|&&whole| !whole).count() as u32;
    if f64::from(interpolated) > MOST_TORN * whole.len() as f64 {
        return Err(LinkError::Lossy {
            link: device.address().to_string(),
            what: format!(
                "{interpolated} of {} samples are torn, because the device read its converter late: look at \
                 `stylus status`, restart the device, then record again",
                whole.len()
            ),
        });
    }
    interpolate(samples, whole);
    Ok(interpolated)
}

/// Replaces the codes of samples that are not `whole` by codes on the straight line between the neighbouring whole
/// samples, or, at an end, by the codes of the nearest whole sample. The encoder's steps stay.
fn interpolate(samples: &mut [RecordSample], whole: &[bool]) {
    let mut before: Option<usize> = None;
    let mut at = 0;
    while at < samples.len() {
        if whole[at] {
            before = Some(at);
            at += 1;
            continue;
        }
        let after = (at..samples.len()).find(|&n| whole[n]);
        let (Some(first), Some(last)) = (before.or(after), after.or(before)) else {
            return;
        };
        let end = after.unwrap_or(samples.len());
        let (from, to) = (samples[first], samples[last]);
        for (n, sample) in (at..end).zip(&mut samples[at..end]) {
            // At an end both neighbours are the same sample. The fraction would divide by zero, and `n` may precede
            // `first`.
            let share = if last > first {
                (n - first) as f64 / (last - first) as f64
            } else {
                0.0
            };
            let between = |from: AdcCode, to: AdcCode| {
                let (from, to) = (f64::from(from.0), f64::from(to.0));
                // The value lies between two codes, so the cast loses nothing.
                AdcCode((from + (to - from) * share).round() as u16)
            };
            for axis in 0..3 {
                sample.acceleration[axis] = between(from.acceleration[axis], to.acceleration[axis]);
            }
            sample.force = between(from.force, to.force);
        }
        at = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torn_samples_lie_between_their_whole_neighbours_and_keep_their_steps() {
        let line = |n: usize| RecordSample {
            acceleration: [100, 200, 300].map(|slope| AdcCode((n * slope) as u16)),
            force: AdcCode(5_000 + 10 * n as u16),
            encoder_delta: n as i16,
        };
        let expected: Vec<RecordSample> = (0..40).map(line).collect();
        let whole: Vec<bool> = (0..40).map(|n| ![3, 11, 12, 13].contains(&n)).collect();
        let mut samples = expected.clone();
        for (sample, _) in samples.iter_mut().zip(&whole).filter(|(_, whole)| !**whole) {
            sample.acceleration = [AdcCode(60_000); 3];
            sample.force = AdcCode(0);
        }
        interpolate(&mut samples, &whole);
        assert_eq!(samples, expected);
    }

    #[test]
    fn torn_samples_at_an_end_repeat_the_nearest_whole_one() {
        let sample = |code: u16| RecordSample {
            acceleration: [AdcCode(code); 3],
            force: AdcCode(code),
            encoder_delta: 1,
        };
        let mut samples = [1, 7, 9, 2].map(sample);
        interpolate(&mut samples, &[false, true, true, false]);
        assert_eq!(samples, [7, 7, 9, 9].map(sample));
        let mut none = [1, 2].map(sample);
        interpolate(&mut none, &[false, false]);
        assert_eq!(none, [1, 2].map(sample));
    }
}
