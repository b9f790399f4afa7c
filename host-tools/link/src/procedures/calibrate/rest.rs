//! Sensors at rest: their means, their noise, and their zeros.

use std::ops::Range;

use model_format::link::{Activity, RAIL_CODES, RecordSample, Setting, SettingChange, Settings};
use stylus_signals::recording::GRAVITY_M_S2;

use crate::link::Device;
use crate::link::Result;
use crate::link::capture::{Calibration, Capture, capture};

/// Largest relative error of the gravity that an accelerometer measures. Errors of its scales cause it.
const GRAVITY_TOLERANCE: f64 = 0.1;
/// Largest standard deviation of a sensor at rest, codes: 10 mV of 3.3 V.
const MOST_NOISE: f64 = 200.0;
/// Largest change of a sensor's mean during a measurement, codes: 5 mV.
const MOST_DRIFT: f64 = 100.0;
/// Largest change of the encoder's count at rest.
const MOST_COUNTS: i64 = 2;

/// Sensors at rest, in codes: axes X, Y, Z of the accelerometer, and force.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct AtRest {
    /// Mean codes.
    pub mean: [f64; 4],
    /// Standard deviations.
    pub deviation: [f64; 4],
    /// Mean of the second half minus the mean of the first half.
    pub drift: [f64; 4],
    /// Change of the encoder's count.
    pub counts: i64,
}

/// Names of the sensors, in the order of [`AtRest`].
const SENSORS: [&str; 4] = ["acceleration X", "acceleration Y", "acceleration Z", "force"];

impl AtRest {
    /// Measures a stylus at rest for `seconds`. Returns `None` if `goes_on` returned false before the end.
    ///
    /// # Errors
    /// A lost link, a texture or scene that is playing, or a recording with holes.
    pub fn measure(device: &Device, seconds: f64, goes_on: impl FnMut() -> bool) -> Result<Option<Self>> {
        refuse_if_playing(device)?;
        Ok(capture(device, seconds, 0.1, goes_on, |_, _, _| ())?.map(|Capture { samples, .. }| Self::of(&samples)))
    }

    /// Computes the values from `samples`, which must be two or more.
    pub fn of(samples: &[RecordSample]) -> Self {
        let mut at_rest = Self {
            counts: samples.iter().map(|s| i64::from(s.encoder_delta)).sum(),
            ..Self::default()
        };
        for sensor in 0..SENSORS.len() {
            let codes: Vec<f64> = samples
                .iter()
                .map(|sample| {
                    let code = sample.acceleration.get(sensor).unwrap_or(&sample.force);
                    f64::from(code.0)
                })
                .collect();
            let mean = |codes: &[f64]| codes.iter().sum::<f64>() / codes.len().max(1) as f64;
            let whole = mean(&codes);
            let squares: Vec<f64> = codes.iter().map(|code| (code - whole).powi(2)).collect();
            let (first, second) = codes.split_at(codes.len() / 2);
            at_rest.mean[sensor] = whole;
            at_rest.deviation[sensor] = mean(&squares).sqrt();
            at_rest.drift[sensor] = mean(second) - mean(first);
        }
        at_rest
    }

    /// Indices of the accelerometer's axes.
    pub const ACCELERATION: Range<usize> = 0..3;

    /// Index of the force sensor.
    pub const FORCE: Range<usize> = 3..4;

    /// Returns the faults that make this measurement of `sensors` unusable, with their remedies.
    pub fn faults(&self, sensors: &Range<usize>) -> Vec<String> {
        let mut faults = Vec::new();
        if self.counts.abs() > MOST_COUNTS {
            faults.push(format!(
                "the encoder moved by {} counts: hold the stylus still",
                self.counts
            ));
        }
        let rail = f64::from(RAIL_CODES);
        for (sensor, name) in SENSORS.into_iter().enumerate() {
            if !sensors.contains(&sensor) {
                continue;
            }
            let (mean, deviation, drift) = (self.mean[sensor], self.deviation[sensor], self.drift[sensor]);
            if mean < rail || mean > f64::from(u16::MAX) - rail {
                faults.push(format!(
                    "{name} is at a rail of the converter, code {mean:.0}: check its wiring, its supply and its zero"
                ));
            } else if deviation > MOST_NOISE {
                faults.push(format!(
                    "{name} has a noise of {deviation:.0} codes, more than {MOST_NOISE}: hold the stylus still, and \
                     check its wiring"
                ));
            } else if drift.abs() > MOST_DRIFT {
                faults.push(format!(
                    "{name} drifted by {drift:.0} codes: wait until it is steady, and hold the stylus still"
                ));
            }
        }
        faults
    }

    /// Returns the setting of the force's zero that follows from this measurement.
    pub fn force_zero(&self) -> SettingChange {
        zero(Setting::ForceZero, self.mean[3])
    }
}

/// Refuses to measure a stylus that is playing, because its output moves it.
pub(super) fn refuse_if_playing(device: &Device) -> Result<()> {
    if device.status()?.output.activity == Activity::Idle {
        return Ok(());
    }
    let what = "the stylus is playing: stop it, then calibrate";
    Err(device.not_verified(what.to_owned()))
}

