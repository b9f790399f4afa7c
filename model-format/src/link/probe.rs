//! Probe: a periodic waveform that the host loads and the device plays, so that a recording shows how the actuator
//! responds to the waveform.
//!
//! A probe passes the safety stages and the mute's ramps, like a texture. It needs no contact and no motion.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{LIBRARY_CRC, PlayError};
use crate::PlayRate;

/// Largest number of samples of one period: 0.4 s at 5 kHz.
pub const MAX_PROBE_SAMPLES: usize = 2_000;

/// Largest number of samples of one [`ProbeLoad`].
pub const PROBE_CHUNK_SAMPLES: usize = 256;

/// Longest probe, all periods together, s.
pub const MAX_PROBE_S: u32 = 10;

/// Largest peak of a probe, m/s²; the kernel's full scale is 2048.
pub const MAX_PROBE_M_S2: f32 = 1_024.0;

/// A part of the waveform. Samples outside this part, which were loaded before, stay as they are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ProbeLoad {
    /// Index of the first sample in the waveform.
    pub offset: u16,
    /// Samples; `i16::MAX` is the peak of the probe.
    pub samples: Vec<i16, PROBE_CHUNK_SAMPLES>,
}

impl ProbeLoad {
    /// The parts of a waveform whose period is `samples`.
    pub fn parts(samples: &[i16]) -> impl Iterator<Item = Self> {
        let parts = samples
            .chunks(PROBE_CHUNK_SAMPLES)
            .zip((0..).step_by(PROBE_CHUNK_SAMPLES));
        parts.map(|(samples, offset)| Self {
            offset,
            samples: samples.iter().copied().collect(),
        })
    }
}

/// CRC-32 of a waveform's samples, [`LIBRARY_CRC`] over their little-endian bytes.
pub fn waveform_crc32(samples: impl Iterator<Item = i16>) -> u32 {
    let mut digest = LIBRARY_CRC.digest();
    samples.for_each(|sample| digest.update(&sample.to_le_bytes()));
    digest.finalize()
}

/// The equaliser that a probe passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ProbeThrough {
    /// No equaliser.
    #[default]
    Nothing,
    /// The equaliser of the stored response, at the settings in force.
    Stored,
    /// The equaliser of the response that this link has proposed, with its `output_gain` in place of the setting.
    Proposed,
}

/// Request to play the waveform that was loaded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct ProbeStart {
    /// Sample rate of the waveform, Hz: 5000 or 10 000.
    pub rate_hz: u32,
    /// Samples of one period, up to [`MAX_PROBE_SAMPLES`].
    pub length: u16,
    /// Number of periods. All periods together last [`MAX_PROBE_S`] at most.
    pub periods: u16,
    /// [`waveform_crc32`] of the period. It ensures that the device plays the waveform that the host has loaded.
    pub crc32: u32,
    /// Acceleration of a sample of `i16::MAX`, m/s², above 0 and up to [`MAX_PROBE_M_S2`].
    pub peak_m_s2: f32,
    /// The equaliser that the probe passes.
    pub through: ProbeThrough,
}

impl ProbeStart {
    /// Creates a request to play `samples` as one period, `periods` times, at 5 kHz and without an equaliser.
    pub fn of(samples: &[i16], periods: u16, peak_m_s2: f32) -> Self {
        Self {
            rate_hz: PlayRate::Hz5000.hz(),
            length: samples.len() as u16,
            periods,
            crc32: waveform_crc32(samples.iter().copied()),
            peak_m_s2,
            through: ProbeThrough::Nothing,
        }
    }

    /// Checks the request. Returns the rate and the number of samples of the whole probe.
    #[expect(
        clippy::result_large_err,
        reason = "without allocation the error is as large as its longest text"
    )]
    pub fn check(&self) -> Result<(PlayRate, u32), ProbeError> {
        let &Self {
            rate_hz,
            length,
            periods,
            peak_m_s2,
            ..
        } = self;
        let rate = PlayRate::of(rate_hz).ok_or(ProbeError::Rate { rate_hz })?;
        // The product of two numbers of 16 bits fits in 32.
        let samples = u32::from(length) * u32::from(periods);
        if usize::from(length) > MAX_PROBE_SAMPLES || samples == 0 || samples > MAX_PROBE_S * rate_hz {
            return Err(ProbeError::Length { length, periods });
        }
        // A comparison with NaN is false.
        if !(peak_m_s2 > 0.0 && peak_m_s2 <= MAX_PROBE_M_S2) {
            return Err(ProbeError::Peak { peak_m_s2 });
        }
        Ok((rate, samples))
    }
}

/// A probe that was accepted. It begins and ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct ProbeStarted {
    /// Tick of the first sample, as in [`super::RecordBlock::first_tick`].
    pub first_tick: u64,
    /// Tick from which the probe has its full level, because the ramp of `soft-start` has ended.
    pub whole_tick: u64,
    /// Tick after the last sample.
    pub end_tick: u64,
}

/// Reason for which a waveform is not loaded or played. Anything that is already playing continues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(
    clippy::large_enum_variant,
    reason = "without allocation the longest text is part of the whole"
)]
#[expect(missing_docs, reason = "each message says it")]
pub enum ProbeError {
    #[error("a probe at {rate_hz} Hz: it must be {} or {} Hz", PlayRate::Hz5000.hz(), PlayRate::Hz10000.hz())]
    Rate { rate_hz: u32 },
    #[error(
        "a probe of {periods} periods of {length} samples: a period has 1 to {MAX_PROBE_SAMPLES}, and all together \
         last {MAX_PROBE_S} s at most"
    )]
    Length {
        /// Samples of a period.
        length: u16,
        /// Number of periods.
        periods: u16,
    },
    #[error("a probe's peak of {peak_m_s2} m/s²: it must be above 0, up to {MAX_PROBE_M_S2}")]
    Peak { peak_m_s2: f32 },
    #[error("samples from {offset} on end beyond {MAX_PROBE_SAMPLES}: load a shorter waveform")]
    Offset {
        /// Index of the first sample.
        offset: u16,
    },
    #[error("the waveform in the device is another one (CRC-32 {loaded:08x}): load all of it again")]
    Waveform {
        /// CRC-32 of the samples in the device.
        loaded: u32,
    },
    #[error("no response is there to play through: propose one on this link, or calibrate with `stylus calibrate`")]
    NoResponse,
    #[error("something is played: stop it first")]
    Playing,
    /// A reason for which nothing may be played.
    #[error("{0}")]
    Refused(PlayError),
}
