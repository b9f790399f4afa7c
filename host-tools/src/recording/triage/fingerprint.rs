//! Fingerprints of recordings, by which copies are found: equal ones, and those that were scaled, inverted or shifted.
//!
//! A recording is whitened by its own linear predictor, because the whitened vibrations of two takes of one surface are
//! uncorrelated whatever their common spectrum is. The largest peaks of the whitened signal are landmarks. The gaps
//! between four successive landmarks depend neither on the scale nor on the sign nor on the start of the recording, so
//! a copy shares them. What shares two of them at one shift is correlated there in full.
//!
//! A signal that its predictor explains but for round-off, such as a pure tone, has no whitened signal: any two tones
//! of a frequency are shifted copies of each other. Only equal samples make such signals copies.

use std::collections::HashMap;
use std::fmt;

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::linear_prediction::{Prediction, corrected};

/// Order of the predictor that whitens.
const ORDER: usize = 16;

/// Least share of a signal's energy that its predictor leaves; 16-bit round-off of a tone leaves 10⁻¹⁰.
const LEAST_RESIDUAL: f64 = 1e-8;

/// Number of samples on either side within which a landmark is the largest: 10 ms.
const LANDMARK_REACH: usize = 50;

/// Number of common landmarks at one shift from which two recordings are correlated.
const COMMON_LANDMARKS: usize = 2;

/// Past of the predictor and of the smoothing, in samples.
const PAST: usize = ORDER + 5;

/// Shortest overlap of two recordings that are compared, in samples: 0.2 s.
const LEAST_OVERLAP: usize = 1000;

/// Least correlation of a copy: noise 33 dB below the whitened original. Whitened takes by hand stay below 0.1. A drum
/// retraces its track in every turn, so that two forces at one speed reach 0.999 in the simulated rig.
pub const COPY_CORRELATION: f64 = 0.9995;

/// Lags on either side between which the correlation of a copy is interpolated.
const INTERPOLATED_LAGS: i64 = 6;

/// The content of a recording, to be compared with that of others.
#[derive(Clone, Debug)]
pub struct Fingerprint {
    /// Hash of the samples' bits.
    hash: u64,
    /// Signal with a mean of zero; empty if it is predictable.
    signal: Vec<f32>,
    /// Reflection coefficients of the predictor that whitens it.
    reflection: Vec<f64>,
    /// Positions of the landmarks, ascending.
    landmarks: Vec<u32>,
}

/// Relation of a copy to the recording that it was made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Factor from the original's samples to the copy's; negative if inverted.
    pub scale: f64,
    /// Position of the original's first sample in the copy, in samples; negative if the copy begins later.
    pub shift: i64,
    /// Correlation of the whitened signals where they overlap, at most 1.
    pub correlation: f64,
}

impl Likeness {
    /// Relation of equal samples.
    pub const EQUAL: Self = Self {
        scale: 1.0,
        shift: 0,
        correlation: 1.0,
    };
}

impl fmt::Display for Likeness {
    /// Writes what a copy differs in, nothing for equal samples: `, scaled by -0.5, shifted by 0.0200 s`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if (self.scale - 1.0).abs() > 1e-3 {
            write!(f, ", scaled by {:.3}", self.scale)?;
        }
        if self.shift != 0 {
            let seconds = self.shift as f64 / f64::from(SAMPLE_RATE_HZ);
            write!(f, ", shifted by {seconds:.4} s")?;
        }
        Ok(())
    }
}

/// Returns the fingerprint of a signal of one axis at 5 kHz, in any unit.
pub fn fingerprint(signal: &[f64]) -> Fingerprint {
    let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
    let centred: Vec<f32> = signal.iter().map(|x| (x - mean) as f32).collect();
    let reflection = whitening(&centred);
    Fingerprint {
        hash: hash(signal),
        landmarks: landmarks(&whitened(&centred, &reflection)),
        signal: if reflection.is_empty() {
            Vec::new()
        } else {
            centred
        },
        reflection,
    }
}

/// Returns how `copy` was made of `original`, or `None` if it was not.
///
/// A copy has equal samples, or a [correlation](COPY_CORRELATION) with the original over 0.2 s or more.
pub fn likeness(original: &Fingerprint, copy: &Fingerprint) -> Option<Likeness> {
    copies(&[original, copy])[1].map(|(_, likeness)| likeness)
}

