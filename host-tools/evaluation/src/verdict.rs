//! An evaluation in one line per texture, in the words of the field.
//!
//! Each clause compares the synthesis with another recording of the same surface. Both are measured against the
//! recording that judges, and the numbers are those of the tables. The synthesis is called near only if it is as near
//! as the other recording, within [`NEAR_DB`] or [`NEAR_OCTAVES`].

use stylus_dsp::liveliness::median;
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ};

use super::held_out::JudgeKind;
use super::impulses::{AtSpeed, Impulses, OFF_OCTAVES, speeds_in_words};
use super::liveliness::{Differences, Role, Summary};
use super::loudness::{Loudness, TOO_STRONG};
use super::perception::{DISTANCE_RANGE_HZ, ScoringRange};
use super::summary::{Means, Scores, TextureEvaluation, TrialEvaluation, mean};

/// Largest distance in excess of the other recording's at which a spectrum or a level counts as equally near, dB. It is
/// half of what is felt.
pub const NEAR_DB: f64 = 0.5 * AMPLITUDE_JND_DB;

/// Largest difference of kurtosis in excess of the other recording's at which impulses count as equally near, octaves.
/// It is a quarter more or less.
pub const NEAR_OCTAVES: f64 = 0.3;

/// An explanation of the verdicts.
pub fn explanation() -> String {
    format!(
        "Verdicts set what the stylus plays beside another recording of the same surface, the target. As near: at \
         most {NEAR_DB} dB further than the target, half of the least change of level that is felt \
         ({AMPLITUDE_JND_DB} dB, one JND, just noticeable difference); of impulses, a kurtosis at most {NEAR_OCTAVES} \
         octaves further; speeds are named if their median is more than {OFF_OCTAVES} octave off. Kurtosis is of what \
         no filter predicts, about 3 without impulses. Clicks are too strong if the loudest 5 ms of a synthesis are \
         more than {TOO_STRONG} times those of the recordings up to one step of speed and force away, and what other \
         recordings reach. A third octave is named if its mean level is off by a JND more than the target's; a line is \
         a steady tone, as of threads, uneven if it swells and fades."
    )
}

/// Returns the verdict on a texture, from its summary and all its trials.
pub(super) fn of_texture(texture: &TextureEvaluation, trials: &[&TrialEvaluation]) -> String {
    let heard: Vec<&TrialEvaluation> = trials.iter().copied().filter(|trial| !trial.is_silent).collect();
    let all = |kind| heard.iter().all(|trial| trial.judge == kind);
    let is_judged = |trial: &&&TrialEvaluation| trial.scores.perceived.is_some();
    let judged = heard.iter().filter(is_judged).count();
    match judged {
        0 if heard.is_empty() => return "silent in every trial, so that nothing is judged".into(),
        0 if all(JudgeKind::Nothing) => {
            return "not judged: nobody knows what the library was fitted to".into();
        }
        0 => return "not judged: its recordings are too short or too slow".into(),
        _ => (),
    }
    let other = if all(JudgeKind::OtherTake) {
        "another take"
    } else {
        "another part of the recording"
    };
    let clauses = [
        spectrum(&texture.synthesis, &texture.other, other),
        worst_band(&heard),
        impulses(&texture.liveliness, &texture.impulses),
        (texture.loudest_5_ms.as_ref()).and_then(|own| loudest(own, heard.len())),
        evenness(&texture.liveliness, &heard),
        (judged < heard.len()).then(|| format!("judged in {judged} of {} trials", heard.len())),
    ];
    let words = clauses.into_iter().flatten().collect::<Vec<_>>().join("; ");
    match narrow(heard.iter().filter_map(|trial| trial.range)) {
        Some(band) => format!("{band}: {words}"),
        None => words,
    }
}

