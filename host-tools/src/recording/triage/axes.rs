//! Verdicts that compare the axes of a trial, and its level with that of any texture.

use super::verdict::{Kind, Verdict};
use crate::dsp::sums::Moments;

/// Ratio of a dead axis's RMS to the strongest one's. The cross-axis sensitivity of accelerometers is about one per
/// cent, so that an axis 60 dB below another measures not even that.
const DEAD_RATIO: f64 = 1e-3;

/// RMS beyond which a scale is doubted, m/s²: ten times the acceleration of gravity. Tools on rough surfaces reach some
/// 30 m/s².
pub const LARGE_RMS_M_S2: f64 = 100.0;

/// Deviation from one at which the mean of three axes is gravity in units of itself.
const GRAVITY_TOLERANCE: f64 = 0.02;

/// Largest RMS, in units of the mean, beside which a mean of one is gravity.
const GRAVITY_RMS: f64 = 0.3;

/// Returns the verdicts on scale and dead axes of a trial whose axes have these `moments`.
pub(super) fn verdicts(moments: &[Moments]) -> Vec<Verdict> {
    let rms = |axis: &Moments| axis.variance.sqrt();
    let strongest = moments.iter().map(rms).fold(0.0, f64::max);
    let mut verdicts: Vec<Verdict> = scale(moments).into_iter().collect();
    for (number, axis) in (1..).zip(moments) {
        if rms(axis) < DEAD_RATIO * strongest {
            let below_db = 20.0 * (strongest / rms(axis)).log10();
            let words = if below_db.is_finite() {
                format!("dead axis {number}: {below_db:.0} dB below the strongest")
            } else {
                format!("dead axis {number}: constant")
            };
            verdicts.push(Verdict::new(Kind::DeadAxis, words));
        }
    }
    verdicts
}

fn scale(moments: &[Moments]) -> Option<Verdict> {
    let rms = moments.iter().map(|axis| axis.variance).sum::<f64>().sqrt();
    let mean = moments.iter().map(|axis| axis.mean.powi(2)).sum::<f64>();
    let mean = mean.sqrt();
    if rms > LARGE_RMS_M_S2 {
        let words = format!("scale: an RMS of {rms:.0} m/s²");
        return Some(Verdict::new(Kind::Scale, words));
    }
    let is_gravity =
        moments.len() == 3 && (mean - 1.0).abs() < GRAVITY_TOLERANCE && rms < GRAVITY_RMS;
    is_gravity.then(|| Verdict::new(Kind::Scale, "scale: gravity is 1.00, as in units of g"))
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus};
    use crate::dsp::sums::moments;

    fn verdicts(axes: &[Vec<f64>]) -> Vec<String> {
        let moments: Vec<_> = axes.iter().map(|axis| moments(axis)).collect();
        let found = super::verdicts(&moments);
        found.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn dead_axes_gravity_of_one_and_scales_that_are_off_are_said() {
        let (a, b) = (noise(1), noise(2));
        let scaled = |signal: &[f64], by: f64| signal.iter().map(|x| by * x).collect::<Vec<f64>>();
        assert!(verdicts(&[a.clone(), scaled(&a, 0.5)]).is_empty());
        let quiet =
            |signal: &[f64], mean: f64| plus(&scaled(signal, 0.01), std::iter::repeat(mean));
        let in_g = [quiet(&a, 0.6), quiet(&b, 0.8), quiet(&noise(3), 0.0)];
        assert!(verdicts(&in_g)[0].contains("gravity is 1.00"));
        assert!(verdicts(&[scaled(&a, 1000.0)])[0].contains("an RMS of"));
        assert!(verdicts(&[a, scaled(&b, 1e-5)])[0].contains("dead axis 2"));
    }
}