/// Returns for each recording the index of the earliest that it is a copy of, and the relation to it.
pub fn copies(recordings: &[&Fingerprint]) -> Vec<Option<(usize, Likeness)>> {
    let mut first_with = HashMap::new();
    let mut index = LandmarkIndex::default();
    recordings
        .iter()
        .enumerate()
        .map(|(number, recording)| {
            if let Some(&equal) = first_with.get(&recording.hash) {
                return Some((equal, Likeness::EQUAL));
            }
            first_with.insert(recording.hash, number);
            let found = index
                .candidates(recording)
                .into_iter()
                .find_map(|(original, shift)| {
                    likeness_at(recordings[original], recording, shift)
                        .map(|found| (original, found))
                });
            index.insert(number, recording);
            found
        })
        .collect()
}

/// Gaps between four successive landmarks, in samples.
type Gaps = [u32; 3];

/// Landmarks of recordings by their gaps.
#[derive(Default)]
struct LandmarkIndex(HashMap<Gaps, Vec<(usize, u32)>>);

impl LandmarkIndex {
    fn insert(&mut self, number: usize, recording: &Fingerprint) {
        for (gaps, position) in recording.gaps() {
            self.0.entry(gaps).or_default().push((number, position));
        }
    }

    /// Returns the recordings with enough common landmarks at one shift, in their order, with that shift.
    fn candidates(&self, recording: &Fingerprint) -> Vec<(usize, i64)> {
        let mut shifts: HashMap<usize, Vec<i64>> = HashMap::new();
        for (gaps, position) in recording.gaps() {
            for near in neighbours(gaps) {
                for &(number, original) in self.0.get(&near).into_iter().flatten() {
                    let shift = i64::from(position) - i64::from(original);
                    shifts.entry(number).or_default().push(shift);
                }
            }
        }
        let mut found: Vec<(usize, i64)> = shifts
            .into_iter()
            .filter_map(|(number, shifts)| Some((number, commonest(shifts)?)))
            .collect();
        found.sort_unstable();
        found
    }
}

impl Fingerprint {
    fn gaps(&self) -> impl Iterator<Item = (Gaps, u32)> + '_ {
        self.landmarks.windows(4).map(|marks| {
            let gaps = [0, 1, 2].map(|gap| marks[gap + 1] - marks[gap]);
            (gaps, marks[0])
        })
    }
}

/// Gaps that differ by one sample at most, because a shift by part of a sample moves peaks.
fn neighbours(gaps: Gaps) -> impl Iterator<Item = Gaps> {
    (0..27u32).map(move |code| {
        let by = [code % 3, code / 3 % 3, code / 9];
        [0, 1, 2].map(|gap| gaps[gap] + by[gap] - 1)
    })
}

/// Returns the shift that occurs most often, give or take a sample, if it occurs often enough.
fn commonest(mut shifts: Vec<i64>) -> Option<i64> {
    shifts.sort_unstable();
    let within = |from: usize| shifts.partition_point(|&shift| shift <= shifts[from] + 2) - from;
    let best = (0..shifts.len()).max_by_key(|&from| within(from))?;
    let count = within(best);
    (count >= COMMON_LANDMARKS).then(|| shifts[best + count / 2])
}

