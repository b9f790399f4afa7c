//! Copies among recordings: equal ones, and scaled ones.
//!
//! Two takes of a surface are uncorrelated, and a copy has a correlation of 1 with its original. The correlation of two
//! signals is estimated from a sketch of each: sums of its samples with random signs, which are the same for all
//! signals (a random projection as in Achlioptas, 2003, doi:10.1016/S0022-0000(03)00025-4). Before that, signals are
//! differenced twice, because the strong low frequencies of a drum that retraces its track are the same in every turn.

use serde::{Deserialize, Serialize};
use stylus_dsp::wide;

/// Number of sums in a sketch: one for each bit of a hash.
const SUMS: usize = 64;

/// Largest mean square of the differences between the sums of two copies, both of unit energy. It corresponds to a
/// correlation of 0.9995.
///
/// A drum retraces its track in every turn, so trials with two forces at the same speed reach 0.999 in the simulated
/// rig.
const COPY_DIFFERENCE: f64 = 1e-3;

/// A signal's sums with random signs, scaled to unit energy of the signal, and this energy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sketch {
    /// The sums; empty for a signal without energy.
    sums: Vec<f32>,
    energy: f64,
}

impl Sketch {
    /// Computes the sketch of a signal of one axis, in any unit.
    pub fn of(signal: &[f64]) -> Self {
        let mut sums = [0.0; SUMS];
        let mut energy = 0.0;
        wide(
            #[inline(always)]
            || {
                for (place, window) in (0u64..).zip(signal.windows(3)) {
                    let x = window[0] - 2.0 * window[1] + window[2];
                    energy += x * x;
                    let signs = mixed(place);
                    for (bit, sum) in sums.iter_mut().enumerate() {
                        *sum += if (signs >> bit) & 1 == 0 { x } else { -x };
                    }
                }
            },
        );
        let scale = 1.0 / energy.sqrt();
        let scaled = sums.iter().map(|sum| (sum * scale) as f32);
        Self {
            sums: if scale.is_finite() {
                scaled.collect()
            } else {
                Vec::new()
            },
            energy,
        }
    }

    /// Returns whether two signals are copies of each other.
    fn is_copy_of(&self, other: &Self) -> bool {
        let most = COPY_DIFFERENCE * SUMS as f64;
        let mut square = 0.0;
        // Most pairs differ after a few sums, at which the search ends.
        let differ = self.sums.iter().zip(&other.sums).any(|(a, b)| {
            square += f64::from(a - b) * f64::from(a - b);
            square > most
        });
        !differ && !self.sums.is_empty() && self.sums.len() == other.sums.len()
    }
}

/// Returns the output number `place` of `SplitMix64` (Steele, Lea and Flood, 2014, doi:10.1145/2660193.2660195).
fn mixed(place: u64) -> u64 {
    let z = (place + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// For each recording, returns the index of the earliest recording of which it is a copy, and the factor from the
/// samples of the original to those of the copy.
pub(super) fn copies(sketches: &[&Sketch]) -> Vec<Option<(usize, f64)>> {
    // Copies are close to each other in the order of their first sums.
    let first = |index: usize| sketches[index].sums.first().copied().unwrap_or(f32::MAX);
    let mut order: Vec<usize> = (0..sketches.len()).collect();
    order.sort_by(|&a, &b| first(a).total_cmp(&first(b)));
    let reach = (COPY_DIFFERENCE * SUMS as f64).sqrt() as f32;
    let mut original: Vec<Option<usize>> = vec![None; sketches.len()];
    for (place, &a) in order.iter().enumerate() {
        for &b in order[place + 1..].iter().take_while(|&&b| first(b) - first(a) <= reach) {
            let (earlier, later) = (a.min(b), a.max(b));
            // The comparison of sketches takes the most time, so it comes last.
            if original[later].is_none_or(|known| earlier < known) && sketches[a].is_copy_of(sketches[b]) {
                original[later] = Some(earlier);
            }
        }
    }
    let scale = |copy: usize, of: usize| (sketches[copy].energy / sketches[of].energy).sqrt();
    original
        .into_iter()
        .enumerate()
        .map(|(copy, of)| of.map(|of| (of, scale(copy, of))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{bounded_noise, plus};
    use super::*;
    use test_helpers::near;

    fn copies_of(signals: &[Vec<f64>]) -> Vec<Option<(usize, f64)>> {
        let sketches: Vec<Sketch> = signals.iter().map(|signal| Sketch::of(signal)).collect();
        copies(&sketches.iter().collect::<Vec<_>>())
    }

    #[test]
    fn other_recordings_of_one_spectrum_are_no_copies() {
        let takes: Vec<Vec<f64>> = (0..60).map(bounded_noise).collect();
        assert!(copies_of(&takes).iter().all(Option::is_none));
        // Recordings without a signal are not copies either.
        assert_eq!(copies_of(&[vec![0.0; 100], vec![0.0; 100], Vec::new()]), [None; 3]);
    }

    #[test]
    fn equal_and_scaled_copies_are_found_with_the_earliest_original() {
        let (a, b) = (bounded_noise(7), bounded_noise(8));
        let scaled: Vec<f64> = b.iter().map(|x| 0.37 * x).collect();
        let rounded: Vec<f64> = a.iter().map(|x| (x * 1e4).round() / 1e4 + 9.81).collect();
        let found = copies_of(&[a, b.clone(), scaled, rounded, b]);
        let originals: Vec<Option<usize>> = found.iter().map(|copy| Some(copy.as_ref()?.0)).collect();
        assert_eq!(originals, [None, None, Some(1), Some(0), Some(1)]);
        near(found[2].unwrap().1, 0.37, 1e-6);
    }

    /// A drum that passes the same track again, with another force.
    #[test]
    fn a_track_that_is_retraced_is_no_copy() {
        let track = bounded_noise(7);
        let pass = |seed: u64| plus(&track, bounded_noise(seed).into_iter().map(|x| 0.1 * x));
        assert_eq!(copies_of(&[pass(8), pass(9)]), [None, None]);
    }
}
