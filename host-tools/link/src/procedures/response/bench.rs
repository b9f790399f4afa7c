//! Benches that play waveforms and record them: what one is, and that of a stylus behind a link.

use std::time::{Duration, Instant};

use model_format::link::{
    KEEP_ALIVE_MS, MuteReason, ProbeStart, ProbeThrough, RAIL_CODES, RecordSample, Response, Setting, Settings,
};
use stylus_dsp::response::{PERIOD, RATE_HZ};

use super::{Failure, Result, Verdict};
use crate::link::capture::{Calibration, Stream, mend};
use crate::link::{Device, LinkError};

/// A waveform to be played.
#[derive(Clone, Copy, Debug)]
pub struct Probe<'a> {
    /// One period, in steps of 1/32767 of the peak.
    pub codes: &'a [i16],
    /// Peak, m/s².
    pub peak_m_s2: f64,
    /// Periods to be recorded.
    pub periods: usize,
    /// The equaliser that the waveform passes.
    pub through: ProbeThrough,
}

/// The recording of a waveform.
#[derive(Clone, Debug)]
pub struct Played {
    /// Acceleration of the three axes over whole periods, m/s².
    pub axes: [Vec<f64>; 3],
    /// True if a code of the accelerometer was within [`RAIL_CODES`] of an end of the range.
    pub saturated: bool,
    /// True if a limit of the output or the thermal limiter acted.
    pub limited: bool,
}

impl Played {
    /// The recording in physical units.
    pub fn of(samples: &[RecordSample], settings: &Settings, limited: bool) -> Self {
        let calibration = Calibration::new(settings, None);
        let rail = RAIL_CODES;
        let at_rail = |sample: &RecordSample| {
            sample
                .acceleration
                .iter()
                .any(|code| !(rail..=u16::MAX - rail).contains(&code.0))
        };
        let axis = |axis: usize| {
            samples
                .iter()
                .map(|sample| calibration.acceleration(sample)[axis])
                .collect()
        };
        Self {
            axes: [axis(0), axis(1), axis(2)],
            saturated: samples.iter().any(at_rail),
            limited,
        }
    }
}

/// A stylus that plays waveforms and records them.
pub trait ProbedStylus {
    /// The settings in force.
    fn settings(&self) -> &Settings;

    /// Makes `response` the one that [`ProbeThrough::Proposed`] stands for.
    fn propose(&mut self, response: &Response) -> Result<()>;

    /// Plays a waveform and records it.
    fn play(&mut self, probe: &Probe<'_>) -> Result<Played>;

    /// Time for which the device has played, s.
    fn seconds(&self) -> f64;
}

/// Returns the recording of a probe with a peak of `volts`, or the fault that makes it unusable.
pub(super) fn usable(played: Played, volts: f64) -> Result<Played> {
    if played.limited {
        return Err(Verdict::Limited.failure("a limit of the output acted on the probe"));
    }
    if played.saturated {
        let seen = format!("the accelerometer left its range at {volts:.3} V of peak");
        return Err(Verdict::Saturated.failure(seen));
    }
    Ok(played)
}

/// Largest number of times that a waveform is played. It is repeated if the device mutes it because this computer was
/// late.
const TRIES: usize = 4;

/// Periods that are left out before a measurement, in addition to the ramp of the soft start.
const SETTLE: u64 = 1;

/// A stylus behind a link.
pub struct DeviceBench<'a> {
    device: &'a Device,
    settings: Settings,
    goes_on: &'a dyn Fn() -> bool,
    /// The waveform in the device, with its checksum.
    loaded: Option<(Vec<i16>, u32)>,
    seconds: f64,
}

impl<'a> DeviceBench<'a> {
    /// Creates the bench of `device`. Recording ends as interrupted once `goes_on` returns false.
    pub fn new(device: &'a Device, goes_on: &'a dyn Fn() -> bool) -> Result<Self> {
        Ok(Self {
            device,
            settings: device.settings()?,
            goes_on,
            loaded: None,
            seconds: 0.0,
        })
    }