/// Returns the relation of two recordings at `shift`, give or take two samples, if they are copies.
fn likeness_at(original: &Fingerprint, copy: &Fingerprint, shift: i64) -> Option<Likeness> {
    // One predictor whitens both, because a copy of a part has another one of its own.
    let first = whitened(&original.signal, &original.reflection);
    let second = whitened(&copy.signal, &original.reflection);
    let products = |shift: i64| {
        let a = first.get((-shift).max(0) as usize..)?;
        let b = second.get(shift.max(0) as usize..)?;
        let length = a.len().min(b.len());
        // At the start of either recording its filters have no past.
        (length >= LEAST_OVERLAP).then(|| correlate(&a[PAST..length], &b[PAST..length]))
    };
    let (shift, at) = (shift - 2..=shift + 2)
        .filter_map(|shift| Some((shift, products(shift)?)))
        .max_by(|a, b| a.1.correlation.abs().total_cmp(&b.1.correlation.abs()))?;
    let lags: Vec<(f64, f64)> = (-INTERPOLATED_LAGS..=INTERPOLATED_LAGS)
        .filter_map(|lag| Some((lag as f64, products(shift + lag)?.correlation)))
        .collect();
    // A copy that is shifted by part of a sample has its maximum between two lags. The correlation is band-limited, so
    // that a windowed sinc finds it (Lanczos).
    let between = |lag: f64| {
        lags.iter()
            .map(|(at, value)| value * lanczos(lag - at))
            .sum::<f64>()
    };
    let correlation = (-10..=10)
        .map(|step| between(f64::from(step) / 20.0).abs())
        .fold(at.correlation.abs(), f64::max)
        .min(1.0);
    (correlation >= COPY_CORRELATION).then_some(Likeness {
        scale: at.ratio.copysign(at.correlation),
        shift,
        correlation,
    })
}

fn lanczos(x: f64) -> f64 {
    let sinc = |x: f64| {
        let angle = std::f64::consts::PI * x;
        if angle == 0.0 {
            1.0
        } else {
            angle.sin() / angle
        }
    };
    sinc(x) * sinc(x / (INTERPOLATED_LAGS as f64 + 0.5))
}

struct Correlated {
    /// Correlation, -1 to 1.
    correlation: f64,
    /// RMS of the second by that of the first.
    ratio: f64,
}

fn correlate(a: &[f32], b: &[f32]) -> Correlated {
    let (aa, bb) = (inner_product(a, a), inner_product(b, b));
    let both = (aa * bb).sqrt();
    Correlated {
        correlation: if both > 0.0 {
            inner_product(a, b) / both
        } else {
            0.0
        },
        ratio: if aa > 0.0 { (bb / aa).sqrt() } else { 0.0 },
    }
}

/// Reflection coefficients of the predictor of `signal`; none for a signal that is predictable.
fn whitening(signal: &[f32]) -> Vec<f64> {
    if signal.len() <= 2 * ORDER {
        return Vec::new();
    }
    let lag = |lag: usize| inner_product(&signal[..signal.len() - lag], &signal[lag..]);
    let lags: Vec<f64> = (0..=ORDER).map(lag).collect();
    let prediction = Prediction::levinson_durbin(&corrected(lags), ORDER);
    let left = prediction.error_power.last().copied().unwrap_or(0.0);
    if left <= LEAST_RESIDUAL * prediction.error_power[0] || !left.is_finite() {
        return Vec::new();
    }
    prediction.reflection
}

/// Prediction error of `signal`, smoothed below about 800 Hz; empty without coefficients.
fn whitened(signal: &[f32], reflection: &[f64]) -> Vec<f32> {
    if reflection.is_empty() {
        return Vec::new();
    }
    let mut backward = [0.0; ORDER];
    let mut recent = [0.0; 5];
    let smooth = |x: &f32| {
        let mut forward = f64::from(*x);
        let mut carried = forward;
        for (delayed, k) in backward.iter_mut().zip(reflection) {
            let next = *delayed + k * forward;
            forward += k * *delayed;
            *delayed = carried;
            carried = next;
        }
        recent.rotate_right(1);
        recent[0] = forward;
        let binomial = recent[0] + recent[4] + 4.0 * (recent[1] + recent[3]) + 6.0 * recent[2];
        (binomial / 16.0) as f32
    };
    signal.iter().map(smooth).collect()
}

/// Positions at which the magnitude is the largest within [`LANDMARK_REACH`].
fn landmarks(whitened: &[f32]) -> Vec<u32> {
    let is_landmark = |&middle: &usize| {
        let top = whitened[middle].abs();
        let before = &whitened[middle - LANDMARK_REACH..middle];
        let after = &whitened[middle + 1..=middle + LANDMARK_REACH];
        // The neighbours come first, because they rule out most samples.
        before.iter().rev().all(|x| x.abs() < top) && after.iter().all(|x| x.abs() <= top)
    };
    let last = whitened.len().saturating_sub(LANDMARK_REACH);
    (LANDMARK_REACH..last)
        .filter(is_landmark)
        .map(|middle| middle as u32)
        .collect()
}

