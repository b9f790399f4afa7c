//! Stretches in which a value does not change, because a converter stood still or samples were lost.

use super::axis::Axis;

/// Shortest hold, s. Shorter holds reduce the level of a recording by less than 0.1 dB even if there are ten per
/// second.
const LEAST_S: f64 = 2e-3;

/// Least number of samples of a hold, at any sample rate.
const LEAST_SAMPLES: usize = 6;

/// Duration, s, from which on a hold counts as silence, which the measures of the level detect.
const SILENCE_S: f64 = 0.1;

/// Number of samples on either side from which the probability of equal neighbours is estimated.
const SURROUNDINGS: usize = 64;

/// Largest expected number of natural runs, of a hold's length, in a whole recording.
const LARGEST_CHANCE: f64 = 1e-3;

/// A stretch in which the value does not change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub seconds: f64,
    /// True if the value is zero, which means that samples were lost rather than that a converter stood still.
    pub is_zero: bool,
}

impl Hold {
    /// Returns whether `next`, which starts later, overlaps this hold; if so, extends this hold over it.
    pub(super) fn joins(&mut self, next: &Self) -> bool {
        let overlaps = next.start_s <= self.start_s + self.seconds;
        if overlaps {
            let end = (self.start_s + self.seconds).max(next.start_s + next.seconds);
            self.seconds = end - self.start_s;
            self.is_zero |= next.is_zero;
        }
        overlaps
    }
}

/// Returns the holds of `axis` that are too long to be natural runs of equal values.
///
/// Quiet parts of a recording with coarse steps also have runs of equal values. If a fraction p of neighbours is equal,
/// a run of L samples is expected N p^(L-1) times in N samples. A run at the highest or lowest value is clipping.
pub(super) fn holds(axis: &Axis<'_>, rate_hz: f64) -> Vec<Hold> {
    let (low, high) = (axis.low, axis.high);
    let least = ((LEAST_S * rate_hz).round() as usize).max(LEAST_SAMPLES);
    let most = (SILENCE_S * rate_hz) as usize;
    let mut found = Vec::new();
    // Most recordings have too few equal neighbours for a run of this length.
    if axis.samples.len() < axis.changes + least {
        return found;
    }
    let axis = axis.samples;
    let mut first = 0;
    for end in 1..=axis.len() {
        if end < axis.len() && axis[end] == axis[first] {
            continue;
        }
        let (length, value) = (end - first, axis[first]);
        let is_extreme = value <= low || value >= high;
        if (least..most).contains(&length) && !is_extreme && is_unnatural(axis, first, end) {
            found.push(Hold {
                start_s: first as f64 / rate_hz,
                seconds: length as f64 / rate_hz,
                is_zero: value == 0.0,
            });
        }
        first = end;
    }
    found
}

fn is_unnatural(axis: &[f64], first: usize, end: usize) -> bool {
    let before = &axis[first.saturating_sub(SURROUNDINGS)..first];
    let after = &axis[end..(end + SURROUNDINGS).min(axis.len())];
    let share = |part: &[f64]| {
        let equal = part.windows(2).filter(|pair| pair[0] == pair[1]).count();
        // Laplace's rule of succession, because an event that did not occur among few samples is not impossible.
        (equal + 1) as f64 / (part.len() + 1) as f64
    };
    // A hold may lie between a quiet part, in which equal neighbours are natural, and a loud one.
    let p = share(before).max(share(after));
    axis.len() as f64 * p.powi((end - first) as i32 - 1) < LARGEST_CHANCE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform white noise that a converter rounded to whole steps, within a range of `steps`.
    fn rounded_noise(n: usize, steps: f64) -> Vec<f64> {
        let mut state = 1u64;
        (0..n)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                ((state >> 33) as f64 / f64::from(1u32 << 31) * steps).round() - 0.5 * steps
            })
            .collect()
    }

    #[test]
    fn a_converter_that_stands_still_is_found_and_coarse_steps_are_not() {
        let clean = rounded_noise(10_000, 1000.0);
        assert_eq!(holds(&Axis::of(&clean), 5000.0), []);
        assert_eq!(holds(&Axis::of(&rounded_noise(10_000, 2.0)), 5000.0), []);
        let mut stuck = clean.clone();
        let value = stuck[4000];
        stuck[4000..4020].fill(value);
        let found = holds(&Axis::of(&stuck), 5000.0);
        assert_eq!(found.len(), 1);
        assert!((found[0].start_s - 0.8).abs() < 1e-9 && (found[0].seconds - 0.004).abs() < 1e-9);
        assert!(!found[0].is_zero);
        stuck[4000..4020].fill(0.0);
        assert!(holds(&Axis::of(&stuck), 5000.0)[0].is_zero);
    }
}
