//! Verdicts on a trial that need no other trial: length, sample rate, clipping and drift.

use super::verdict::Verdict;
use crate::recording::samples::Samples;
use model_format::SAMPLE_RATE_HZ;

/// Number of samples below which a trial is too short: 0.4 s at 5 kHz.
pub const SHORT_SAMPLES: usize = 2000;

/// Share of samples at the extremes at which a recording counts as clipped.
pub const CLIPPED_SHARE: f64 = 1e-3;

/// Share of an axis's energy explained by a straight line at which a recording counts as drifting.
pub const DRIFT_SHARE: f64 = 0.05;

/// Default of the RMS below which a recording is silent, m/s²: less than the noise of any accelerometer.
pub const SILENCE_FLOOR_M_S2: f64 = 1e-3;

/// Returns the verdicts that need no other trial.
pub fn samples(samples: &Samples) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let axes = samples.axes.as_slice();
    let source_rate_hz = samples.source_rate_hz;
    let count = axes.first().map_or(0, Vec::len);
    if count < SHORT_SAMPLES {
        verdicts.push(Verdict::TooShort { samples: count });
    }
    if source_rate_hz < f64::from(SAMPLE_RATE_HZ) {
        verdicts.push(Verdict::WrongRate {
            rate_hz: source_rate_hz,
        });
    }
    let share = samples.clipped_share;
    if share >= CLIPPED_SHARE {
        verdicts.push(Verdict::Clipped { share });
    }
    let share = worst(axes, drift_share);
    if share >= DRIFT_SHARE {
        verdicts.push(Verdict::Drifting { share });
    }
    verdicts
}

fn worst(axes: &[Vec<f64>], measure: fn(&[f64]) -> f64) -> f64 {
    axes.iter().map(|axis| measure(axis)).fold(0.0, f64::max)
}

/// Length of a chunk, which the compiler keeps in vector registers.
const LANES: usize = 8;

/// Returns the share of the energy about the mean that a straight line explains.
fn drift_share(axis: &[f64]) -> f64 {
    let n = axis.len() as f64;
    let first = axis.first().copied().unwrap_or(0.0);
    let (mut sum, mut square, mut moment) = (0.0, 0.0, 0.0);
    // One moment per chunk, because the line's rise within a chunk is negligible beside the chunk's scatter.
    for (index, chunk) in axis.chunks(LANES).enumerate() {
        let mut chunk_sum = 0.0;
        for x in chunk {
            chunk_sum += x - first;
            square += (x - first) * (x - first);
        }
        let middle = (index * LANES) as f64 + (chunk.len() as f64 - 1.0) / 2.0;
        sum += chunk_sum;
        moment += chunk_sum * (middle - (n - 1.0) / 2.0);
    }
    let energy = square - sum * sum / n;
    let line = 12.0 * moment * moment / (n * (n * n - 1.0));
    // An energy below the round-off of the sums counts as zero.
    if energy > 1e-12 * square && line.is_finite() {
        line / energy
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::hum::mains_line;
    use super::super::test_signals::{RATE_HZ, noise, plus, tone};
    use super::*;
    use crate::dsp::autocorrelation::Autocorrelation;
    use crate::recording::clipping::clipped_share;

    fn axes(axes: &[Vec<f64>], source_rate_hz: f64) -> Vec<Verdict> {
        samples(&Samples {
            axes: axes.to_vec(),
            source_rate_hz,
            clipped_share: clipped_share(axes),
        })
    }

    #[test]
    fn ordinary_recordings_pass() {
        let signal = noise(1);
        assert_eq!(
            axes(&[signal.clone(), noise(2), vec![9.81; 10_000]], RATE_HZ),
            []
        );
        assert_eq!(mains_line(&Autocorrelation::of(&signal, 400)), None);
        assert_eq!(axes(&[tone(100.0, 1.0).collect()], RATE_HZ), []);
    }

    #[test]
    fn what_is_cut_off_at_a_bound_is_clipped() {
        let clipped: Vec<f64> = noise(3).iter().map(|x| x.clamp(-0.8, 0.8)).collect();
        assert!(
            matches!(axes(&[noise(4), clipped], RATE_HZ)[..], [Verdict::Clipped { share }] if share > 0.01)
        );
    }

    #[test]
    fn a_slope_is_drift() {
        let signal = plus(&noise(5), (0..10_000).map(|n| f64::from(n) * 2e-4 + 3.0));
        assert!(matches!(
            axes(&[signal], RATE_HZ)[..],
            [Verdict::Drifting { .. }]
        ));
    }

    #[test]
    fn short_and_slow_recordings_are_told() {
        let verdicts = axes(&[noise(6)[..100].to_vec()], 2800.0);
        assert_eq!(verdicts[0], Verdict::TooShort { samples: 100 });
        assert_eq!(verdicts[1], Verdict::WrongRate { rate_hz: 2800.0 });
    }
}
