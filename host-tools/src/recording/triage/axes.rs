//! Verdicts that compare the axes of a trial, and its level with that of any texture.

use super::verdict::{ScaleDoubt, Verdict};
use crate::dsp::sums;

/// Ratio of a dead axis's RMS to the strongest one's. The cross-axis sensitivity of accelerometers is about one per
/// cent, so that an axis 60 dB below another measures not even that.
const DEAD_RATIO: f64 = 1e-3;

/// Least correlation of axes that hold the same signal.
const ALIKE_CORRELATION: f64 = 0.9999;

/// Largest difference of their RMS, as a share. A vibration along one line has one signal on all axes, but at its own
/// level on each.
const ALIKE_LEVEL: f64 = 1e-3;

/// RMS beyond which a scale is doubted, m/s²: ten times the acceleration of gravity. Tools on rough surfaces reach some
/// 30 m/s².
pub const LARGE_RMS_M_S2: f64 = 100.0;

/// Deviation from one at which the mean of three axes is gravity in units of itself.
const GRAVITY_TOLERANCE: f64 = 0.02;

/// Largest RMS, in units of the mean, beside which a mean of one is gravity.
const GRAVITY_RMS: f64 = 0.3;

struct Moments {
    mean: f64,
    rms: f64,
}

impl Moments {
    fn of(moments: &sums::Moments) -> Self {
        Self {
            mean: moments.mean,
            rms: moments.variance.sqrt(),
        }
    }
}

/// Returns the verdicts on scale, dead axes and axes that are alike. The axes have these `moments`.
pub(super) fn verdicts(axes: &[Vec<f64>], moments: &[sums::Moments]) -> Vec<Verdict> {
    let moments: Vec<Moments> = moments.iter().map(Moments::of).collect();
    let strongest = moments.iter().map(|axis| axis.rms).fold(0.0, f64::max);
    let mut verdicts: Vec<Verdict> = scale(&moments).into_iter().collect();
    for (index, axis) in moments.iter().enumerate() {
        if axis.rms < DEAD_RATIO * strongest {
            verdicts.push(Verdict::DeadAxis {
                axis: index + 1,
                below_db: 20.0 * (strongest / axis.rms).log10(),
            });
        }
    }
    for (first, second) in [(0, 1), (0, 2), (1, 2)] {
        if second >= axes.len() {
            continue;
        }
        let alike_levels =
            (moments[first].rms - moments[second].rms).abs() <= ALIKE_LEVEL * moments[first].rms;
        if alike_levels && correlation(axes, &moments, first, second).abs() > ALIKE_CORRELATION {
            verdicts.push(Verdict::AlikeAxes {
                axes: (first + 1, second + 1),
            });
        }
    }
    verdicts
}

fn scale(moments: &[Moments]) -> Option<Verdict> {
    let rms = moments
        .iter()
        .map(|axis| axis.rms * axis.rms)
        .sum::<f64>()
        .sqrt();
    let mean = moments
        .iter()
        .map(|axis| axis.mean * axis.mean)
        .sum::<f64>()
        .sqrt();
    if rms > LARGE_RMS_M_S2 {
        return Some(Verdict::Scale(ScaleDoubt::TooLarge(rms)));
    }
    let is_gravity =
        moments.len() == 3 && (mean - 1.0).abs() < GRAVITY_TOLERANCE && rms < GRAVITY_RMS;
    is_gravity.then_some(Verdict::Scale(ScaleDoubt::GravityOfOne))
}

fn correlation(axes: &[Vec<f64>], moments: &[Moments], first: usize, second: usize) -> f64 {
    let (a, b) = (&moments[first], &moments[second]);
    let pairs = axes[first].iter().zip(&axes[second]);
    let sum: f64 = pairs.map(|(x, y)| (x - a.mean) * (y - b.mean)).sum();
    let both = a.rms * b.rms * axes[first].len() as f64;
    if both > 0.0 { sum / both } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus};
    use super::*;

    fn verdicts(axes: &[Vec<f64>]) -> Vec<Verdict> {
        let moments: Vec<_> = axes.iter().map(|axis| sums::moments(axis)).collect();
        super::verdicts(axes, &moments)
    }

    #[test]
    fn axes_that_are_alike_and_gravity_of_one_are_said() {
        let (a, b) = (noise(1), noise(2));
        let inverted: Vec<f64> = a.iter().map(|x| -x).collect();
        let half: Vec<f64> = a.iter().map(|x| 0.5 * x).collect();
        assert_eq!(verdicts(&[a.clone(), half]), []);
        assert_eq!(
            verdicts(&[a.clone(), b.clone(), inverted]),
            [Verdict::AlikeAxes { axes: (1, 3) }]
        );
        let quiet = |signal: &[f64], mean: f64| {
            let scaled: Vec<f64> = signal.iter().map(|x| 0.01 * x).collect();
            plus(&scaled, std::iter::repeat(mean))
        };
        let in_g = [quiet(&a, 0.6), quiet(&b, 0.8), quiet(&noise(3), 0.0)];
        assert_eq!(verdicts(&in_g), [Verdict::Scale(ScaleDoubt::GravityOfOne)]);
        let thousandfold: Vec<f64> = a.iter().map(|x| 1000.0 * x).collect();
        assert!(matches!(
            verdicts(&[thousandfold])[..],
            [Verdict::Scale(ScaleDoubt::TooLarge(_))]
        ));
    }
}
