//! What is wrong with a recording, if anything, before it is fitted.
//!
//! | verdict | found when | what `fit` does |
//! |---|---|---|
//! | ok | nothing below | uses it |
//! | silent | the RMS about the mean is below the silence floor | makes a silent node |
//! | too short | fewer than [`SHORT_SAMPLES`] samples | uses it with a lower order, warns |
//! | clipped | at least [`CLIPPED_SHARE`] of an axis's samples stand at its extreme in runs | uses it, warns |
//! | drifting | a straight line explains [`DRIFT_SHARE`] of an axis's energy, or more | uses it, warns |
//! | hum | a line at 50 or 60 Hz stands [`HUM_RATIO_DB`] above its surroundings, whatever the speed | uses it, warns |
//! | duplicate | every sample equals that of an earlier trial | uses it, warns |
//! | wrong rate | the file's sample rate is below the models' | uses it, warns: there is nothing above its half |
//! | not finite | a sample is NaN or infinite | refuses the whole set |
//!
//! A trial that is used in spite of a verdict marks its node as doubtful.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::dsp::MODEL_RATE_HZ;
use crate::dsp::autocorrelation::Autocorrelation;
use crate::recording::samples::Samples;

/// Trials of fewer samples are too short: 0.4 s at 5 kHz.
pub const SHORT_SAMPLES: usize = 2000;

/// Share of samples at the extremes from which a recording counts as clipped.
pub const CLIPPED_SHARE: f64 = 1e-3;

/// Share of an axis's energy that a straight line explains, from which it counts as drifting.
pub const DRIFT_SHARE: f64 = 0.05;

/// How far above its surroundings a mains line must stand, dB.
pub const HUM_RATIO_DB: f64 = 20.0;

/// Mains frequencies, Hz.
const MAINS_HZ: [f64; 2] = [50.0, 60.0];

/// RMS below which a recording is silent unless it is set otherwise, m/s²: less than any accelerometer's own noise.
pub const SILENCE_FLOOR_M_S2: f64 = 1e-3;

/// A finding about a trial.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Nothing but at most a constant.
    Silent,
    /// Too few samples for a good model.
    TooShort {
        /// How many there are.
        samples: usize,
    },
    /// Samples cut off at the end of the range.
    Clipped {
        /// Share of the samples, of the worst axis.
        share: f64,
    },
    /// A slope under the vibration.
    Drifting {
        /// Share of the energy, of the worst axis.
        share: f64,
    },
    /// A line from the mains.
    Hum {
        /// Its frequency, Hz.
        frequency_hz: f64,
    },
    /// The same samples as another trial.
    Duplicate {
        /// Index of the earlier trial.
        of: usize,
    },
    /// Sampled more slowly than the models are.
    WrongRate {
        /// The file's rate, Hz.
        rate_hz: f64,
    },
}

impl Verdict {
    /// One word or two, as users name it on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::TooShort { .. } => "too-short",
            Self::Clipped { .. } => "clipped",
            Self::Drifting { .. } => "drifting",
            Self::Hum { .. } => "hum",
            Self::Duplicate { .. } => "duplicate",
            Self::WrongRate { .. } => "wrong-rate",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("silent"),
            Self::TooShort { samples } => write!(f, "too short: {samples} samples"),
            Self::Clipped { share } => write!(f, "clipped: {:.2} % of samples", share * 100.0),
            Self::Drifting { share } => write!(f, "drifting: {:.0} % of energy", share * 100.0),
            Self::Hum { frequency_hz } => write!(f, "hum at {frequency_hz:.1} Hz"),
            Self::Duplicate { of } => write!(f, "duplicate of trial {}", of + 1),
            Self::WrongRate { rate_hz } => write!(
                f,
                "wrong rate: {rate_hz} Hz, nothing above {} Hz",
                rate_hz / 2.0
            ),
        }
    }
}

impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Findings that need nothing but the trial itself.
pub fn samples(samples: &Samples) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let axes = samples.axes.as_slice();
    let source_rate_hz = samples.source_rate_hz;
    let count = axes.first().map_or(0, Vec::len);
    if count < SHORT_SAMPLES {
        verdicts.push(Verdict::TooShort { samples: count });
    }
    if source_rate_hz < f64::from(MODEL_RATE_HZ) {
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

/// Lanes that a compiler keeps in vector registers.
const LANES: usize = 8;

/// Share of the energy about the mean that a straight line explains.
fn drift_share(axis: &[f64]) -> f64 {
    let n = axis.len() as f64;
    let first = axis.first().copied().unwrap_or(0.0);
    let (mut sum, mut square, mut moment) = (0.0, 0.0, 0.0);
    // Within a chunk the line's own rise is nothing beside the chunk's scatter: one moment a chunk.
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
    // Below the rounding of the sums there is no energy to speak of.
    if energy > 1e-12 * square && line.is_finite() {
        line / energy
    } else {
        0.0
    }
}

/// Frequency of a mains line in the spectrum of a reduced trial, Hz.
///
/// A texture's own line may fall on a mains frequency at one speed; [`confirmed_hum`] tells the two apart.
pub fn mains_line(autocorrelation: &Autocorrelation) -> Option<f64> {
    let bin_hz = f64::from(MODEL_RATE_HZ) / autocorrelation.transform_length as f64;
    let power = &autocorrelation.power;
    let bins = |from_hz: f64, to_hz: f64| {
        let from = (from_hz / bin_hz).round() as usize;
        let to = ((to_hz / bin_hz).round() as usize).min(power.len());
        from.min(to)..to
    };
    MAINS_HZ.into_iter().find_map(|mains| {
        let line = bins(mains - 1.0, mains + 1.0);
        let peak = line.max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
        let mut around: Vec<f64> = bins(mains - 10.0, mains - 3.0)
            .chain(bins(mains + 3.0, mains + 10.0))
            .map(|bin| power[bin])
            .collect();
        around.sort_by(f64::total_cmp);
        let median = *around.get(around.len() / 2)?;
        let ratio = 10f64.powf(HUM_RATIO_DB / 10.0);
        (power[peak] > ratio * median && power[peak] > 0.0).then_some(peak as f64 * bin_hz)
    })
}

/// Which of a texture's trials hum, given each one's speed and mains line: a line that stays at its frequency while the
/// speed changes is the mains', one that comes at a single speed is the texture's own.
///
/// With one or two speeds nothing tells them apart, and every line counts.
pub fn confirmed_hum(trials: &[(f64, Option<f64>)]) -> Vec<Option<f64>> {
    let speeds = |lines_only: bool| {
        let mut speeds: Vec<f64> = trials
            .iter()
            .filter(|(_, line)| !lines_only || line.is_some())
            .map(|&(speed, _)| speed)
            .collect();
        speeds.sort_by(f64::total_cmp);
        speeds.dedup();
        speeds.len()
    };
    let (all, with_line) = (speeds(false), speeds(true));
    let mains = all <= 2 || 2 * with_line >= all;
    trials
        .iter()
        .map(|&(_, line)| line.filter(|_| mains))
        .collect()
}

/// A number that equal samples share and others practically never do.
pub fn fingerprint(axes: &[Vec<f64>]) -> u64 {
    use std::hash::{DefaultHasher, Hasher};
    let mut hasher = DefaultHasher::new();
    for axis in axes {
        hasher.write_usize(axis.len());
        // Mixing eight samples a step keeps this far below the cost of reading them.
        let mut mixed = [0u64; 8];
        for chunk in axis.chunks(8) {
            for (mix, sample) in mixed.iter_mut().zip(chunk) {
                *mix = (mix.rotate_left(5) ^ sample.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            }
        }
        mixed.into_iter().for_each(|mix| hasher.write_u64(mix));
    }
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::clipping::clipped_share;
    use rand::{RngExt, SeedableRng};

    const RATE: f64 = MODEL_RATE_HZ as f64;

    fn noise(seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..10_000)
            .map(|_| rng.random_range(-1.0..1.0) + rng.random_range(-1.0..1.0))
            .collect()
    }

    fn tone(frequency_hz: f64, amplitude: f64) -> impl Iterator<Item = f64> {
        let step = core::f64::consts::TAU * frequency_hz / RATE;
        (0..10_000).map(move |n| amplitude * (step * f64::from(n)).sin())
    }

    fn plus(signal: &[f64], other: impl Iterator<Item = f64>) -> Vec<f64> {
        signal.iter().zip(other).map(|(a, b)| a + b).collect()
    }

    fn axes(axes: &[Vec<f64>], source_rate_hz: f64) -> Vec<Verdict> {
        samples(&Samples {
            axes: axes.to_vec(),
            source_rate_hz,
            clipped_share: clipped_share(axes),
        })
    }

    fn line_of(signal: &[f64]) -> Option<f64> {
        mains_line(&Autocorrelation::of(signal, 400))
    }

    #[test]
    fn ordinary_recordings_pass() {
        let signal = noise(1);
        assert_eq!(
            axes(&[signal.clone(), noise(2), vec![9.81; 10_000]], RATE),
            []
        );
        assert_eq!(line_of(&signal), None);
        assert_eq!(axes(&[tone(100.0, 1.0).collect()], RATE), []);
    }

    #[test]
    fn what_is_cut_off_at_a_bound_is_clipped() {
        let clipped: Vec<f64> = noise(3).iter().map(|x| x.clamp(-0.8, 0.8)).collect();
        assert!(
            matches!(axes(&[noise(4), clipped], RATE)[..], [Verdict::Clipped { share }] if share > 0.01)
        );
    }

    #[test]
    fn a_slope_is_drift() {
        let signal = plus(&noise(5), (0..10_000).map(|n| f64::from(n) * 2e-4 + 3.0));
        assert!(matches!(
            axes(&[signal], RATE)[..],
            [Verdict::Drifting { .. }]
        ));
    }

    #[test]
    fn short_and_slow_recordings_are_told() {
        let verdicts = axes(&[noise(6)[..100].to_vec()], 2800.0);
        assert_eq!(verdicts[0], Verdict::TooShort { samples: 100 });
        assert_eq!(verdicts[1], Verdict::WrongRate { rate_hz: 2800.0 });
    }

    #[test]
    fn mains_lines_are_found_with_their_frequency_and_others_are_not() {
        for frequency_hz in [50.0, 59.9] {
            let found = line_of(&plus(&noise(7), tone(frequency_hz, 0.3))).unwrap();
            assert!((found - frequency_hz).abs() < 0.5, "{found}");
        }
        assert_eq!(line_of(&plus(&noise(8), tone(70.0, 0.5))), None);
        assert_eq!(line_of(&vec![0.0; 10_000]), None);
    }

    #[test]
    fn a_textures_own_line_is_not_hum_and_one_at_all_speeds_is() {
        let speeds = [40.0, 50.0, 60.0, 80.0];
        let own: Vec<_> = speeds.map(|v| (v, (v == 50.0).then_some(50.0))).to_vec();
        assert!(confirmed_hum(&own).iter().all(Option::is_none));
        let mains: Vec<_> = speeds.map(|v| (v, Some(50.1))).to_vec();
        assert!(confirmed_hum(&mains).iter().all(Option::is_some));
        assert_eq!(confirmed_hum(&[(100.0, Some(60.0))]), [Some(60.0)]);
    }

    #[test]
    fn fingerprints_tell_samples_apart_and_not_copies() {
        let (a, b) = (vec![noise(1)], vec![noise(2)]);
        assert_eq!(fingerprint(&a), fingerprint(&a.clone()));
        assert_ne!(fingerprint(&a), fingerprint(&b));
        let mut close = a.clone();
        close[0][9999] += 1e-12;
        assert_ne!(fingerprint(&a), fingerprint(&close));
    }
}
