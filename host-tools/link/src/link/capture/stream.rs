//! A recording in progress, block by block.

use std::time::Duration;

use model_format::link::{BLOCK_SAMPLES, RecordBlock, RecordSample, RecordStopped};
use stylus_signals::recording::{MAX_FRAMES, RATES_HZ};

use super::calibration::Loss;
use crate::link::device::{Blocks, Device};
use crate::link::error::{LinkError, Result, longer};

/// Longest interval between the blocks that arrive after the answer that ends a recording.
const LATE_BLOCKS: Duration = Duration::from_millis(100);

/// A recording in progress. Dropping it stops the recording.
pub struct Stream<'a> {
    device: &'a Device,
    blocks: Blocks,
    rate_hz: u32,
    received: u32,
    torn: u32,
    broken_before: u64,
    /// Sequence number and first tick of the next block if none is lost.
    due: Option<(u32, u64)>,
    is_running: bool,
}

/// One block of a recording.
#[derive(Debug)]
pub struct Arrival {
    /// Samples of successive ticks.
    pub samples: [RecordSample; BLOCK_SAMPLES],
    /// Whether each sample is whole. Otherwise its conversions are from more than one tick, and only its encoder step
    /// is valid.
    pub whole: [bool; BLOCK_SAMPLES],
    /// Tick of the first sample.
    pub first_tick: u64,
    /// True if the samples follow those of the block before without a hole; also true for the first block.
    pub is_continuous: bool,
}

impl<'a> Stream<'a> {
    /// Starts a recording.
    ///
    /// # Errors
    /// A recording that is already in progress, a lost link, or a device with another block length or another rate than
    /// a file may have.
    pub fn start(device: &'a Device) -> Result<Self> {
        let broken_before = device.broken_frames();
        let (started, blocks) = device.record_start()?;
        let stream = Self {
            device,
            blocks,
            rate_hz: started.sample_rate_hz,
            received: 0,
            torn: 0,
            broken_before,
            due: None,
            is_running: true,
        };
        if started.block_samples as usize == BLOCK_SAMPLES && RATES_HZ.contains(&f64::from(started.sample_rate_hz)) {
            Ok(stream)
        } else {
            Err(device.not_verified(format!(
                "the device records blocks of {} samples at {} Hz, but this program expects \
                 {BLOCK_SAMPLES} samples: update the device",
                started.block_samples, started.sample_rate_hz
            )))
        }
    }

    /// Sample rate, Hz.
    pub fn rate_hz(&self) -> u32 {
        self.rate_hz
    }

    /// Returns the number of samples in `seconds`. A recording with so many samples must be readable as a file.
    pub fn samples_in(&self, seconds: f64) -> Result<usize> {
        let samples = (seconds * f64::from(self.rate_hz)).round();
        if samples > MAX_FRAMES as f64 {
            return Err(self.device.not_verified(format!(
                "{seconds} s at {} Hz are more than {MAX_FRAMES} samples: record less at a time",
                self.rate_hz
            )));
        }
        Ok(samples as usize)
    }

    /// Returns the next block, or `None` if none arrives within `within`.
    ///
    /// # Errors
    /// A lost link, or a recording that was stopped over another link.
    pub fn next(&mut self, within: Duration) -> Result<Option<Arrival>> {
        let Some(block) = self.blocks.next(self.device, within)? else {
            if self.is_running && !self.device.status()?.record.recording {
                // A stop now could end a recording that the other program has begun since.
                self.is_running = false;
                return Err(self
                    .device
                    .not_verified("the recording was stopped over the stylus's other link: record again".to_owned()));
            }
            return Ok(None);
        };
        self.received += 1;
        Ok(Some(self.arrival(&block)))
    }

    fn arrival(&mut self, block: &RecordBlock) -> Arrival {
        let is_continuous = self.due.is_none_or(|due| due == (block.sequence, block.first_tick));
        let next_tick = block.first_tick + BLOCK_SAMPLES as u64;
        self.due = Some((block.sequence.wrapping_add(1), next_tick));
        self.torn += block.torn.count_ones();
        Arrival {
            whole: std::array::from_fn(|index| block.is_whole(index)),
            samples: block.samples.map(RecordSample::from),
            first_tick: block.first_tick,
            is_continuous,
        }
    }

    /// Returns the next block.
    ///
    /// # Errors
    /// A lost link, a recording that was stopped over another link, or no block within the timeout of an answer.
    pub fn wait(&mut self) -> Result<Arrival> {
        let timeout = self.device.timeouts().answer;
        self.next(timeout)?.ok_or_else(|| LinkError::Lossy {
            link: self.device.address().to_string(),
            what: format!(
                "no block of the recording arrived within {:.1} s: record again, or use USB{}",
                timeout.as_secs_f64(),
                longer(timeout)
            ),
        })
    }

    /// Stops the recording and returns its losses.
    pub fn stop(mut self) -> Result<Loss> {
        // From here on nothing stops the recording a second time, not even the drop after an error.
        self.is_running = false;
        let stopped = self.device.record_stop()?;
        // Blocks may arrive after the answer, because the device queues the two separately.
        while self.loss(stopped).on_link > 0 && self.next(LATE_BLOCKS)?.is_some() {}
        Ok(self.loss(stopped))
    }

    fn loss(&self, stopped: RecordStopped) -> Loss {
        let sent = stopped.blocks.saturating_sub(stopped.lost_blocks);
        Loss {
            received: self.received,
            in_device: stopped.lost_blocks,
            on_link: sent.saturating_sub(self.received),
            broken_frames: self.device.broken_frames() - self.broken_before,
            torn_samples: self.torn,
        }
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        if self.is_running {
            // A failure to stop is ignored, because the failure that led here says more.
            let _ = self.device.record_stop();
        }
    }
}
