//! The relation of two recordings at a shift: the correlation of what whitening by one predictor leaves of them.

use std::fmt;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};

use super::whitening::{PAST, Stretch, Whitening};
use crate::dsp::sums::{dot, dot_inlined};
use crate::dsp::wide;

/// Shortest overlap of two recordings that are compared, in samples: 0.2 s.
const LEAST_OVERLAP: usize = 1000;

/// Least correlation of a copy: noise 33 dB below the whitened original. Whitened takes by hand stay below 0.1. A drum
/// retraces its track in every turn, so that two forces at one speed reach 0.999 in the simulated rig.
pub const COPY_CORRELATION: f64 = 0.9995;

/// Lags on either side between which the correlation of a copy is interpolated.
const INTERPOLATED_LAGS: i64 = 6;

/// Correlation at the best whole shift below which two recordings are no copies, whatever lies between two shifts: the
/// smoothed signals of a copy that is shifted by half a sample have 0.9 there.
const LEAST_WHOLE_CORRELATION: f64 = 0.5;

/// Shifts on either side of the expected one that are compared in full.
const SHIFTS: i64 = 2;

/// Largest gain of the interpolation between two lags at any frequency.
const INTERPOLATION_GAIN: f64 = 1.03;

/// Largest sum of the magnitudes of the interpolation's weights.
const INTERPOLATION_WEIGHTS: f64 = 2.03;

/// Bound of the correlation below which nothing is compared in full. It is below [`COPY_CORRELATION`] by more than the
/// few samples at the ends make that are compared at some lags only.
const UNLIKE_CORRELATION: f64 = 0.99;

/// Relation of a copy to the recording that it was made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

/// A signal that others are compared with.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Content {
    /// Samples with a mean of zero; empty if they are predictable.
    pub signal: Vec<f32>,
    /// Its whitening.
    pub whitening: Whitening,
}

impl Content {
    /// The content of a signal with a mean of zero, and the signal whitened.
    pub fn of(centred: Vec<f32>) -> (Self, Vec<f32>) {
        let (whitening, whitened) = Whitening::of(&centred);
        let signal = if whitening.is_empty() {
            Vec::new()
        } else {
            centred
        };
        (Self { signal, whitening }, whitened)
    }
}

