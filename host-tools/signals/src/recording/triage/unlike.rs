//! A trial whose spectrum differs from those of both neighbours in speed, as if it had another filter, sensor or gain.

use super::Compared;
use super::verdict::{Kind, Verdict};

/// Least deviation from both neighbours in speed, dB, if these differ from each other by less. A level that only one of
/// three speeds has comes from another filter or gain.
pub const UNLIKE_NEIGHBOURS_DB: f64 = 6.0;

/// Least number of adjacent bands that deviate: an octave. A resonance or line that moves with speed deviates in fewer
/// bands.
const LEAST_BANDS: usize = 3;

/// Frequency below which the motion of the hand or rig differs from trial to trial, Hz.
const LOWEST_HZ: f64 = 25.0;

/// How far below a neighbour's strongest band a band is no longer felt, dB.
const AUDIBLE_DB: f64 = 50.0;

/// Returns the verdicts on those `members`, trials of one texture, that deviate from both neighbours in speed at their
/// force. The deviation extends from some frequency upwards, or downwards, or over all frequencies.
pub(super) fn unlike_neighbours(trials: &[Compared<'_>], members: &[usize]) -> Vec<(usize, Verdict)> {
    let usable = |index: &&usize| !trials[**index].is_idle && !trials[**index].is_silent();
    let loud: Vec<&Compared<'_>> = members.iter().filter(usable).map(|i| &trials[*i]).collect();
    members
        .iter()
        .filter(usable)
        .filter_map(|&index| {
            let own = &trials[index];
            let line = || {
                loud.iter()
                    .filter(|other| other.force_n.total_cmp(&own.force_n).is_eq())
            };
            let slower = line().filter(|other| other.speed_mm_s < own.speed_mm_s);
            let faster = line().filter(|other| other.speed_mm_s > own.speed_mm_s);
            let slower = slower.max_by(|a, b| a.speed_mm_s.total_cmp(&b.speed_mm_s))?;
            let faster = faster.min_by(|a, b| a.speed_mm_s.total_cmp(&b.speed_mm_s))?;
            let range = departure(own.bands_db, slower.bands_db, faster.bands_db)?;
            let (low, high) = (range.off_db.0, range.off_db.1);
            let words = format!(
                "spectrum: {low:+.0} to {high:+.0} dB off both neighbours in speed, from {:.0} to {:.0} Hz",
                range.hz.0, range.hz.1
            );
            Some((index, Verdict::new(Kind::Unlike, words)))
        })
        .collect()
}

/// Range of bands in which a trial deviates from both neighbours.
struct Departure {
    /// Centres of the lowest and the highest band of the range, Hz.
    hz: (f64, f64),
    /// Least and largest difference from the level of the nearer neighbour, dB.
    off_db: (f64, f64),
}

/// Returns the longest range in which `own` deviates from both neighbours. It begins at either end of the frequencies
/// that all three recordings cover, or includes all of them.
fn departure(own: &[(f64, f64)], slower: &[(f64, f64)], faster: &[(f64, f64)]) -> Option<Departure> {
    let level = |bands: &[(f64, f64)], hz: f64| {
        bands
            .iter()
            .find(|(centre, _)| centre.total_cmp(&hz).is_eq())
            .map(|(_, db)| *db)
    };
    let strongest = |bands: &[(f64, f64)]| bands.iter().map(|b| b.1).fold(f64::MIN, f64::max);
    let audible = strongest(slower).min(strongest(faster)) - AUDIBLE_DB;
    let known = own.iter().filter(|(hz, _)| *hz >= LOWEST_HZ);
    // Difference from the level of the nearer neighbour. It is 0 if the level lies between both neighbours, or deviates
    // by no more than they differ from each other or than the bound.
    let off: Vec<(f64, f64)> = known
        .filter_map(|&(hz, own_db)| {
            let (slower, faster) = (level(slower, hz)?, level(faster, hz)?);
            if slower.max(faster).max(own_db) < audible {
                return None;
            }
            let (a, b) = (own_db - slower, own_db - faster);
            let nearer = if a.abs() < b.abs() { a } else { b };
            let apart = UNLIKE_NEIGHBOURS_DB.max((slower - faster).abs());
            let departs = a * b > 0.0 && nearer.abs() > apart;
            Some((hz, if departs { nearer } else { 0.0 }))
        })
        .collect();
    let run = |first: Option<&(f64, f64)>, bands: &mut dyn Iterator<Item = &(f64, f64)>| {
        let sign = first?.1;
        let run: Vec<(f64, f64)> = bands.take_while(|(_, db)| db * sign > 0.0).copied().collect();
        (run.len() >= LEAST_BANDS).then_some(run)
    };
    let up = run(off.last(), &mut off.iter().rev());
    let down = run(off.first(), &mut off.iter());
    let longest = up.into_iter().chain(down).max_by_key(Vec::len)?;
    let ends = |of: fn(&(f64, f64)) -> f64| {
        longest.iter().map(of).fold((f64::MAX, f64::MIN), |(low, high), value| {
            (low.min(value), high.max(value))
        })
    };
    Some(Departure {
        hz: ends(|band| band.0),
        off_db: ends(|band| band.1),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_dsp::spectrum::third_octave_hz;

    /// Bands from 25 Hz to 2 kHz whose level starts at `level_db` and falls by 1 dB per band, changed by `change`, a
    /// function of the centre in Hz.
    fn bands(level_db: f64, change: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let band = |k: u32| {
            let hz = third_octave_hz(f64::from(k) - 13.0);
            (hz, level_db - f64::from(k) + change(hz))
        };
        (14..34).map(band).collect()
    }

    fn of(change: impl Fn(f64) -> f64) -> Option<Departure> {
        let neighbours = (bands(0.0, |_| 0.0), bands(4.0, |_| 0.0));
        departure(&bands(2.0, change), &neighbours.0, &neighbours.1)
    }

    #[test]
    fn another_filter_or_gain_is_told_with_its_band() {
        let low_passed = of(|hz| if hz > 1100.0 { -15.0 } else { 0.0 }).unwrap();
        assert_eq!(low_passed.hz.0.round(), 1259.0);
        assert_eq!(low_passed.hz.1.round(), 1995.0);
        assert!((low_passed.off_db.0 + 13.0).abs() < 1e-9, "{}", low_passed.off_db.0);
        let high_passed = of(|hz| if hz < 90.0 { -20.0 } else { 0.0 }).unwrap();
        assert!(high_passed.hz.1 < 90.0);
        let gained = of(|_| 14.0).unwrap();
        assert!(gained.hz.0 < 26.0 && gained.hz.1 > 1900.0 && gained.off_db.0 > 11.0);
    }

    #[test]
    fn a_level_between_or_near_the_neighbours_and_a_resonance_of_its_own_are_no_findings() {
        assert!(of(|_| 0.0).is_none());
        assert!(of(|_| 6.0).is_none());
        assert!(of(|hz| if (200.0..450.0).contains(&hz) { 20.0 } else { 0.0 }).is_none());
        assert!(of(|hz| if hz > 1500.0 { -30.0 } else { 0.0 }).is_none());
    }
}
