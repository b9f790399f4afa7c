//! Captures of a given length without a hole.

use model_format::link::{BLOCK_SAMPLES, RecordSample};

use super::loss::Loss;
use super::stream::Stream;
use crate::link::device::Device;
use crate::link::error::{LinkError, Result};

/// Longest search for a stretch without a hole, in lengths of that stretch.
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
    /// Losses before this stretch and after it.
    pub loss: Loss,
    /// Number of holes, each of which made the capture begin anew.
    pub holes: u32,
}

/// Records `seconds` without a hole, after `settle_s` that are left out. Returns `None` as soon as `goes_on` returns
/// false.
///
/// After each block `heard` gets all samples of the stretch so far, their number at its end, and the sample rate in Hz.
///
/// # Errors
/// A lost link, or no stretch without a hole in four times its length.
pub fn capture(
    device: &Device,
    seconds: f64,
    settle_s: f64,
    mut goes_on: impl FnMut() -> bool,
    mut heard: impl FnMut(&[RecordSample], usize, u32),
) -> Result<Option<Capture>> {
    let mut stream = Stream::start(device)?;
    let rate_hz = stream.rate_hz();
    let in_samples = |seconds: f64| (seconds * f64::from(rate_hz)).round() as usize;
    let (settle, wanted) = (in_samples(settle_s), in_samples(seconds).max(1));
    let most_ticks = (settle + wanted + BLOCK_SAMPLES) as u64 * MAX_LENGTHS;
    let mut samples: Vec<RecordSample> = Vec::with_capacity(settle + wanted + BLOCK_SAMPLES);
    let (mut begin, mut first_tick, mut holes) = (None, 0, 0);
    while samples.len() < settle + wanted {
        if !goes_on() {
            return stream.stop().map(|_| None);
        }
        let arrival = stream.wait()?;
        if !arrival.is_continuous {
            holes += 1;
            samples.clear();
        }
        if samples.is_empty() {
            first_tick = arrival.first_tick;
        }
        let start = *begin.get_or_insert(arrival.first_tick);
        samples.extend(arrival.samples);
        heard(&samples, settle + wanted, rate_hz);
        if holes > 0 && arrival.first_tick.saturating_sub(start) > most_ticks {
            let loss = stream.stop()?;
            return Err(LinkError::Lossy {
                link: device.address().to_string(),
                what: format!(
                    "no {seconds} s without a hole in {:.1} s ({loss}): close other programs that use the \
                     link, or use USB",
                    most_ticks as f64 / f64::from(rate_hz)
                ),
            });
        }
    }
    let loss = stream.stop()?;
    samples.truncate(settle + wanted);
    samples.drain(..settle);
    Ok(Some(Capture {
        samples,
        rate_hz,
        first_tick: first_tick + settle as u64,
        loss,
        holes,
    }))
}
