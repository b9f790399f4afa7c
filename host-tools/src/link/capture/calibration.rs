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
    /// The calibration of the device's settings, with `m_s2_per_volt` in place of their acceleration scales if given.
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
