//! Verdicts that require a comparison of trials: hum, copies, and a scale that differs from that of the others.

use std::collections::BTreeMap;

use model_format::SAMPLE_RATE_HZ;

use super::compared::Compared;
use super::copies::{Sketch, copies};
use super::unlike::unlike_neighbours;
use super::verdict::{Kind, Verdict};
use crate::dsp::autocorrelation::PaddedSpectrum;
use crate::dsp::sums::upper_median;

/// Deviation of a trial's level from the median of its texture above which its scale is doubted, dB. From the slowest
/// and lightest trial of a grid to the fastest and heaviest, the level rises by about 40 dB. Wrong units cause a
/// deviation of 60 dB.
const UNLIKE_DB: f64 = 45.0;

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
    let own = trial.verdicts.iter();
    own.filter(|verdict| !is_explained(verdict)).cloned().collect()
}

fn add_hum(trials: &[Compared<'_>], members: &[usize], verdicts: &mut [Vec<Verdict>]) {
    let lines: Vec<_> = members
        .iter()
        .map(|&index| (trials[index].speed_mm_s, trials[index].mains_line_hz))
        .collect();
    for (&index, line) in members.iter().zip(confirmed_hum(&lines)) {
        verdicts[index]
            .extend(line.map(|frequency_hz| Verdict::new(Kind::Hum, format!("hum at {frequency_hz:.1} Hz"))));
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
    let levels: Vec<f64> = loud.iter().map(|&index| level(index)).collect();
    let median = upper_median(&levels).unwrap_or(0.0);
    for index in loud {
        let off_db = level(index) - median;
        // One doubt about the scale is enough.
        let is_doubted = verdicts[index].iter().any(|verdict| verdict.kind() == Kind::Scale);
        if off_db.abs() >= UNLIKE_DB && !is_doubted {
            let words = format!("scale: {off_db:+.0} dB from the median of the texture's trials");
            verdicts[index].push(Verdict::new(Kind::Scale, words));
        }
    }
}

/// Least level of a mains line above its surroundings, dB.
pub const HUM_RATIO_DB: f64 = 20.0;

/// Mains frequencies with their second and third harmonics, Hz. Rectifiers and magnets hum at twice the mains
/// frequency.
const MAINS_HZ: [f64; 6] = [50.0, 60.0, 100.0, 120.0, 150.0, 180.0];

/// Returns the frequency of a mains line in the spectrum of a reduced trial, in Hz.
///
/// At one speed, a line of the texture can coincide with a mains frequency; [`confirmed_hum`] distinguishes the two.
pub fn mains_line(spectrum: &PaddedSpectrum) -> Option<f64> {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / spectrum.transform_length as f64;
    let power = &spectrum.power;
    let bins = |from_hz: f64, to_hz: f64| {
        let from = (from_hz / bin_hz).round() as usize;
        let to = ((to_hz / bin_hz).round() as usize).min(power.len());
        from.min(to)..to
    };
    MAINS_HZ.into_iter().find_map(|mains| {
        let line = bins(mains - 1.0, mains + 1.0);
        let peak = line.max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
        let around: Vec<f64> = bins(mains - 10.0, mains - 3.0)
            .chain(bins(mains + 3.0, mains + 10.0))
            .map(|bin| power[bin])
            .collect();
        let median = upper_median(&around)?;
        let ratio = 10f64.powf(HUM_RATIO_DB / 10.0);
        (power[peak] > ratio * median).then_some(peak as f64 * bin_hz)
    })
}

/// Returns the confirmed mains line, in Hz, of each trial of a texture. Trials are given as speed, mm/s, and mains
/// line, Hz.
///
/// If there is a line at mains frequencies at half of the speeds or more, it comes from the mains; otherwise it comes
/// from the texture. With one or two speeds the two cannot be distinguished, and every line counts as hum.
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
    trials.iter().map(|&(_, line)| line.filter(|_| mains)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{bounded_noise, plus, tone};
    use super::*;

    #[test]
    fn slow_motion_is_no_finding_in_the_air() {
        let sketch = Sketch::of(&bounded_noise(1));
        let own = [Verdict::new(Kind::Wandering, ""), Verdict::new(Kind::TooShort, "")];
        let verdicts = |is_idle: bool| {
            let trial = Compared {
                texture: "felt",
                speed_mm_s: 100.0,
                force_n: 1.0,
                bands_db: &[],
                is_idle,
                rms_m_s2: 0.05,
                mains_line_hz: None,
                sketch: &sketch,
                verdicts: &own,
            };
            all_verdicts(&[trial]).remove(0)
        };
        assert_eq!(verdicts(false), own);
        assert_eq!(verdicts(true), own[1..]);
    }

    fn line_of(signal: &[f64]) -> Option<f64> {
        mains_line(&PaddedSpectrum::of(signal, 400))
    }

    #[test]
    fn mains_lines_are_found_with_their_frequency_and_others_are_not() {
        for frequency_hz in [50.0, 59.9, 100.0, 119.8, 150.2, 180.0] {
            let found = line_of(&plus(&bounded_noise(7), tone(frequency_hz, 0.3))).unwrap();
            assert!((found - frequency_hz).abs() < 0.5, "{found}");
        }
        assert_eq!(line_of(&plus(&bounded_noise(8), tone(70.0, 0.5))), None);
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
}
