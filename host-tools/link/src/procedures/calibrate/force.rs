//! Scale of the force sensor, from known weights that are laid on the tip one after another and taken off again.

use model_format::AdcCode;
use model_format::link::{Setting, SettingChange, Settings};
use stylus_signals::recording::GRAVITY_M_S2;

use super::rest::AtRest;
use crate::link::capture::Calibration;

/// Least number of codes by which the largest weight must change the force. They are 25 mV of 3.3 V.
const LEAST_CODES: f64 = 500.0;
/// Largest deviation of the force from a line, and largest difference between loading and unloading, as a fraction of
/// the largest weight.
const MOST_SHARE: f64 = 0.05;
/// Threshold of contact in standard deviations of the noise. Contact ends at half the threshold, still beyond the
/// noise.
const CONTACT_DEVIATIONS: f64 = 6.0;
/// Lowest threshold of contact, N. It is the lowest that the device uses, and above the weight of a cable.
const LEAST_CONTACT_N: f64 = 0.02;

/// The sensors with a weight on the tip.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Weighed {
    /// Weight, g; 0 without one.
    pub grams: f64,
    /// Values of the sensors meanwhile.
    pub at_rest: AtRest,
}

/// Returns the order in which `grams` are weighed: no weight, each weight from the lightest to the heaviest, and back.
/// This shows hysteresis.
pub fn order(grams: &[f64]) -> Vec<f64> {
    let mut up = grams.to_vec();
    up.sort_by(f64::total_cmp);
    let down = up.iter().rev().skip(1).copied().collect::<Vec<_>>();
    [vec![0.0], up, down, vec![0.0]].concat()
}

/// Scale of the force, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ForceScale {
    /// Force per voltage, N/V; negative if the voltage falls with the force.
    pub n_per_volt: f64,
    /// Largest difference of a measurement from the line through all of them, N.
    pub residual_n: f64,
    /// Largest difference between loading and unloading, N.
    pub hysteresis_n: f64,
    /// Standard deviation without a weight, N.
    pub noise_n: f64,
    /// Threshold of contact that follows from noise and hysteresis, N.
    pub contact_threshold_n: f64,
}

/// Reason why weighing gives no scale.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ForceFault {
    /// The largest weight, g, changes the force by only this number of codes.
    #[error(
        "{0} g change the force by {1:.0} codes, fewer than {LEAST_CODES}: lay the weight on the tip itself, use a \
         heavier one, and check the sensor's wiring and gain"
    )]
    Insensitive(f64, f64),
    /// Unloading differs from loading by this force, N, and this percentage of the largest weight.
    #[error(
        "on the way down the force differs by {0:.3} N, {1:.0} % of the largest weight: see that the tip moves freely \
         and nothing slips, and lay each weight at the same place"
    )]
    Hysteresis(f64, f64),
    /// The measurements differ from a line by this force, N, and this percentage of the largest weight.
    #[error(
        "the force differs from a line by {0:.3} N, {1:.0} % of the largest weight: check the values of the weights \
         and their order, and that the sensor is not at the end of its range"
    )]
    NotLinear(f64, f64),
    /// With the stored scale, this weight, g, reads the first force, N, instead of the second.
    #[error(
        "{0} g show as {1:.3} N instead of {2:.3} N by the scale that was just set: lay the same weight on the tip as \
         before, and calibrate again"
    )]
    NotVerified(f64, f64, f64),
}

fn newtons(grams: f64) -> f64 {
    grams / 1e3 * GRAVITY_M_S2
}

impl ForceScale {
    /// Fits the scale to measurements, which are in the [`order`] of their weights.
    ///
    /// # Errors
    /// A sensor that hardly reacts, shows other values on the way back, or is not linear in the weight.
    pub fn of(measured: &[Weighed]) -> Result<Self, ForceFault> {
        let codes = |weighed: &Weighed| weighed.at_rest.mean[3];
        let count = measured.len() as f64;
        // A straight line by least squares. It need not pass through zero, because the zero is a setting of its own.
        let mean = |of: &dyn Fn(&Weighed) -> f64| measured.iter().map(of).sum::<f64>() / count;
        let force = |weighed: &Weighed| newtons(weighed.grams);
        let (mean_n, mean_codes) = (mean(&force), mean(&codes));
        let covariance = mean(&|one| (force(one) - mean_n) * (codes(one) - mean_codes));
        let codes_per_n = covariance / mean(&|one| (force(one) - mean_n).powi(2));

        let grams = measured.iter().map(|one| one.grams).fold(0.0, f64::max);
        let (most_n, change) = (newtons(grams), codes_per_n * newtons(grams));
        // Without two different weights the change is not a number.
        if change.is_nan() || change.abs() < LEAST_CODES {
            return Err(ForceFault::Insensitive(grams, change.abs()));
        }
        let most = |codes: f64, one: f64| f64::max(codes, (one / codes_per_n).abs());
        // The order of the weights is the same backwards, so each pair has the same weight.
        let hysteresis_n = measured
            .iter()
            .zip(measured.iter().rev())
            .map(|(up, down)| codes(up) - codes(down))
            .fold(0.0, most);
        let line = |one: &Weighed| mean_codes + codes_per_n * (force(one) - mean_n);
        let residual_n = measured.iter().map(|one| codes(one) - line(one)).fold(0.0, most);
        let percent = |newtons: f64| 100.0 * newtons / most_n;
        // Hysteresis is asked first, because it also shows as a deviation from the line.
        if hysteresis_n > MOST_SHARE * most_n {
            return Err(ForceFault::Hysteresis(hysteresis_n, percent(hysteresis_n)));
        }
        if residual_n > MOST_SHARE * most_n {
            return Err(ForceFault::NotLinear(residual_n, percent(residual_n)));
        }
        let noise_n = measured
            .iter()
            .filter(|one| one.grams == 0.0)
            .map(|one| one.at_rest.deviation[3])
            .fold(0.0, most);
        // Contact ends at half of the threshold. The half must exceed a zero that is off by the hysteresis.
        let threshold_n = CONTACT_DEVIATIONS * noise_n + 2.0 * hysteresis_n;
        Ok(Self {
            n_per_volt: 1.0 / (codes_per_n * f64::from(AdcCode::STEP.0)),
            residual_n,
            hysteresis_n,
            noise_n,
            contact_threshold_n: threshold_n.max(LEAST_CONTACT_N),
        })
    }

