//! Verdicts on a unit that cannot be m/s², from the information in the header, the level, and gravity.

use stylus_dsp::sums::Moments;

use super::verdict::{Kind, Verdict};
use crate::recording::trial::Account;
use crate::recording::unit::{GRAVITY_M_S2, GRAVITY_TOLERANCE};

/// Default of the RMS below which a recording is silent, m/s²: less than the noise of any accelerometer.
pub const SILENCE_FLOOR_M_S2: f64 = 1e-3;

/// RMS above which a scale is doubted, m/s²: five times gravity. Tools on rough surfaces reach about 30 m/s².
pub const LARGE_RMS_M_S2: f64 = 50.0;

/// Mean that no sensor at rest on Earth shows, m/s²: gravity, and the same again for the sensor's offset.
const LARGE_MEAN_M_S2: f64 = 2.0 * GRAVITY_M_S2;

/// Largest RMS at which a mean of about 1 on three axes is gravity in g. Tools on rough surfaces have an RMS of this
/// order, in g.
const GRAVITY_RMS: f64 = 1.0;

/// Largest RMS at which a mean of about 1 on fewer axes is gravity in g. Tilted axes can have any mean below gravity.
const GRAVITY_RMS_OF_FEW: f64 = 0.3;

/// Mean, in m/s², of three axes at rest whose unit is a thousand times too small, such as mg instead of g.
const THOUSANDTH_M_S2: f64 = 1e-3 * GRAVITY_M_S2;

/// Largest RMS at which a mean of [`THOUSANDTH_M_S2`] is gravity: a thousandth of the RMS of tools on rough surfaces.
const THOUSANDTH_RMS_M_S2: f64 = 0.03;

/// Units, as `--scale` accepts them, with the value of gravity in each. Counts of powers of two per g are added.
const UNITS: [(&str, f64); 3] = [
    ("mg", 1e3),
    ("cm/s^2", 1e2 * GRAVITY_M_S2),
    ("mm/s^2", 1e3 * GRAVITY_M_S2),
];

/// Range of the exponents of two for the counts per g.
const COUNT_BITS: std::ops::RangeInclusive<u32> = 5..=16;

/// Returns the verdicts on the unit of a trial whose axes have these `moments`: those that the `account` of the samples
/// gives, because a wrong level follows from them, or else that of the level.
pub(super) fn scale(moments: &[Moments], account: &Account) -> Vec<Verdict> {
    let mut words = account.doubts.clone();
    if words.is_empty() {
        words.extend(level(moments, account.has_scale));
    }
    words
        .into_iter()
        .map(|words| Verdict::new(Kind::Scale, format!("scale: {words}")))
        .collect()
}

/// Returns the fault of the level or the mean, in words.
fn level(moments: &[Moments], has_scale: bool) -> Option<String> {
    let rms = moments.iter().map(|axis| axis.variance).sum::<f64>().sqrt();
    let mean = moments.iter().map(|axis| axis.mean.powi(2)).sum::<f64>().sqrt();
    // The mean comes first, because gravity tells the unit, and an RMS does not.
    if mean > LARGE_MEAN_M_S2 {
        let alike = if has_scale { Vec::new() } else { units_of(mean) };
        let unit = match &alike[..] {
            [] if has_scale => ", unless it is an offset of the sensor, such as half its supply".to_owned(),
            [] => String::new(),
            units => format!(", as in {}", units.join(" or ")),
        };
        return Some(format!("a mean of {mean:.0} m/s² where gravity is 9.81{unit}"));
    }
    if rms > LARGE_RMS_M_S2 {
        let of_axes = match moments.len() {
            1 => String::new(),
            axes => format!(" over all {axes} axes"),
        };
        return Some(format!("an RMS of {rms:.0} m/s²{of_axes}"));
    }
    let is_whole = moments.len() == 3;
    let is_thousandth = (mean / THOUSANDTH_M_S2 - 1.0).abs() <= GRAVITY_TOLERANCE;
    if is_whole && is_thousandth && rms <= THOUSANDTH_RMS_M_S2 {
        return Some(format!(
            "a mean of {mean:.4} m/s², a thousandth of gravity: the unit is a thousand times as large, as g is to mg"
        ));
    }
    let most = if is_whole { GRAVITY_RMS } else { GRAVITY_RMS_OF_FEW };
    // Fewer axes may be tilted, so with a scale that was given, a mean of 1 is no finding on them.
    let is_gravity = (mean - 1.0).abs() <= GRAVITY_TOLERANCE
        && (SILENCE_FLOOR_M_S2..most).contains(&rms)
        && (is_whole || !has_scale);
    let or_tilt = if is_whole {
        ""
    } else {
        ", unless the sensor is tilted (--scale 1)"
    };
    is_gravity.then(|| format!("the mean is {mean:.2}, as gravity is in g{or_tilt}"))
}