fn inner_product<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| a.into() * b.into()).sum()
}

/// Hash of the samples' bits. It is compared within one run and never stored, because Rust may change its hash
/// function.
fn hash(signal: &[f64]) -> u64 {
    use std::hash::{DefaultHasher, Hasher};
    let mut hasher = DefaultHasher::new();
    hasher.write_usize(signal.len());
    // Eight independent lanes, because the processor can then overlap their multiplications.
    let mut mixed = [0u64; 8];
    for chunk in signal.chunks(8) {
        for (mix, sample) in mixed.iter_mut().zip(chunk) {
            *mix = (mix.rotate_left(5) ^ sample.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        }
    }
    mixed.into_iter().for_each(|mix| hasher.write_u64(mix));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus, tone};
    use super::*;

    fn found(original: &[f64], copy: &[f64]) -> Option<Likeness> {
        likeness(&fingerprint(original), &fingerprint(copy))
    }

    #[test]
    fn other_recordings_of_one_spectrum_are_no_copies() {
        let prints: Vec<_> = (1..20).map(|seed| fingerprint(&noise(seed))).collect();
        let all: Vec<&Fingerprint> = prints.iter().collect();
        assert!(copies(&all).iter().all(Option::is_none));
        assert_eq!(
            found(
                &tone(100.0, 1.0).collect::<Vec<_>>(),
                &tone(100.0, 0.9).collect::<Vec<_>>()
            ),
            None
        );
    }

    #[test]
    fn equal_samples_are_a_copy_even_of_a_tone() {
        for signal in [noise(1), tone(100.0, 1.0).collect()] {
            assert_eq!(found(&signal, &signal.clone()), Some(Likeness::EQUAL));
        }
    }

    #[test]
    fn scale_sign_and_shift_of_a_copy_are_found() {
        let original = noise(3);
        let scaled: Vec<f64> = original.iter().map(|x| -0.37 * x).collect();
        let likeness = found(&original, &scaled).unwrap();
        assert!(
            (likeness.scale + 0.37).abs() < 1e-3 && likeness.shift == 0,
            "{likeness:?}"
        );
        for shift in [-6000i64, -41, 250, 7000] {
            let (skip, pad) = ((-shift).max(0) as usize, shift.max(0) as usize);
            let before = noise(4)[..pad].to_vec();
            let copy: Vec<f64> = before
                .into_iter()
                .chain(original[skip..].iter().copied())
                .collect();
            let likeness = found(&original, &copy).unwrap();
            assert_eq!(likeness.shift, shift, "{likeness:?}");
        }
    }

    #[test]
    fn a_copy_between_the_samples_and_one_under_noise_are_found() {
        let wide = noise(5);
        let smooth: Vec<f64> = wide.windows(3).map(|w| w.iter().sum()).collect();
        let double = crate::recording::resample(std::slice::from_ref(&smooth), 5000, 10_000)
            .unwrap()
            .remove(0);
        let half: Vec<f64> = double.iter().skip(1).step_by(2).copied().collect();
        assert!(found(&smooth, &half).is_some());
        let noisy = plus(&wide, noise(6).into_iter().map(|x| 0.01 * x));
        assert!(found(&wide, &noisy).is_some());
    }

    /// A drum that passes the same track again, under another force.
    #[test]
    fn a_track_that_is_retraced_is_no_copy() {
        let track = noise(7);
        let pass = |seed: u64| plus(&track, noise(seed).into_iter().map(|x| 0.1 * x));
        assert_eq!(found(&pass(8), &pass(9)), None);
    }

    #[test]
    fn the_earliest_original_is_named() {
        let (a, b) = (noise(7), noise(8));
        let twice: Vec<f64> = b.iter().map(|x| 2.0 * x).collect();
        let prints = [&a, &b, &twice, &b].map(|signal| fingerprint(signal));
        let found = copies(&prints.iter().collect::<Vec<_>>());
        let originals: Vec<_> = found
            .iter()
            .map(|copy| copy.map(|(original, _)| original))
            .collect();
        assert_eq!(originals, [None, None, Some(1), Some(1)]);
    }
}
