//! Single samples that deviate strongly from their neighbours, for example because of a bit error or a lost contact.

use super::axis::{Axis, fourth_differences, largest_fourth_difference};

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
    use super::*;
    use test_helpers::near;

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
