//! Verdicts that require a comparison of trials: hum, copies, and a scale that differs from that of the others.

use std::collections::BTreeMap;

use stylus_dsp::sums::upper_median;

use super::Compared;
use super::copies::{Sketch, copies};
use super::hum::confirmed_hum;
use super::unlike::unlike_neighbours;
use super::verdict::{Kind, Verdict};

/// Deviation of a trial's level from the median of its texture above which its scale is doubted, dB. From the slowest
/// and lightest trial of a grid to the fastest and heaviest, the level rises by about 40 dB. Wrong units cause a
/// deviation of 60 dB.
const UNLIKE_DB: f64 = 45.0;

/// RMS below which no vibration is felt, m/s²: 12 dB below the 0.1 m/s² of the least threshold (Verrillo 1963: 0.1 µm
/// at 250 Hz is a little more, and lower frequencies need larger displacements).
const FAINT_M_S2: f64 = 0.025;

/// Least number of trials of a texture for which the median is meaningful.
const FEWEST_TRIALS: usize = 4;

/// Returns all verdicts on each trial: its own, and those from the comparison.
pub fn all_verdicts(trials: &[Compared<'_>]) -> Vec<Vec<Verdict>> {
    let mut verdicts: Vec<Vec<Verdict>> = trials.iter().map(own_verdicts).collect();
    let mut textures: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (index, trial) in trials.iter().enumerate() {
        textures.entry(trial.texture).or_default().push(index);
    }
    for members in textures.values() {
        add_hum(trials, members, &mut verdicts);
        add_unlike_levels(trials, members, &mut verdicts);
        add_faint(trials, members, &mut verdicts);
        for (index, verdict) in unlike_neighbours(trials, members) {
            verdicts[index].push(verdict);
        }
    }
    // Silent trials would all be equal.
    let loud: Vec<usize> = (0..trials.len()).filter(|&index| !trials[index].is_silent()).collect();
    let sketches: Vec<&Sketch> = loud.iter().map(|&index| trials[index].sketch).collect();
    for (&index, copy) in loud.iter().zip(copies(&sketches)) {
        verdicts[index].extend(copy.map(|(original, scale)| {
            let of = format!("duplicate of trial {}", loud[original] + 1);
            let scaled = format!(", scaled by {scale:.3}");
            let is_scaled = (scale - 1.0).abs() > 1e-3;
            Verdict::new(Kind::Duplicate, of).with(if is_scaled { &scaled } else { "" })
        }));
    }
    verdicts
}

/// Returns the verdicts on a trial alone. At rest, slow motion is left out, because there is nothing else to record.
fn own_verdicts(trial: &Compared<'_>) -> Vec<Verdict> {
    let is_explained = |verdict: &&Verdict| trial.is_idle && verdict.kind() == Kind::Wandering;
    trial
        .verdicts
        .iter()
        .filter(|verdict| !is_explained(verdict))
        .cloned()
        .collect()
}

fn add_hum(trials: &[Compared<'_>], members: &[usize], verdicts: &mut [Vec<Verdict>]) {
    let lines = members
        .iter()
        .map(|&index| (trials[index].speed_mm_s, trials[index].mains_lines));
    for (&index, line) in members.iter().zip(confirmed_hum(&lines.collect::<Vec<_>>())) {
        verdicts[index].extend(line.map(|line| Verdict::new(Kind::Hum, format!("hum {line}"))));
    }
}

/// Doubts the scale of a texture that nobody would feel at any speed and force. A scale that is not known has a note.
fn add_faint(trials: &[Compared<'_>], members: &[usize], verdicts: &mut [Vec<Verdict>]) {
    let of_surface = |index: &&usize| !trials[**index].is_idle && !trials[**index].is_silent();
    let rubbed: Vec<usize> = members.iter().filter(of_surface).copied().collect();
    let is_faint = |&index: &usize| {
        let own = &trials[index];
        own.rms_m_s2 < FAINT_M_S2 && own.has_scale && !is_doubted(&verdicts[index])
    };
    if rubbed.iter().all(is_faint) {
        for index in rubbed {
            let rms_m_s2 = trials[index].rms_m_s2;
            let words = format!("scale: an RMS of {rms_m_s2:.4} m/s², which nobody feels, as of volts, g or counts");
            verdicts[index].push(Verdict::new(Kind::Scale, words));
        }
    }
}

/// Returns whether the scale is in doubt already; one doubt is enough.
fn is_doubted(verdicts: &[Verdict]) -> bool {
    verdicts.iter().any(|verdict| verdict.kind() == Kind::Scale)
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
    let levels: Vec<f64> = loud.iter().map(|&index| level(index)).collect();
    let median = upper_median(&levels).unwrap_or(0.0);
    for index in loud {
        let off_db = level(index) - median;
        if off_db.abs() >= UNLIKE_DB && !is_doubted(&verdicts[index]) {
            let words = format!("scale: {off_db:+.0} dB from the median of the texture's trials");
            verdicts[index].push(Verdict::new(Kind::Scale, words));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::bounded_noise;
    use super::*;

    /// The verdicts on trials of one texture at 100 mm/s with these levels, m/s².
    fn of_levels(levels: &[f64], is_idle: bool, has_scale: bool, own: &[Verdict]) -> Vec<Vec<Verdict>> {
        let sketches: Vec<Sketch> = (1..)
            .take(levels.len())
            .map(|seed| Sketch::of(&bounded_noise(seed)))
            .collect();
        let trials = levels.iter().zip(&sketches).map(|(&rms_m_s2, sketch)| Compared {
            texture: "felt",
            speed_mm_s: 100.0,
            force_n: 1.0,
            bands_db: &[],
            is_idle,
            rms_m_s2,
            has_scale,
            mains_lines: &[],
            sketch,
            verdicts: own,
        });
        all_verdicts(&trials.collect::<Vec<_>>())
    }

    #[test]
    fn a_texture_that_nobody_feels_at_any_motion_has_a_doubtful_scale() {
        let told = |levels: &[f64], is_idle, has_scale| {
            of_levels(levels, is_idle, has_scale, &[])
                .iter()
                .filter(|own| own.iter().any(|v| v.kind() == Kind::Scale))
                .count()
        };
        assert_eq!(told(&[0.002, 0.02, 0.008], false, true), 3);
        // A quiet stroke beside a loud one, a rig without contact, and integers that are told anyway.
        assert_eq!(told(&[0.002, 0.05], false, true), 0);
        assert_eq!(told(&[0.002], true, true) + told(&[0.002], false, false), 0);
    }

    #[test]
    fn slow_motion_is_no_finding_in_the_air() {
        let own = [Verdict::new(Kind::Wandering, ""), Verdict::new(Kind::TooShort, "")];
        let verdicts = |is_idle: bool| of_levels(&[0.05], is_idle, true, &own).remove(0);
        assert_eq!(verdicts(false), own);
        assert_eq!(verdicts(true), own[1..]);
    }
}