/// Returns the units in which gravity is about `mean`, the nearest first.
fn units_of(mean: f64) -> Vec<String> {
    let counts = COUNT_BITS
        .map(|bits| 1u32 << bits)
        .map(|count| (format!("g/{count}"), f64::from(count)));
    let named = UNITS.map(|(name, gravity)| (name.to_owned(), gravity));
    let off = |gravity: f64| (mean / gravity - 1.0).abs();
    let mut alike: Vec<(String, f64)> = named
        .into_iter()
        .chain(counts)
        .filter(|(_, gravity)| off(*gravity) <= GRAVITY_TOLERANCE)
        .collect();
    alike.sort_by(|one, other| off(one.1).total_cmp(&off(other.1)));
    alike.into_iter().map(|(name, _)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::bounded_noise;
    use super::*;
    use crate::recording::unit;
    use proptest::prelude::*;
    use stylus_dsp::sums::moments;
    use test_helpers::holds;

    /// The finding for noise of `rms` m/s² per axis about `means`, in samples of `unit_m_s2` m/s².
    fn found(means: &[f64], rms: f64, unit_m_s2: f64, has_scale: bool) -> Option<String> {
        let of = |(seed, mean): (u64, &f64)| {
            let noise = bounded_noise(seed);
            let samples = noise.iter().map(|x| (mean + rms * x / 0.816) / unit_m_s2);
            moments(&samples.collect::<Vec<f64>>())
        };
        let axes: Vec<Moments> = (1..).zip(means).map(of).collect();
        level(&axes, has_scale)
    }

    const G: f64 = GRAVITY_M_S2;

    #[test]
    fn other_units_are_told_on_one_axis_and_on_three_and_the_remedy_names_them() {
        for (unit, word) in [
            ("g", "as gravity is in g"),
            ("mg", "mg"),
            ("mm/s^2", "mm/s^2"),
            ("cm/s^2", "cm/s^2"),
            ("g/256", "g/256"),
            ("g/4096", "g/4096"),
            ("g/8192", "g/8192"),
            ("g/16384", "g/16384"),
        ] {
            let unit_m_s2 = unit::scale(unit).unwrap();
            for offset in [0.93, 1.0, 1.09] {
                for means in [&[0.5, 0.2, G * offset][..], &[G * offset]] {
                    holds(&found(means, 0.5, unit_m_s2, false).unwrap_or_default(), &[word]);
                }
            }
        }
    }

    #[test]
    fn loud_recordings_in_smaller_units_are_told_without_gravity() {
        for unit in ["mg", "mm/s^2", "cm/s^2", "g/4096"] {
            let told = found(&[0.0], 1.0, unit::scale(unit).unwrap(), false);
            holds(&told.unwrap(), &["RMS"]);
        }
    }

    #[test]
    fn a_tilted_axis_whose_scale_is_given_is_left_alone_and_three_axes_are_not() {
        assert_eq!(found(&[1.0], 0.1, 1.0, true), None);
        assert!(found(&[1.0], 0.1, 1.0, false).is_some());
        assert!(found(&[0.6, 0.0, 0.8], 0.1, 1.0, true).is_some());
    }

    #[test]
    fn a_unit_a_thousand_times_too_small_is_told_by_a_thousandth_of_gravity_on_three_axes() {
        let mean = [0.6 * G, 0.0, 0.8 * G];
        for rms in [0.02, 0.5, 10.0] {
            let told = found(&mean, rms, 1e3, true).unwrap();
            holds(&told, &["thousandth of gravity", "g is to mg"]);
        }
        assert_eq!(found(&[G], 0.5, 1e3, true), None);
        assert_eq!(found(&[0.001, 0.0, 0.0], 0.02, 1.0, true), None);
    }

    proptest! {
        /// In m/s², no tilt of a sensor, with gravity or without, and no level of a texture is a finding.
        #[test]
        fn metres_per_second_squared_have_no_finding(
            tilt in 0.0..3.1f64, turn in 0.0..6.2f64, rms in 0.02..15.0f64, gain in 0.9..1.1f64, has_gravity: bool,
        ) {
            let gravity = if has_gravity { gain * G } else { 0.0 };
            let means = [tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos()].map(|x| gravity * x);
            prop_assert_eq!(found(&means, rms, 1.0, false), None);
        }
    }
}
