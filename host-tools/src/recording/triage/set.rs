//! Verdicts that only a comparison of trials tells: hum, copies, and a scale unlike that of the others.

use std::collections::HashMap;

use super::fingerprint::{Fingerprint, Member, copies};
use super::hum::confirmed_hum;
use super::verdict::{ScaleDoubt, Verdict};
use crate::support::error::Result;

/// Deviation of a trial's level from the median of its texture at which its scale is doubted, dB. From the slowest and
/// lightest trial of a grid to the fastest and heaviest the level rises by some 40 dB; wrong units are 60 dB off.
const UNLIKE_DB: f64 = 45.0;

/// Fewest trials of a texture with a median that means something.
const FEWEST_TRIALS: usize = 4;

/// A trial, as far as it is compared with others.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// Name of its texture.
    pub texture: &'a str,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// True at rest or without contact, where noise of the sensor and slow motion are all that there is to record.
    pub is_idle: bool,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// A line at a mains frequency, Hz.
    pub mains_line_hz: Option<f64>,
    /// Content.
    pub fingerprint: &'a Fingerprint,
    /// Its verdicts so far.
    pub verdicts: &'a [Verdict],
}

impl Compared<'_> {
    fn is_silent(&self) -> bool {
        self.verdicts.contains(&Verdict::Silent)
    }
}

/// Returns all verdicts on each trial: its own, and those of the comparison. `signal_of` reads the
/// [centred](super::centred) signal of a trial whose fingerprint does not hold it.
///
/// # Errors
/// Those of `signal_of`.
pub fn all_verdicts(
    trials: &[Compared<'_>],
    signal_of: &(impl Fn(usize) -> Result<Vec<f32>> + Sync),
) -> Result<Vec<Vec<Verdict>>> {
    let mut verdicts: Vec<Vec<Verdict>> = trials.iter().map(own_verdicts).collect();
    let mut numbers: HashMap<&str, usize> = HashMap::new();
    let mut textures: Vec<Vec<usize>> = Vec::new();
    let mut groups = Vec::with_capacity(trials.len());
    for (index, trial) in trials.iter().enumerate() {
        let group = *numbers.entry(trial.texture).or_insert(textures.len());
        if group == textures.len() {
            textures.push(Vec::new());
        }
        textures[group].push(index);
        groups.push(group);
    }
    for members in &textures {
        add_hum(trials, members, &mut verdicts);
        add_unlike_levels(trials, members, &mut verdicts);
    }
    // All silence is alike.
    let loud: Vec<usize> = (0..trials.len())
        .filter(|&index| !trials[index].is_silent())
        .collect();
    let members: Vec<Member<'_>> = loud
        .iter()
        .map(|&index| Member {
            group: groups[index],
            print: trials[index].fingerprint,
        })
        .collect();
    let copies = copies(&members, &|number: usize| signal_of(loud[number]))?;
    for (&index, copy) in loud.iter().zip(copies) {
        verdicts[index].extend(copy.map(|(original, likeness)| Verdict::Duplicate {
            of: loud[original],
            likeness,
        }));
    }
    Ok(verdicts)
}

/// The verdicts of a trial by itself, without those that idleness explains.
fn own_verdicts(trial: &Compared<'_>) -> Vec<Verdict> {
    let is_explained = |verdict: &&Verdict| {
        let expected = matches!(
            verdict,
            Verdict::SensorNoise { .. } | Verdict::Wandering { .. }
        );
        trial.is_idle && expected
    };
    let own = trial
        .verdicts
        .iter()
        .filter(|verdict| !is_explained(verdict));
    own.cloned().collect()
}

fn add_hum(trials: &[Compared<'_>], members: &[usize], verdicts: &mut [Vec<Verdict>]) {
    let lines: Vec<_> = members
        .iter()
        .map(|&index| (trials[index].speed_mm_s, trials[index].mains_line_hz))
        .collect();
    for (&index, line) in members.iter().zip(confirmed_hum(&lines)) {
        verdicts[index].extend(line.map(|frequency_hz| Verdict::Hum { frequency_hz }));
    }
}

fn add_unlike_levels(trials: &[Compared<'_>], members: &[usize], verdicts: &mut [Vec<Verdict>]) {
    let level = |index: usize| 20.0 * trials[index].rms_m_s2.log10();
    let loud: Vec<usize> = members
        .iter()
        .copied()
        .filter(|&index| !trials[index].is_silent())
        .collect();
    if loud.len() < FEWEST_TRIALS {
        return;
    }
    let mut levels: Vec<f64> = loud.iter().map(|&index| level(index)).collect();
    levels.sort_by(f64::total_cmp);
    let median = levels[levels.len() / 2];
    for index in loud {
        let off_db = level(index) - median;
        let is_doubted = verdicts[index]
            .iter()
            .any(|verdict| verdict.name() == "scale");
        if off_db.abs() >= UNLIKE_DB && !is_doubted {
            verdicts[index].push(Verdict::Scale(ScaleDoubt::UnlikeOthers(off_db)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fingerprint::fingerprint;
    use super::super::test_signals::noise;
    use super::*;

    /// Fails, because every fingerprint here holds its signal.
    fn held(_: usize) -> Result<Vec<f32>> {
        unreachable!("the signal is held")
    }

    #[test]
    fn a_trial_in_other_units_than_its_texture_is_told() {
        let prints: Vec<Fingerprint> = (0..5).map(|seed| fingerprint(&noise(seed))).collect();
        let trial = |index: usize, rms_m_s2: f64| Compared {
            texture: "felt",
            speed_mm_s: 100.0,
            is_idle: false,
            rms_m_s2,
            mains_line_hz: None,
            fingerprint: &prints[index],
            verdicts: &[],
        };
        let levels = [0.02, 0.05, 50.0, 0.1, 0.03];
        let trials: Vec<_> = levels
            .iter()
            .enumerate()
            .map(|(index, &rms)| trial(index, rms))
            .collect();
        let verdicts = all_verdicts(&trials, &held).unwrap();
        for (index, found) in verdicts.iter().enumerate() {
            assert_eq!(found.len(), usize::from(index == 2), "{found:?}");
        }
        assert!(
            matches!(verdicts[2][..], [Verdict::Scale(ScaleDoubt::UnlikeOthers(db))] if (db - 60.0).abs() < 1.0)
        );
    }

    #[test]
    fn noise_of_the_sensor_is_no_finding_in_the_air() {
        let print = fingerprint(&noise(1));
        let own = [
            Verdict::SensorNoise { rms_m_s2: 0.05 },
            Verdict::TooShort { samples: 9 },
        ];
        let verdicts = |is_idle: bool| {
            let trial = Compared {
                texture: "felt",
                speed_mm_s: 100.0,
                is_idle,
                rms_m_s2: 0.05,
                mains_line_hz: None,
                fingerprint: &print,
                verdicts: &own,
            };
            all_verdicts(&[trial], &held).unwrap().remove(0)
        };
        assert_eq!(verdicts(false), own);
        assert_eq!(verdicts(true), own[1..]);
    }
}
