//! Conversion of the converters' codes and the encoder's counts to physical values.

use model_format::AdcCode;
use model_format::link::{RecordSample, Setting, Settings};

/// Offsets and scales of the sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Code of each axis at zero acceleration.
    pub acceleration_zero: [f64; 3],
    /// Acceleration per code of each axis, m/s².
    pub m_s2_per_code: [f64; 3],
    /// Code at zero force.
    pub force_zero: f64,
    /// Force per code, N.
    pub n_per_code: f64,
    /// Path per count of the encoder, mm.
    pub mm_per_count: f64,
}

impl Calibration {
    /// Returns the calibration that the device's settings hold. `m_s2_per_volt` replaces their acceleration scales if
    /// given.
    pub fn new(settings: &Settings, m_s2_per_volt: Option<[f64; 3]>) -> Self {
        let volt_per_code = f64::from(AdcCode::STEP.0);
        let of_settings = settings.acceleration_per_volt().map(f64::from);
        Self {
            acceleration_zero: settings.acceleration_zero().map(|code| f64::from(code.0)),
            m_s2_per_code: m_s2_per_volt.unwrap_or(of_settings).map(|scale| scale * volt_per_code),
            force_zero: f64::from(settings.force_zero().0),
            n_per_code: f64::from(settings.get(Setting::ForcePerVolt)) * volt_per_code,
            mm_per_count: f64::from(settings.get(Setting::PathPerCount)),
        }
    }

    /// Returns the acceleration of each axis, in m/s².
    pub fn acceleration(&self, sample: &RecordSample) -> [f64; 3] {
        let axis = |axis: usize| {
            let code = f64::from(sample.acceleration[axis].0);
            (code - self.acceleration_zero[axis]) * self.m_s2_per_code[axis]
        };
        [axis(0), axis(1), axis(2)]
    }

    /// Returns the normal force, in N.
    pub fn force(&self, sample: &RecordSample) -> f64 {
        (f64::from(sample.force.0) - self.force_zero) * self.n_per_code
    }
}

/// Code in the middle of the converter's range.
const MID_SCALE: u16 = 1 << 15;

/// Averages over a number of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Level {
    /// RMS about the mean, summed over the axes in quadrature, m/s².
    pub rms_m_s2: f64,
    /// Largest distance of a code from mid-scale on any axis, as a fraction of half the range; 1 is the converter's
    /// limit.
    pub peak_of_range: f64,
    /// Magnitude of the mean tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Mean normal force, N.
    pub force_n: f64,
}

impl Level {
    /// Averages over `samples`, taken at `rate_hz`; zero for no samples.
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
        let peak = samples
            .iter()
            .flat_map(|sample| sample.acceleration)
            .map(|code| code.0.abs_diff(MID_SCALE))
            .max();
        // The upper end of the range is one code nearer to mid-scale than the lower end.
        level.peak_of_range = f64::from(peak.unwrap_or(0)) / f64::from(MID_SCALE - 1);
        let path: i64 = samples.iter().map(|s| i64::from(s.encoder_delta)).sum();
        level.speed_mm_s = (path as f64 * calibration.mm_per_count).abs() * rate_hz / count;
        let force: f64 = samples.iter().map(|s| f64::from(s.force.0)).sum();
        level.force_n = (force / count - calibration.force_zero) * calibration.n_per_code;
        level
    }
}

/// Losses of a recording. A block has [`BLOCK_SAMPLES`](model_format::link::BLOCK_SAMPLES) samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Loss {
    /// Blocks that arrived.
    pub received: u32,
    /// Blocks that the device dropped because its buffer was full.
    pub in_device: u32,
    /// Blocks that the device sent and that did not arrive.
    pub on_link: u32,
    /// Frames that arrived and could not be decoded.
    pub broken_frames: u64,
    /// Samples that arrived with conversions of more than one tick, because the device read them too early or too late.
    pub torn_samples: u32,
}

impl Loss {
    /// Returns true if nothing was lost or torn.
    pub fn is_none(&self) -> bool {
        (self.in_device, self.on_link, self.broken_frames) == (0, 0, 0) && self.torn_samples == 0
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
        )?;
        if self.torn_samples > 0 {
            write!(f, "; {} late samples do not count", self.torn_samples)?;
        }
        Ok(())
    }
}