    /// Returns the settings of scale and threshold, rounded to four digits. The measurement is less accurate than that.
    pub fn changes(&self) -> [SettingChange; 2] {
        let digits = |value: f64| format!("{value:.3e}").parse().unwrap_or(value as f32);
        [
            (Setting::ForcePerVolt, self.n_per_volt),
            (Setting::ContactThreshold, self.contact_threshold_n),
        ]
        .map(|(setting, value)| SettingChange {
            setting,
            value: digits(value),
        })
    }

    /// Verifies that, by the `stored` scale, the force rises from the first to the second measurement as their weights
    /// do.
    ///
    /// # Errors
    /// A force that is off by more than [`ForceScale::of`] allows.
    pub fn verify([before, after]: [Weighed; 2], stored: &Settings) -> Result<(), ForceFault> {
        let change = after.at_rest.mean[3] - before.at_rest.mean[3];
        let shown = change * Calibration::new(stored, None).n_per_code;
        let grams = after.grams - before.grams;
        let expected = newtons(grams);
        if (shown - expected).abs() <= MOST_SHARE * expected {
            return Ok(());
        }
        Err(ForceFault::NotVerified(grams, shown, expected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    /// Returns measurements of a sensor with `codes_per_n`. It shows `down` more codes during unloading, and `square`
    /// more codes per square newton.
    fn measured(grams: &[f64], codes_per_n: f64, down: f64, square: f64) -> Vec<Weighed> {
        let order = order(grams);
        let top = order.len() / 2;
        let one = |(at, &grams): (usize, &f64)| {
            let (force, mut at_rest) = (newtons(grams), AtRest::default());
            let more = if at > top { down } else { 0.0 };
            at_rest.mean[3] = 9_000.0 + codes_per_n * force + square * force * force + more;
            at_rest.deviation[3] = 16.0;
            Weighed { grams, at_rest }
        };
        order.iter().enumerate().map(one).collect()
    }

    proptest! {
        #[test]
        fn the_scale_of_a_straight_sensor_is_found_whatever_its_sign_and_the_weights(
            grams in prop::collection::vec(60.0f64..300.0, 1..3),
            codes_per_n in prop_oneof![-15_000.0f64..-1_500.0, 1_500.0f64..15_000.0],
        ) {
            let scale = ForceScale::of(&measured(&grams, codes_per_n, 0.0, 0.0)).expect("it is straight");
            let expected = 1.0 / (codes_per_n * f64::from(AdcCode::STEP.0));
            prop_assert!((scale.n_per_volt / expected - 1.0).abs() < 1e-9);
            prop_assert!(scale.residual_n.max(scale.hysteresis_n) < 1e-9);
            let threshold = (6.0 * 16.0 / codes_per_n.abs()).max(0.02);
            prop_assert!((scale.contact_threshold_n - threshold).abs() < 1e-9);
        }
    }

    #[test]
    fn a_sensor_that_sticks_bends_or_does_not_react_is_refused_by_its_name() {
        let of = |down, square| ForceScale::of(&measured(&[100.0, 200.0], 5_000.0, down, square));
        let kept = of(100.0, 0.0).expect("1 % is within what is allowed");
        near(kept.hysteresis_n, 0.02, 0.001);
        assert!(kept.contact_threshold_n > 2.0 * kept.hysteresis_n);
        assert!(matches!(of(700.0, 0.0), Err(ForceFault::Hysteresis(..))));
        assert!(matches!(of(0.0, -1_500.0), Err(ForceFault::NotLinear(..))));
        let numb = ForceScale::of(&measured(&[100.0], 200.0, 0.0, 0.0));
        assert!(matches!(numb, Err(ForceFault::Insensitive(..))));
        assert!(matches!(ForceScale::of(&[]), Err(ForceFault::Insensitive(..))));
    }
}
