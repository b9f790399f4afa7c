//! What plays waveforms and records them.

use std::time::{Duration, Instant};

use model_format::link::{
    KEEP_ALIVE_MS, LIBRARY_CRC, ProbeStart, ProbeThrough, RAIL_CODES, RecordSample, Response, Settings,
};

use super::{Failure, Fault, Result};
use crate::dsp::response::{PERIOD, RATE_HZ};
use crate::link::capture::{Calibration, Stream};
use crate::link::device::Device;
use crate::link::error::LinkError;

/// Periods that are left out before a measurement, besides the ramp of the soft start.
const SETTLE: u64 = 1;

/// A waveform to be played.
#[derive(Clone, Copy, Debug)]
pub struct Probe<'a> {
    /// One period, in steps of 1/32767 of the peak.
    pub codes: &'a [i16],
    /// Peak, m/s².
    pub peak_m_s2: f64,
    /// Periods to be recorded.
    pub periods: usize,
    /// The equaliser that it passes.
    pub through: ProbeThrough,
}

/// What was recorded of a waveform.
#[derive(Clone, Debug)]
pub struct Played {
    /// Acceleration of the three axes over whole periods, m/s².
    pub axes: [Vec<f64>; 3],
    /// True if a code of the accelerometer was at a rail of the converter.
    pub saturated: bool,
    /// True if a limit of the output or the thermal limiter acted.
    pub limited: bool,
}

impl Played {
    /// The recording in physical units.
    pub fn of(samples: &[RecordSample], settings: &Settings, limited: bool) -> Self {
        let calibration = Calibration::new(settings, None);
        let rail = RAIL_CODES;
        let at_rail = |sample: &RecordSample| sample.acceleration.iter().any(|code| !(rail..=u16::MAX - rail).contains(&code.0));
        let axis = |axis: usize| samples.iter().map(|sample| calibration.acceleration(sample)[axis]).collect();
        Self {
            axes: [axis(0), axis(1), axis(2)],
            saturated: samples.iter().any(at_rail),
            limited,
        }
    }
}

/// What plays waveforms and records them.
pub trait Bench {
    /// The settings in force.
    fn settings(&self) -> &Settings;

    /// Makes `response` the one that [`ProbeThrough::Proposed`] names.
    ///
    /// # Errors
    /// A response that is refused, or a lost link.
    fn propose(&mut self, response: &Response) -> Result<()>;

    /// Plays a waveform and records it.
    ///
    /// # Errors
    /// A refusal, a lost link, a recording with holes, or an interrupt.
    fn play(&mut self, probe: &Probe<'_>) -> Result<Played>;

    /// Time for which the device has played, s.
    fn seconds(&self) -> f64;
}

/// A stylus behind a link.
pub struct DeviceBench<'a> {
    device: &'a Device,
    settings: Settings,
    goes_on: &'a dyn Fn() -> bool,
    loaded: Vec<i16>,
    seconds: f64,
}

impl<'a> DeviceBench<'a> {
    /// The stylus behind `device`, until `goes_on` returns false.
    ///
    /// # Errors
    /// A lost link.
    pub fn new(device: &'a Device, goes_on: &'a dyn Fn() -> bool) -> Result<Self> {
        Ok(Self {
            device,
            settings: device.settings()?,
            goes_on,
            loaded: Vec::new(),
            seconds: 0.0,
        })
    }

    /// Number of ticks that a limit has changed.
    fn limited(&self) -> Result<u32> {
        let output = self.device.status()?.output;
        Ok(output.hard_limited + output.slew_limited + output.thermally_limited)
    }

    /// Records the samples of these ticks, and keeps the device playing meanwhile.
    fn record(&self, stream: &mut Stream<'_>, first: u64, end: u64) -> Result<Vec<RecordSample>> {
        let mut samples = Vec::new();
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
            for (sample, tick) in arrival.samples.into_iter().zip(arrival.first_tick..) {
                if tick == first + samples.len() as u64 {
                    samples.push(sample);
                }
            }
            let last = arrival.first_tick + arrival.samples.len() as u64;
            if samples.len() as u64 == end - first {
                return Ok(samples);
            }
            if last >= end {
                let link = self.device.address().to_string();
                let what = "the recording of the probe has a hole: close other programs that use the link, or use USB";
                let what = what.to_owned();
                return Err(LinkError::Lossy { link, what }.into());
            }
        }
    }
}

impl Bench for DeviceBench<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn propose(&mut self, response: &Response) -> Result<()> {
        Ok(self.device.propose_response(response).map(drop)?)
    }

    fn play(&mut self, probe: &Probe<'_>) -> Result<Played> {
        if self.loaded != probe.codes {
            self.device.load_probe(probe.codes)?;
            self.loaded = probe.codes.to_vec();
        }
        let soft_start_s = f64::from(self.settings.get(model_format::link::Setting::SoftStart)) / 1e3;
        let settle = SETTLE + (soft_start_s * RATE_HZ / PERIOD as f64).ceil() as u64;
        let periods = settle + probe.periods as u64;
        let bytes: Vec<u8> = probe.codes.iter().flat_map(|code| code.to_le_bytes()).collect();
        let start = ProbeStart {
            rate_hz: RATE_HZ as u32,
            length: probe.codes.len() as u16,
            // One more, so that the end of the ramp and the delay of the link fall after the last recorded period.
            periods: periods as u16 + 1,
            crc32: LIBRARY_CRC.checksum(&bytes),
            peak_m_s2: probe.peak_m_s2 as f32,
            through: probe.through,
        };
        let before = self.limited()?;
        let mut stream = Stream::start(self.device)?;
        let started = self.device.start_probe(&start)?;
        let first = started.first_tick + settle * PERIOD as u64;
        let samples = self.record(&mut stream, first, started.first_tick + periods * PERIOD as u64);
        // Whatever came of it, the device is left at rest.
        let stopped = self.device.stop();
        let samples = samples?;
        stream.stop()?;
        stopped?;
        self.seconds += (periods + 1) as f64 * PERIOD as f64 / RATE_HZ;
        Ok(Played::of(&samples, &self.settings, self.limited()? != before))
    }

    fn seconds(&self) -> f64 {
        self.seconds
    }
}

/// The fault of a recording at `volts` of peak that cannot be used.
pub(super) fn usable(played: Played, volts: f64) -> Result<Played> {
    if played.limited {
        return Err(Fault::Limited.into());
    }
    if played.saturated {
        return Err(Fault::Saturated { volts }.into());
    }
    Ok(played)
}