/// Returns the relation of two recordings at `shift`, give or take two samples, if they are copies.
pub(super) fn likeness_at(original: &Content, copy: &[f32], shift: i64) -> Option<Likeness> {
    if is_unlike_in_part(original, copy, shift) {
        return None;
    }
    // One predictor whitens both, because a copy of a part has another one of its own.
    let first = Whitened::of(&original.signal, &original.whitening);
    let second = Whitened::of(copy, &original.whitening);
    let products = |shift: i64| {
        let (a, b) = ((-shift).max(0) as usize, shift.max(0) as usize);
        let rest = |signal: &Whitened, from: usize| signal.samples.len().checked_sub(from);
        let length = rest(&first, a)?.min(rest(&second, b)?);
        // At the start of either recording its filters have no past.
        (length >= LEAST_OVERLAP)
            .then(|| correlate(&first, a + PAST, &second, b + PAST, length - PAST))
    };
    let (shift, at) = (shift - SHIFTS..=shift + SHIFTS)
        .filter_map(|shift| Some((shift, products(shift)?)))
        .max_by(|a, b| a.1.correlation.abs().total_cmp(&b.1.correlation.abs()))?;
    if at.correlation.abs() < LEAST_WHOLE_CORRELATION {
        return None;
    }
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

/// Returns whether the correlation of two recordings in a strong part of the `original` is so low that they are
/// no copies at `shift`, whatever the rest of them is: few recordings with common landmarks are copies, and most others
/// are done with here.
///
/// If the part has the share x of the original's energy and at most the correlation p, and the rest is as alike as it
/// can be, the correlation of the whole is at most √(p² x + g² (1 - x)) by the inequality of Cauchy and Schwarz. The
/// interpolation between two lags has a gain of at most g, and takes at most the sum of its weights from p.
fn is_unlike_in_part(original: &Content, copy: &[f32], shift: i64) -> bool {
    let (length, reach) = (original.signal.len() as i64, SHIFTS + INTERPOLATED_LAGS);
    // Samples of the original that are compared at one of the shifts, and those that are compared at all of them.
    let compared = |lowest: i64, highest: i64| {
        let start = PAST as i64 + (-lowest).max(0);
        let end = length.min(copy.len() as i64 - highest);
        start as usize..end.max(start) as usize
    };
    let all = compared(shift + reach, shift - reach);
    let within = compared(shift - reach, shift + reach);
    let Some(Stretch { range, share }) = original.whitening.strongest(&within, &all) else {
        return false;
    };
    let at = |place: usize, by: i64| (place as i64 + shift + by) as usize;
    let there = at(range.start, -reach)..at(range.end, reach);
    let own = original.whitening.part(&original.signal, range);
    let (Some(own), Some(there)) = (own, original.whitening.part(copy, there)) else {
        return false;
    };
    let most = wide(
        #[inline(always)]
        || {
            let energy = dot_inlined(&own, &own);
            let correlations = there.windows(own.len().max(1)).map(|there| {
                let both = (energy * dot_inlined(there, there)).sqrt();
                let product = dot_inlined(&own, there).abs();
                if both > 0.0 { product / both } else { 1.0 }
            });
            correlations.fold(0.0, f64::max)
        },
    );
    let interpolated = INTERPOLATION_WEIGHTS * most;
    let bound = interpolated * interpolated * share
        + INTERPOLATION_GAIN * INTERPOLATION_GAIN * (1.0 - share);
    bound < UNLIKE_CORRELATION * UNLIKE_CORRELATION
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

/// A whitened signal, with the sums of the squares of its first samples.
struct Whitened {
    samples: Vec<f32>,
    energy: Vec<f64>,
}

impl Whitened {
    fn of(signal: &[f32], whitening: &Whitening) -> Self {
        let samples = whitening.whitened(signal);
        let mut sum = 0.0;
        let squares = samples.iter().map(|&x| {
            sum += f64::from(x) * f64::from(x);
            sum
        });
        Self {
            energy: std::iter::once(0.0).chain(squares).collect(),
            samples,
        }
    }
}

/// Correlates `length` samples of `first` from sample `a` on with those of `second` from `b` on.
fn correlate(first: &Whitened, a: usize, second: &Whitened, b: usize, length: usize) -> Correlated {
    let aa = first.energy[a + length] - first.energy[a];
    let bb = second.energy[b + length] - second.energy[b];
    let both = (aa * bb).sqrt();
    let product = dot(
        &first.samples[a..a + length],
        &second.samples[b..b + length],
    );
    Correlated {
        correlation: if both > 0.0 { product / both } else { 0.0 },
        ratio: if aa > 0.0 { (bb / aa).sqrt() } else { 0.0 },
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus};
    use super::*;

    fn content(signal: &[f64]) -> Content {
        Content::of(signal.iter().map(|&x| x as f32).collect()).0
    }

    #[test]
    fn the_interpolation_has_the_gain_and_the_weights_that_the_bound_takes() {
        let (mut gain, mut sum) = (0.0_f64, 0.0_f64);
        for step in -10..=10 {
            let lags = -INTERPOLATED_LAGS..=INTERPOLATED_LAGS;
            let weights: Vec<f64> = lags
                .map(|lag| lanczos(f64::from(step) / 20.0 - lag as f64))
                .collect();
            sum = sum.max(weights.iter().map(|weight| weight.abs()).sum());
            for frequency in 0..=1000 {
                let angle = std::f64::consts::PI * f64::from(frequency) / 1000.0;
                let (mut re, mut im) = (0.0, 0.0);
                for (lag, weight) in weights.iter().enumerate() {
                    re += weight * (angle * lag as f64).cos();
                    im += weight * (angle * lag as f64).sin();
                }
                gain = gain.max(re.hypot(im));
            }
        }
        assert!(gain < INTERPOLATION_GAIN && gain > 1.02, "{gain}");
        assert!(sum < INTERPOLATION_WEIGHTS && sum > 2.02, "{sum}");
    }

    /// A copy whose quiet part is buried in noise is still one, and what differs in its loudest part is none.
    #[test]
    fn a_part_settles_only_what_the_whole_would() {
        let original = noise(1);
        let mut uneven = original.clone();
        uneven[2500..].iter_mut().for_each(|x| *x *= 1e-3);
        let buried = plus(&uneven, noise(2).into_iter().map(|x| 1e-3 * x));
        let single = |signal: &[f64]| signal.iter().map(|&x| x as f32).collect::<Vec<_>>();
        assert!(!is_unlike_in_part(&content(&uneven), &single(&buried), 0));
        assert!(likeness_at(&content(&uneven), &single(&buried), 0).is_some());
        let mut other = uneven.clone();
        other[..2500].copy_from_slice(&noise(3)[..2500]);
        assert!(is_unlike_in_part(&content(&uneven), &single(&other), 0));
        // At another shift, the part is one of what both have; where it has none, all of it is compared.
        for (shift, from) in [(-5000, 5000), (-8800, 8800), (-9500, 9500)] {
            let copy = single(&original[from..]);
            assert!(!is_unlike_in_part(&content(&original), &copy, shift));
            let other = single(&noise(4)[from..]);
            let is_unlike = is_unlike_in_part(&content(&original), &other, shift);
            assert_eq!(is_unlike, from < 9500);
            let late = is_unlike_in_part(&content(&noise(4)), &single(&original), -shift);
            assert_eq!(late, from < 9500);
        }
    }

    /// Takes with more and more of one signal in common.
    #[test]
    fn what_a_part_settles_is_no_copy() {
        let (track, own) = (noise(4), noise(5));
        let original = content(&track);
        let mut settled = 0;
        for step in 0..=20 {
            let share = f64::from(step) / 20.0;
            let other: Vec<f32> = track
                .iter()
                .zip(&own)
                .map(|(a, b)| (share * a + (1.0 - share) * b) as f32)
                .collect();
            let first = Whitened::of(&original.signal, &original.whitening);
            let second = Whitened::of(&other, &original.whitening);
            let whole = correlate(&first, PAST, &second, PAST, track.len() - PAST);
            if is_unlike_in_part(&original, &other, 0) {
                settled += 1;
                assert!(whole.correlation.abs() < UNLIKE_CORRELATION, "{share}");
            }
        }
        assert!((4..18).contains(&settled), "{settled}");
    }
}
