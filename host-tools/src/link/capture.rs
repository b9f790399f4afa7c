//! The record stream: what the device's converters give at each tick, what of it was lost, and what it stands for.

use std::time::Duration;

use model_format::AdcCode;
use model_format::link::{
    BLOCK_SAMPLES, RecordBlock, RecordSample, RecordStopped, Setting, Settings,
};

use super::Device;
use super::device::Blocks;
use super::error::{LinkError, Result};

/// How much longer than asked for a capture goes on in search of a stretch without a hole.
const LONGEST: u64 = 4;

/// How long blocks may come after the answer that ends a recording.
const LATE_BLOCKS: Duration = Duration::from_millis(100);

/// What codes stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Code of each axis without acceleration.
    pub acceleration_zero: [f64; 3],
    /// Acceleration for a code, m/s².
    pub m_s2_per_code: [f64; 3],
    /// Code without force.
    pub force_zero: f64,
    /// Force for a code, N.
    pub n_per_code: f64,
    /// Path for a count of the encoder, mm.
    pub mm_per_count: f64,
}

impl Calibration {
    /// As the device's settings say; `m_s2_per_volt` instead of theirs if given.
    pub fn new(settings: &Settings, m_s2_per_volt: Option<[f64; 3]>) -> Self {
        let volt_per_code = f64::from(AdcCode::STEP.0);
        let of_settings = settings.acceleration_per_volt().map(f64::from);
        Self {
            acceleration_zero: settings.acceleration_zero().map(|code| f64::from(code.0)),
            m_s2_per_code: m_s2_per_volt
                .unwrap_or(of_settings)
                .map(|scale| scale * volt_per_code),
            force_zero: f64::from(settings.force_zero().0),
            n_per_code: f64::from(settings.get(Setting::ForcePerVolt)) * volt_per_code,
            mm_per_count: f64::from(settings.get(Setting::PathPerCount)),
        }
    }

    /// Acceleration of each axis, m/s².
    pub fn acceleration(&self, sample: &RecordSample) -> [f64; 3] {
        let axis = |axis: usize| {
            let code = f64::from(sample.acceleration[axis].0);
            (code - self.acceleration_zero[axis]) * self.m_s2_per_code[axis]
        };
        [axis(0), axis(1), axis(2)]
    }

    /// Normal force, N.
    pub fn force(&self, sample: &RecordSample) -> f64 {
        (f64::from(sample.force.0) - self.force_zero) * self.n_per_code
    }
}

/// What a number of samples amount to.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Level {
    /// RMS about the mean, the axes together, m/s².
    pub rms_m_s2: f64,
    /// Largest distance of a code from mid-scale, of the worst axis; 1 is the converter's end.
    pub peak_of_range: f64,
    /// Mean of the magnitude of the speed, mm/s.
    pub speed_mm_s: f64,
    /// Mean of the force, N.
    pub force_n: f64,
}

impl Level {
    /// Of `samples`, taken at `rate_hz`.
    pub fn of(samples: &[RecordSample], calibration: &Calibration, rate_hz: f64) -> Self {
        if samples.is_empty() {
            return Self::default();
        }
        let count = samples.len() as f64;
        let mut level = Self::default();
        for axis in 0..3 {
            let values = || samples.iter().map(|s| calibration.acceleration(s)[axis]);
            let mean = values().sum::<f64>() / count;
            level.rms_m_s2 += values().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        }
        level.rms_m_s2 = level.rms_m_s2.sqrt();
        let codes = samples.iter().flat_map(|sample| sample.acceleration);
        // From the middle of the range to its lower end; the upper one is a code nearer.
        let peak = codes.map(|code| code.0.abs_diff(1 << 15)).max();
        level.peak_of_range = f64::from(peak.unwrap_or(0)) / f64::from((1u16 << 15) - 1);
        let path: i64 = samples.iter().map(|s| i64::from(s.encoder_delta)).sum();
        level.speed_mm_s = (path as f64 * calibration.mm_per_count).abs() * rate_hz / count;
        let force: f64 = samples.iter().map(|s| f64::from(s.force.0)).sum();
        level.force_n = (force / count - calibration.force_zero) * calibration.n_per_code;
        level
    }
}

/// What a recording lost, in blocks of [`BLOCK_SAMPLES`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Loss {
    /// Blocks that arrived.
    pub received: u32,
    /// Blocks that the device could not keep.
    pub in_device: u32,
    /// Blocks that the device sent and that did not arrive.
    pub on_link: u32,
    /// Frames that arrived and could not be decoded.
    pub broken_frames: u64,
}

impl Loss {
    /// Whether nothing was lost.
    pub fn is_none(&self) -> bool {
        (self.in_device, self.on_link, self.broken_frames) == (0, 0, 0)
    }
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_none() {
            return f.write_str("nothing lost");
        }
        write!(
            f,
            "{} blocks arrived, {} lost in the device, {} on the link",
            self.received, self.in_device, self.on_link
        )
    }
}