/// Returns the band that was judged in all trials of these `ranges`, in words, if recordings of a low rate leave out
/// much of what skin feels.
fn narrow(ranges: impl Iterator<Item = ScoringRange>) -> Option<String> {
    let (low, high) = ranges
        .map(|range| range.band_edges_hz())
        .reduce(|a, b| (a.0.max(b.0), a.1.min(b.1)))?;
    (high < DISTANCE_RANGE_HZ.1).then(|| format!("judged from {low:.0} to {high:.0} Hz alone"))
}

/// Returns the distance that `own` has in excess of `target`, the other recording's. Squares are subtracted, because
/// independent errors add by their squares.
pub(super) fn further(own: f64, target: f64) -> f64 {
    (own.powi(2) - target.powi(2)).max(0.0).sqrt()
}

fn spectrum(own: &Means, target: &Means, other: &str) -> Option<String> {
    let distance_db = |means: &Means| means.mean_log_spectral_distance_db;
    // Without a target, the whole distance counts.
    let further_db = further(distance_db(own)?, distance_db(target).unwrap_or(0.0));
    let near = if further_db <= NEAR_DB {
        format!("spectrum as near as {other}")
    } else {
        format!("spectrum {further_db:.1} dB further than {other}")
    };
    let felt = own.level_error_jnd.filter(|jnd| *jnd >= 1.0).map(|jnd| {
        let target = target.level_error_jnd.unwrap_or(0.0);
        format!(", levels {jnd:.1} JND off (target {target:.1})")
    });
    Some(near + &felt.unwrap_or_default())
}

