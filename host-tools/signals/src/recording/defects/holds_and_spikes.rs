//! Stretches in which a value does not change, because a converter stood still or samples were lost; and single samples
//! that deviate strongly from their neighbours, for example because of a bit error or a lost contact.

use super::{Axis, fourth_differences, largest_fourth_difference};

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

/// Number of samples on either side above which a spike must stand out.
pub(super) const REACH: usize = 48;

/// Number of samples on either side that a spike itself disturbs.
const OWN: usize = 5;

/// Least ratio of a spike's fourth difference to the largest fourth difference around it.
///
/// Impulses of real contacts reach 12.8 at 5 kHz, and 10 at 44.1 kHz. At a ratio of 20, one spike is about 60 standard
/// deviations high and adds about a third to the energy of 2 s at 5 kHz. A spike of half that height adds 0.4 dB.
const RATIO: f64 = 20.0;

/// Lower bound of the background, as a fraction of the axis's standard deviation, because a spike in a quiet part
/// matters less.
const BACKGROUND_SHARE: f64 = 0.05;

/// A sample that deviates strongly from its neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spike {
    /// Time, s.
    pub time_s: f64,
    /// Ratio of the spike's fourth difference to the largest fourth difference around it.
    pub ratio: f64,
}

/// Returns the spikes of `axis`. The fourth difference distinguishes a single sample from movements that also include
/// the samples before and after it.
pub(super) fn spikes(axis: &Axis<'_>, rate_hz: f64) -> Vec<Spike> {
    let least = BACKGROUND_SHARE * axis.deviation;
    // Few recordings have such a large difference; all others are finished here.
    if largest_fourth_difference(axis.samples) <= RATIO * least {
        return Vec::new();
    }
    let difference = fourth_differences(axis.samples);
    let mut found = Vec::new();
    for (n, &top) in difference.iter().enumerate() {
        if top <= RATIO * least {
            continue;
        }
        let before = &difference[n.saturating_sub(REACH)..n.saturating_sub(OWN)];
        let after = &difference[(n + OWN + 1).min(difference.len())..(n + REACH).min(difference.len())];
        let own = &difference[n.saturating_sub(OWN)..(n + OWN + 1).min(difference.len())];
        // From the spike outwards, where something larger is found soonest.
        let stands_out = before.iter().rev().chain(after).all(|x| RATIO * x < top);
        // At an end of the recording, the samples on one side are enough.
        if stands_out && own.iter().all(|&x| x <= top) && before.len() + after.len() >= REACH - OWN {
            let around = before.iter().chain(after).fold(least, |a, &b| a.max(b));
            found.push(Spike {
                // The first difference is that around the third sample.
                time_s: (n + 2) as f64 / rate_hz,
                ratio: top / around,
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use test_helpers::near;

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

    #[test]
    fn a_spike_is_found_where_it_is_and_a_short_vibration_is_none() {
        let mut signal: Vec<f64> = (0..5000).map(|n| (0.3 * f64::from(n)).sin()).collect();
        assert_eq!(spikes(&Axis::of(&signal), 5000.0), []);
        signal[2500] += 30.0;
        let found = spikes(&Axis::of(&signal), 5000.0);
        assert_eq!(found.len(), 1);
        near(found[0].time_s, 0.5, 1e-9);
        let ring: Vec<f64> = (0..5000)
            .map(|n| {
                let since = f64::from(n - 2500);
                if n < 2500 {
                    0.0
                } else {
                    30.0 * (-since / 40.0).exp() * since.sin()
                }
            })
            .collect();
        assert_eq!(spikes(&Axis::of(&ring), 5000.0), []);
    }
}