/// A recording that is under way; stopped when dropped.
pub struct Stream<'a> {
    device: &'a Device,
    blocks: Blocks,
    rate_hz: u32,
    received: u32,
    broken_before: u64,
    /// Sequence number and first tick that the next block should have.
    due: Option<(u32, u64)>,
    is_running: bool,
}

/// What comes next in a recording.
#[derive(Debug)]
pub struct Arrival {
    /// Samples of successive ticks.
    pub samples: [RecordSample; BLOCK_SAMPLES],
    /// Tick of the first.
    pub first_tick: u64,
    /// Whether they follow the ones before without a hole.
    pub is_continuous: bool,
}

impl<'a> Stream<'a> {
    /// Starts a recording.
    ///
    /// # Errors
    /// That one is under way, a link that broke, a device whose blocks are of another length.
    pub fn start(device: &'a Device) -> Result<Self> {
        let broken_before = device.broken_frames();
        let (started, blocks) = device.record_start()?;
        let stream = Self {
            device,
            blocks,
            rate_hz: started.sample_rate_hz,
            received: 0,
            broken_before,
            due: None,
            is_running: true,
        };
        if started.block_samples as usize == BLOCK_SAMPLES && started.sample_rate_hz > 0 {
            Ok(stream)
        } else {
            Err(device.not_verified(format!(
                "it records blocks of {} samples at {} Hz, and {BLOCK_SAMPLES} at some rate are expected: update it",
                started.block_samples, started.sample_rate_hz
            )))
        }
    }

    /// Samples a second.
    pub fn rate_hz(&self) -> u32 {
        self.rate_hz
    }

    /// The next block; none if none came in time.
    ///
    /// # Errors
    /// A link that broke.
    pub fn next(&mut self, within: Duration) -> Result<Option<Arrival>> {
        let Some(block) = self.blocks.next(self.device, within)? else {
            return Ok(None);
        };
        self.received += 1;
        Ok(Some(self.arrival(&block)))
    }

    fn arrival(&mut self, block: &RecordBlock) -> Arrival {
        let is_continuous = self
            .due
            .is_none_or(|due| due == (block.sequence, block.first_tick));
        let next_tick = block.first_tick + BLOCK_SAMPLES as u64;
        self.due = Some((block.sequence.wrapping_add(1), next_tick));
        Arrival {
            samples: block.samples.map(RecordSample::from),
            first_tick: block.first_tick,
            is_continuous,
        }
    }

    /// The next block, which must come.
    ///
    /// # Errors
    /// A link that broke, a device that sends none although it records.
    pub fn wait(&mut self) -> Result<Arrival> {
        let patience = self.device.patience().answer;
        self.next(patience)?.ok_or_else(|| LinkError::NoAnswer {
            link: self.device.address().to_string(),
            request: "a recording, whose blocks do not come,",
            after: patience,
        })
    }

    /// Stops the recording, and tells what was lost of it up to here.
    ///
    /// # Errors
    /// A link that broke, or a device that says that it still records.
    pub fn stop(mut self) -> Result<Loss> {
        self.is_running = false;
        let stopped = self.device.record_stop()?;
        if self.device.status()?.record.recording {
            return Err(self.device.not_verified(
                "it was told to stop recording and says that it still does: stop it again"
                    .to_owned(),
            ));
        }
        // Blocks go another way through the device than answers do, and may come after them.
        let sent = stopped.blocks.saturating_sub(stopped.lost_blocks);
        while self.received < sent && self.next(LATE_BLOCKS)?.is_some() {}
        Ok(self.loss(stopped))
    }

    fn loss(&self, stopped: RecordStopped) -> Loss {
        let sent = stopped.blocks.saturating_sub(stopped.lost_blocks);
        Loss {
            received: self.received,
            in_device: stopped.lost_blocks,
            on_link: sent.saturating_sub(self.received),
            broken_frames: self.device.broken_frames() - self.broken_before,
        }
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        if self.is_running {
            // Already on the way out because of a failure, which tells more than this one would.
            let _ = self.device.record_stop();
        }
    }
}

/// Samples of successive ticks, none left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The samples.
    pub samples: Vec<RecordSample>,
    /// Samples a second.
    pub rate_hz: u32,
    /// Tick of the first.
    pub first_tick: u64,
    /// What was lost, before this stretch and after it.
    pub loss: Loss,
    /// How often a hole made the capture begin anew.
    pub holes: u32,
}

/// Records until `seconds` without a hole are there, after leaving out the first `settle_s`; none if `goes_on` says no.
///
/// `heard` gets all samples of the stretch so far, how many there will be, and their rate in Hz, with each block.
///
/// # Errors
/// A link that broke; so many holes that four times the time did not suffice.
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
    let most_ticks = (settle + wanted + BLOCK_SAMPLES) as u64 * LONGEST;
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
                    "no {seconds} s without a hole in {:.1} s ({loss}): close other programs that use the link, or use USB",
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