/// Returns a clause about the third-octave band whose mean level over trials deviates most, in excess of the other
/// recording's deviation, if this can be felt.
fn worst_band(heard: &[&TrialEvaluation]) -> Option<String> {
    let level = |of: fn(&TrialEvaluation) -> &Scores, band: usize| {
        // With their signs, so that the scatter of single trials averages out.
        mean(heard.iter().filter_map(|t| of(t).band_errors_db[band]))
    };
    let (beyond_db, own_db, band) = (0..BAND_COUNT)
        .filter_map(|band| {
            let own_db = level(|t| &t.scores, band)?;
            let target_db = level(|t| &t.other, band).unwrap_or(0.0);
            Some((own_db.abs() - target_db.abs(), own_db, band))
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let way = if own_db > 0.0 { "strong" } else { "weak" };
    let centre_hz = BAND_LABELS_HZ[band];
    (beyond_db > AMPLITUDE_JND_DB).then(|| format!("{:.0} dB too {way} at {centre_hz} Hz", own_db.abs()))
}

/// Returns the summary of the signals with this role in the comparison.
fn of(summaries: &[Summary], role: Role) -> Option<&Summary> {
    summaries.iter().find(|summary| summary.role == role)
}

/// Returns a difference of the synthesis minus that of the other recording.
fn beyond(summaries: &[Summary], pick: fn(&Differences) -> Option<f64>) -> Option<f64> {
    let own = pick(&of(summaries, Role::Synthesis)?.differences)?;
    let other = of(summaries, Role::Other).and_then(|other| pick(&other.differences));
    Some(own - other.unwrap_or(0.0))
}

/// Impulses over all trials, and the speeds at which they are off by more than an octave.
fn impulses(summaries: &[Summary], of: &Impulses) -> Option<String> {
    let beyond_octaves = beyond(summaries, |d| d.residual_kurtosis_octaves)?;
    let is_off = |at: &AtSpeed, is_weak: bool| {
        let target = at.octaves_other.map_or(0.0, f64::abs);
        // At some speeds, recordings differ from each other by more than an octave.
        let is_beyond = at.octaves.abs() > OFF_OCTAVES.max(target + NEAR_OCTAVES);
        is_beyond && (at.octaves < 0.0) == is_weak
    };
    let mut clauses = Vec::new();
    for (is_weak, way) in [(true, "weak"), (false, "strong")] {
        let off = || of.by_speed.iter().filter(|at| is_off(at, is_weak));
        let kurtosis = |pick: fn(&AtSpeed) -> f64| median(off().map(pick));
        if let (Some(own), Some(recorded)) = (kurtosis(|at| at.kurtosis), kurtosis(|at| at.recorded_kurtosis)) {
            let speeds = match of.by_speed.len() {
                1 => String::new(),
                _ => speeds_in_words(&of.by_speed, |at| is_off(at, is_weak)),
            };
            clauses.push(format!(
                "impulses too {way}{speeds} (kurtosis {own:.1}, recorded {recorded:.1})"
            ));
        }
    }
    // A median over all trials would hide the speeds that are named already.
    if clauses.is_empty() {
        clauses.push(if beyond_octaves <= NEAR_OCTAVES {
            "impulses as near".into()
        } else {
            let kurtosis = |role| self::of(summaries, role)?.median.residual_kurtosis;
            let (own, recorded) = (kurtosis(Role::Synthesis)?, kurtosis(Role::Recording)?);
            let way = if own < recorded { "weak" } else { "strong" };
            format!("impulses too {way} (kurtosis {own:.1}, recorded {recorded:.1})")
        });
    }
    let (own, target) = (of.trials_octave_off, of.trials_octave_off_other);
    if own > target && of.trials > 1 {
        clauses.push(format!(
            "{own} of {} trials more than an octave off (target {target})",
            of.trials
        ));
    }
    Some(clauses.join(", "))
}

/// Returns a clause about the loudest events, if they exceed those of the recordings around them by more than other
/// recordings do.
fn loudest(loudness: &Loudness, trials: usize) -> Option<String> {
    (loudness.trials_too_strong > 0).then(|| {
        let whose = if trials > 1 {
            format!(" in {} of {trials} trials", loudness.trials_too_strong)
        } else {
            String::new()
        };
        format!(
            "clicks up to {:.1} times too strong{whose} (loudest 5 ms, target {:.1})",
            loudness.times, loudness.times_other
        )
    })
}

fn evenness(summaries: &[Summary], heard: &[&TrialEvaluation]) -> Option<String> {
    let off = |db: f64| {
        let way = if db > 0.0 { "uneven" } else { "even" };
        format!("{:.0} dB too {way}", db.abs())
    };
    let line = beyond(summaries, |d| d.line_range_db);
    let level = beyond(summaries, |d| d.level_spread_db);
    if line.is_some_and(|db| db > NEAR_DB) {
        let (db, line_hz) = median_line(heard)?;
        return Some(format!("line {} at {line_hz:.0} Hz", off(db)));
    }
    if level.is_some_and(|db| db > NEAR_DB) {
        let spread = |role| of(summaries, role)?.median.level_spread_db;
        let db = spread(Role::Synthesis)? - spread(Role::Recording)?;
        return Some(format!("level {}", off(db)));
    }
    level.or(line).map(|_| "evenness as near".into())
}

/// Returns the range of the line's levels minus the recording's range, dB, and the line's frequency, Hz, of the median
/// trial.
fn median_line(heard: &[&TrialEvaluation]) -> Option<(f64, f64)> {
    let of = |trial: &&TrialEvaluation| {
        let liveliness = trial.liveliness.as_ref()?;
        let range = |role| {
            let own = liveliness.signals.iter().find(|s| s.role == role);
            own?.measures.line_range_db
        };
        let db = range(Role::Synthesis)? - range(Role::Recording)?;
        Some((db, liveliness.line_hz?))
    };
    let mut lines: Vec<(f64, f64)> = heard.iter().filter_map(of).collect();
    // One trial is chosen, because a range and a frequency of different trials would not belong together.
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    lines.get(lines.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_dsp::liveliness::Liveliness;
    use test_helpers::holds;

    /// A recording, a synthesis that is off by `octaves` of kurtosis and `spread_db` of evenness, and another
    /// recording.
    fn lively(octaves: f64, spread_db: f64) -> Vec<Summary> {
        let measures = |octaves: f64, spread_db: f64| Liveliness {
            residual_kurtosis: Some(6.0 * octaves.exp2()),
            level_spread_db: Some(3.0 + spread_db),
            ..Liveliness::default()
        };
        let of = |role, median| Summary {
            role,
            parts: None,
            median,
            differences: Differences::of(&measures(0.0, 0.0), &median),
        };
        vec![
            of(Role::Recording, measures(0.0, 0.0)),
            of(Role::Synthesis, measures(octaves, spread_db)),
            of(Role::Other, measures(0.1, 0.1)),
        ]
    }

    #[test]
    fn a_band_that_a_low_rate_narrows_is_named_and_another_is_not() {
        let of = |rates_hz: &[f64]| narrow(rates_hz.iter().filter_map(|rate_hz| ScoringRange::of(*rate_hz, 5000)));
        holds(&of(&[5000.0, 400.0]).unwrap(), &["judged from", "to 180 Hz alone"]);
        assert_eq!((of(&[5000.0, 2800.0]), of(&[])), (None, None));
    }

    #[test]
    fn what_is_within_a_threshold_of_the_target_is_as_near_and_what_is_beyond_is_named_with_its_way() {
        let of = |octaves, spread_db| {
            let of = lively(octaves, spread_db);
            let impulses = impulses(&of, &Impulses::default()).unwrap();
            [impulses, evenness(&of, &[]).unwrap()]
        };
        assert_eq!(of(-0.39, -1.19), ["impulses as near", "evenness as near"]);
        let weak = ["impulses too weak (kurtosis 3.0, recorded 6.0)", "level 2 dB too even"];
        assert_eq!(of(-1.0, -2.0), weak);
        let strong = of(0.41, 1.3);
        assert!(strong[0].contains("too strong") && strong[1].contains("too uneven"));
    }

    #[test]
    fn speeds_that_are_off_are_named_also_if_the_median_over_the_grid_is_near() {
        let at = |speed_mm_s, octaves: f64, octaves_other| AtSpeed {
            speed_mm_s,
            trials: 8,
            recorded_kurtosis: 24.0,
            kurtosis: 24.0 * octaves.exp2(),
            octaves,
            octaves_other: Some(octaves_other),
        };
        let said = |by_speed: Vec<AtSpeed>, trials_octave_off| {
            let impulses = Impulses {
                trials: 40,
                trials_octave_off,
                trials_octave_off_other: 1,
                by_speed,
            };
            super::impulses(&lively(0.0, 0.0), &impulses).unwrap()
        };
        let near = [at(40.0, 0.9, 0.0), at(60.0, 0.1, 0.0), at(80.0, -0.9, 0.1)];
        assert_eq!(said(near.to_vec(), 1), "impulses as near");
        // At this speed, recordings differ from each other as much.
        let mut speeds = near.to_vec();
        speeds.push(at(100.0, -1.2, 1.1));
        let count = "12 of 40 trials more than an octave off (target 1)";
        assert_eq!(said(speeds.clone(), 12), format!("impulses as near, {count}"));
        speeds.extend([at(120.0, -2.0, 0.1), at(140.0, -3.0, 0.1)]);
        let weak = "impulses too weak at 120 mm/s and above (kurtosis 4.5, recorded 24.0)";
        assert_eq!(said(speeds.clone(), 12), format!("{weak}, {count}"));
        speeds[0].octaves = 1.5;
        let strong = said(speeds, 12);
        holds(&strong, &["too strong at 40 mm/s (kurtosis"]);
    }

    #[test]
    fn clicks_are_too_strong_only_beyond_what_recordings_are_to_each_other() {
        let said = |times, times_other, trials_too_strong| {
            let own = Loudness {
                times,
                times_other,
                trials_too_strong,
            };
            loudest(&own, 9)
        };
        assert_eq!(said(1.4, 1.1, 0), None);
        let words = "clicks up to 8.0 times too strong in 2 of 9 trials (loudest 5 ms, target 1.1)";
        assert_eq!(said(8.0, 1.1, 2).unwrap(), words);
    }
}