/// Returns the settings of the accelerometer's zeros. Gravity cancels, because the two measurements are in opposite
/// poses.
///
/// # Errors
/// Half the difference of the two measurements is not gravity: the poses are not opposite, or the scales are wrong.
pub fn acceleration_zeros(
    pose: &AtRest,
    opposite: &AtRest,
    settings: &Settings,
) -> std::result::Result<[SettingChange; 3], String> {
    let scale = Calibration::new(settings, None).m_s2_per_code;
    let along = |axis: usize| 0.5 * (pose.mean[axis] - opposite.mean[axis]) * scale[axis];
    let gravity = (0..3).map(|axis| along(axis).powi(2)).sum::<f64>().sqrt();
    if (gravity / GRAVITY_M_S2 - 1.0).abs() > GRAVITY_TOLERANCE {
        return Err(format!(
            "the two poses show a gravity of {gravity:.2} m/s² instead of {GRAVITY_M_S2:.2}: turn the stylus exactly \
             upside down, and check acceleration-per-volt-x, -y and -z"
        ));
    }
    let settings = [
        Setting::AccelerationZeroX,
        Setting::AccelerationZeroY,
        Setting::AccelerationZeroZ,
    ];
    let mean = |axis: usize| f64::midpoint(pose.mean[axis], opposite.mean[axis]);
    Ok([0, 1, 2].map(|axis| zero(settings[axis], mean(axis))))
}

fn zero(setting: Setting, mean: f64) -> SettingChange {
    SettingChange {
        setting,
        value: mean.round() as f32,
    }
}

/// Measures the force again, and verifies that it is zero.
///
/// # Errors
/// A lost link, a stylus that is playing, a recording with holes, or a force whose mean is further from the zero than
/// its noise and the drift of a measurement allow.
pub fn verify(device: &Device, seconds: f64) -> Result<AtRest> {
    let settings = device.settings()?;
    let Some(again) = AtRest::measure(device, seconds, || true)? else {
        return Err(device.not_verified("nothing was measured: calibrate again".to_owned()));
    };
    let off = again.mean[3] - f64::from(settings.force_zero().0);
    if off.abs() > again.deviation[3] + MOST_DRIFT {
        return Err(device.not_verified(format!(
            "the force is {off:.0} codes from the zero that was just set: hold the stylus still in the air, then \
             calibrate again"
        )));
    }
    Ok(again)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::AdcCode;

    fn samples(codes: [u16; 4], noise: u16, step: i16) -> Vec<RecordSample> {
        (0..1000u16)
            .map(|n| {
                let [x, y, z, force] = codes.map(|code| AdcCode(code + n % (noise + 1)));
                RecordSample {
                    acceleration: [x, y, z],
                    force,
                    encoder_delta: step,
                }
            })
            .collect()
    }

    #[test]
    fn a_stylus_at_rest_has_no_fault_and_each_disturbance_is_named() {
        let quiet = AtRest::of(&samples([32_768, 32_000, 33_000, 4_096], 9, 0));
        assert_eq!(quiet.faults(&(0..4)), Vec::<String>::new());
        assert!((quiet.mean[3] - 4_100.5).abs() < 1e-9 && quiet.deviation[3] < 3.0);
        for (codes, noise, step, words) in [
            ([32_768, 32_000, 33_000, 3], 9, 0, "force is at a rail"),
            ([32_768, 65_520, 33_000, 4_096], 9, 0, "acceleration Y is at a rail"),
            ([32_768, 32_000, 33_000, 4_096], 900, 0, "noise of"),
            ([32_768, 32_000, 33_000, 4_096], 9, 1, "encoder moved"),
        ] {
            let faults = AtRest::of(&samples(codes, noise, step)).faults(&(0..4));
            assert!(faults.iter().any(|fault| fault.contains(words)), "{faults:?}");
        }
        let mut drifting = samples([32_768, 32_000, 33_000, 4_096], 9, 0);
        for (n, sample) in drifting.iter_mut().enumerate() {
            sample.force = AdcCode(4_096 + n as u16 / 2);
        }
        let faults = AtRest::of(&drifting).faults(&AtRest::FORCE);
        assert!(faults[0].contains("force drifted"), "{faults:?}");
    }

    #[test]
    fn gravity_cancels_in_opposite_poses_and_other_poses_are_refused() {
        let settings = Settings::default();
        let scale = Calibration::new(&settings, None).m_s2_per_code;
        let at = |gravity: [f64; 3]| AtRest {
            mean: [0, 1, 2, 3].map(|sensor| match sensor {
                3 => 4_000.0,
                axis => 32_000.0 + 100.0 * axis as f64 + gravity[axis] / scale[axis],
            }),
            ..AtRest::default()
        };
        let (pose, opposite) = (at([3.0, -9.0, 2.5]), at([-3.0, 9.0, -2.5]));
        let zeros = acceleration_zeros(&pose, &opposite, &settings).expect("they are opposite");
        assert_eq!(zeros.map(|change| change.value), [32_000.0, 32_100.0, 32_200.0]);
        let refused = acceleration_zeros(&pose, &pose, &settings);
        assert!(refused.is_err_and(|words| words.contains("gravity of 0.00")));
    }
}