    /// Reads the number of ticks that each limit has changed, and the number of mutes because this computer was late.
    fn limits_and_mutes(&self) -> Result<([u32; 3], u32)> {
        let output = self.device.status()?.output;
        let limits = [output.hard_limited, output.slew_limited, output.thermally_limited];
        let lost = output.mute_counts[MuteReason::LinkLost as usize];
        Ok((limits, lost))
    }

    /// Records the samples of the ticks from `first` to before `end`, and keeps the device playing meanwhile. Torn
    /// samples are interpolated.
    fn record(&self, stream: &mut Stream<'_>, first: u64, end: u64) -> Result<Vec<RecordSample>> {
        let (mut samples, mut whole) = (Vec::new(), Vec::new());
        let mut spoken = Instant::now();
        loop {
            if !(self.goes_on)() {
                return Err(Failure::Interrupted);
            }
            if spoken.elapsed() >= Duration::from_millis(KEEP_ALIVE_MS.into()) {
                self.device.keep_alive()?;
                spoken = Instant::now();
            }
            let arrival = stream.wait()?;
            for ((sample, is_whole), tick) in arrival.samples.into_iter().zip(arrival.whole).zip(arrival.first_tick..) {
                // Samples after a hole are left out, so that the length shows the hole.
                if tick < end && tick == first + samples.len() as u64 {
                    samples.push(sample);
                    whole.push(is_whole);
                }
            }
            let last = arrival.first_tick + arrival.samples.len() as u64;
            if samples.len() as u64 == end - first {
                mend(self.device, &mut samples, &whole)?;
                return Ok(samples);
            }
            if last >= end {
                let link = self.device.address().to_string();
                let what =
                    "the recording of the probe has a hole: close other programs that use the link or keep this \
                            computer busy, or use USB"
                        .to_owned();
                return Err(LinkError::Lossy { link, what }.into());
            }
        }
    }
}

impl ProbedStylus for DeviceBench<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn propose(&mut self, response: &Response) -> Result<()> {
        Ok(self.device.propose_response(response).map(drop)?)
    }

    fn play(&mut self, probe: &Probe<'_>) -> Result<Played> {
        if self.loaded.as_ref().is_none_or(|(codes, _)| codes != probe.codes) {
            let crc32 = self.device.load_probe(probe.codes)?;
            self.loaded = Some((probe.codes.to_vec(), crc32));
        }
        let crc32 = self.loaded.as_ref().map_or(0, |(_, crc32)| *crc32);
        let ramp = f64::from(self.settings.get(Setting::SoftStart)) / 1e3 * RATE_HZ / PERIOD as f64;
        // Only whole periods are left out, so that the recording begins at the phase of the waveform.
        let settle = SETTLE + ramp.ceil() as u64;
        let periods = settle + probe.periods as u64;
        let start = ProbeStart {
            rate_hz: RATE_HZ as u32,
            length: probe.codes.len() as u16,
            periods: periods as u16,
            crc32,
            peak_m_s2: probe.peak_m_s2 as f32,
            through: probe.through,
        };
        for _ in 0..TRIES {
            let (limits, mutes) = self.limits_and_mutes()?;
            // The recording begins before the probe, so that it contains the first tick of the probe.
            let mut stream = Stream::start(self.device)?;
            let started = self.device.start_probe(&start)?;
            let begin = started.first_tick + settle * PERIOD as u64;
            let samples = self.record(&mut stream, begin, started.end_tick);
            // The device is left at rest, even if the recording has failed.
            let stopped = self.device.stop();
            let samples = samples?;
            stopped?;
            stream.stop()?;
            self.seconds += periods as f64 * PERIOD as f64 / RATE_HZ;
            let (limits_after, mutes_after) = self.limits_and_mutes()?;
            // A probe that was muted would look as if nothing moved.
            if mutes_after == mutes {
                let limited = limits_after != limits;
                return Ok(Played::of(&samples, &self.settings, limited));
            }
        }
        let link = self.device.address().to_string();
        let what = "the device has muted the probe, because this computer was late: end other programs".to_owned();
        Err(LinkError::Lossy { link, what }.into())
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }
}
