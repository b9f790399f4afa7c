//! Summary of a number of samples, which shows during a recording whether sensors and motion are as intended.

use model_format::link::RecordSample;

use super::calibration::Calibration;

/// Code in the middle of the converter's range.
const MID_SCALE: u16 = 1 << 15;

/// Averages over a number of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Level {
    /// RMS about the mean, summed over the axes in quadrature, m/s².
    pub rms_m_s2: f64,
    /// Largest distance of a code from mid-scale on any axis, as a share of half the range: 1 is the converter's limit.
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
        let codes = samples.iter().flat_map(|sample| sample.acceleration);
        let peak = codes.map(|code| code.0.abs_diff(MID_SCALE)).max();
        // The upper end of the range is one code nearer to mid-scale than the lower end.
        level.peak_of_range = f64::from(peak.unwrap_or(0)) / f64::from(MID_SCALE - 1);
        let path: i64 = samples.iter().map(|s| i64::from(s.encoder_delta)).sum();
        level.speed_mm_s = (path as f64 * calibration.mm_per_count).abs() * rate_hz / count;
        let force: f64 = samples.iter().map(|s| f64::from(s.force.0)).sum();
        level.force_n = (force / count - calibration.force_zero) * calibration.n_per_code;
        level
    }
}
