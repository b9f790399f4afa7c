//! Comparison over time, along the motion of a hand. The library is played along the speed and force of strokes to
//! which it was not fitted. Its levels are compared with those of predictions that need no synthesis.

use std::path::{Path, PathBuf};

use model_format::{Provenance, SAMPLE_RATE_HZ, Texture};
use rayon::prelude::*;
use serde::Serialize;
use stylus_dsp::high_pass::high_pass;
use stylus_dsp::motion_law::{LevelAt, MotionLaw};
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, PowerSpectrum, band_errors_within_db};
use stylus_dsp::sums::{energy, mean, variance};
use stylus_fit::fit;
use stylus_fit::fit::conditioning::Conditioning;
use stylus_signals::playing::motion::{MotionPath, MotionRow};
use stylus_signals::playing::render::render;
use stylus_signals::recording::freehand::{Freehand, LEAST_FORCE_N, LEAST_SPEED_MM_S};
use stylus_signals::recording::{HeldSamples, Trial};
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::perception::ScoringRange;
use super::table::{Table, number};
use super::verdict::{NEAR_DB, further};

/// Duration over which a level is measured, s.
const WINDOW_S: f64 = 0.1;

/// Samples of a window.
const WINDOW: usize = (WINDOW_S * SAMPLE_RATE_HZ as f64) as usize;

/// Smallest number of successive windows in a part of a stroke whose spectrum is computed.
const SPECTRUM_WINDOWS: usize = 5;

/// Level of silence, dB re 1 m/s²: far below any sensor's noise.
const SILENCE_DB: f64 = -100.0;

/// Interval at which a stroke's motion is sampled, s. It is the device's update interval.
const MOTION_STEP_S: f64 = 0.002;

/// Number of syntheses with different seeds over which the library's levels are averaged. A predicted level has no
/// noise of its own, and a single synthesis does.
const PLAYINGS: u64 = 8;

/// A stroke with the levels of its windows in motion and contact.
#[derive(Clone, Debug)]
pub struct Stroke {
    file: PathBuf,
    /// The signal at the models' rate, m/s².
    signal: Vec<f64>,
    motion: MotionPath,
    /// Windows in motion and contact that are neither silent nor have an outlier, with their number from the stroke's
    /// beginning.
    windows: Vec<(usize, LevelAt)>,
    source_rate_hz: f64,
    cut_hz: Option<f64>,
    is_simulated: bool,
}

impl Stroke {
    /// Creates the stroke of `recording`, which was read from `file`.
    ///
    /// # Errors
    /// A recording without samples or of an impossible rate, a speed or force that no hand reaches, or axes that cannot
    /// be reduced to one.
    pub fn of(file: &Path, recording: Freehand, conditioning: Conditioning) -> Result<Self> {
        let motion = motion_of(&recording)?;
        let Freehand {
            rate_hz,
            axes,
            speed_mm_s,
            force_n,
            is_outlier,
            is_simulated,
            ..
        } = recording;
        let trial = Trial {
            held: Some(HeldSamples::new(rate_hz, axes, false)?.into()),
            ..Trial::of(file, "", 0.0, 0.0)
        };
        // Nothing may be cut, because samples share their times with the motion.
        let signal = fit::whole_signal(&trial, conditioning)?;
        let per_window = rate_hz * WINDOW_S;
        // The signal is at 5 kHz, speed and force at the recording's own rate; both must contain the last window.
        let count = (signal.samples.len() / WINDOW).min((speed_mm_s.len() as f64 / per_window) as usize);
        let window = |index: usize| {
            let begin = (index as f64 * per_window) as usize;
            let own = begin..begin + per_window as usize;
            let is_bad = is_outlier[own.clone()].iter().any(|bad| *bad);
            let in_contact = force_n[own.clone()].iter().all(|force| *force >= LEAST_FORCE_N);
            let at = LevelAt {
                speed_mm_s: mean(&speed_mm_s[own.clone()]),
                force_n: mean(&force_n[own]),
                level_db: level_db(&signal.samples, index),
                weight: 1.0,
            };
            let counts = !is_bad && in_contact && at.speed_mm_s >= LEAST_SPEED_MM_S;
            (counts && at.level_db > SILENCE_DB).then_some((index, at))
        };
        Ok(Self {
            file: file.to_owned(),
            windows: (0..count).filter_map(window).collect(),
            motion,
            source_rate_hz: signal.source_rate_hz,
            cut_hz: signal.cut_hz,
            signal: signal.samples,
            is_simulated,
        })
    }

    /// The level of each window, dB.
    fn levels_db(&self) -> Vec<f64> {
        self.windows.iter().map(|(_, at)| at.level_db).collect()
    }

    /// Returns the parts of `signal` whose windows are in motion and contact without a gap, if they are long enough for
    /// a spectrum.
    fn parts<'a>(&self, signal: &'a [f64]) -> Vec<&'a [f64]> {
        self.windows
            .chunk_by(|a, b| a.0 + 1 == b.0)
            .filter(|run| run.len() >= SPECTRUM_WINDOWS)
            .map(|run| &signal[run[0].0 * WINDOW..(run[run.len() - 1].0 + 1) * WINDOW])
            .collect()
    }

    /// Mean logarithms of speed and force.
    fn middle(&self) -> [f64; 2] {
        let of =
            |value: fn(&LevelAt) -> f64| mean(&self.windows.iter().map(|(_, at)| value(at).ln()).collect::<Vec<_>>());
        [of(|at| at.speed_mm_s), of(|at| at.force_n)]
    }

    /// Plays `texture` along the stroke: m/s², as long as the stroke's signal.
    fn played(&self, texture: Texture<'_>, seed: u64) -> Result<Vec<f64>> {
        let seconds = self.signal.len() as f64 / f64::from(SAMPLE_RATE_HZ);
        let rendered = render(texture, &self.motion, seconds, seed)?;
        let mut played = rendered.accelerations_m_s2();
        if let Some(cut_hz) = self.cut_hz {
            high_pass(&mut played, f64::from(SAMPLE_RATE_HZ), cut_hz);
        }
        Ok(played)
    }
}

/// The motion of `recording`.
fn motion_of(recording: &Freehand) -> Result<MotionPath> {
    let step = ((recording.rate_hz * MOTION_STEP_S) as usize).max(1);
    let row = |index: usize| MotionRow {
        time_s: index as f64 / recording.rate_hz,
        // The sign of a speed is its direction. Lines are tied to position, and go back with the hand.
        speed_mm_s: if recording.is_backward[index] {
            -recording.speed_mm_s[index]
        } else {
            recording.speed_mm_s[index]
        },
        force_n: recording.force_n[index],
        position_mm: None,
        contact: None,
    };
    MotionPath::from_rows((0..recording.force_n.len()).step_by(step).map(row))
}

/// Level of window `index` of `signal`, dB re 1 m/s².
fn level_db(signal: &[f64], index: usize) -> f64 {
    let power = energy(&signal[index * WINDOW..(index + 1) * WINDOW]) / WINDOW as f64;
    // The logarithm of zero is minus infinity, which would take every mean with it.
    (10.0 * power.log10()).max(SILENCE_DB)
}

/// Nearness of a prediction to the strokes, over all windows in motion and contact.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Nearness {
    /// The prediction, in words.
    pub by: &'static str,
    /// True if the predicted levels are those of a recording, which has noise of its own.
    pub is_recording: bool,
    /// Correlation of the predicted with the recorded levels; none for a constant.
    pub correlation: Option<f64>,
    /// RMS difference of levels, dB.
    pub error_db: f64,
    /// Mean difference of the predicted from the recorded levels, dB.
    pub bias_db: f64,
    /// Standard deviation of the predicted levels, dB.
    pub spread_db: f64,
    /// Mean error of third octaves, dB; none if only a level is predicted, or without half a second in motion and
    /// contact.
    pub band_error_db: Option<f64>,
}

/// The outcome of a comparison along strokes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlongStrokes {
    /// Texture that was played.
    pub texture: String,
    /// The answer in one line.
    pub verdict: String,
    /// Number of strokes that judged.
    pub strokes: usize,
    /// Number of strokes of the fit, from which the other predictions are made.
    pub fitted: usize,
    /// Number of windows of 100 ms that were compared.
    pub windows: usize,
    /// Standard deviation of the recorded levels, dB.
    pub recorded_spread_db: f64,
    /// True if any stroke or the texture is simulated.
    pub simulated: bool,
    /// The library's nearness first, then that of the other predictions.
    pub nearness: Vec<Nearness>,
}

/// Plays `texture` along each of the `judges`, and compares levels over time. Three predictions from the `fitted`
/// strokes are compared, too: their mean level, a straight line over the logarithms of speed and force, and the stroke
/// with the nearest motion, window by window.
///
/// # Errors
/// A texture of another rate than 5 kHz, no stroke of one kind, or a stroke without motion in contact.
pub fn along_strokes(texture: Texture<'_>, fitted: &[Stroke], judges: &[Stroke], seed: u64) -> Result<AlongStrokes> {
    check(texture, fitted, judges)?;
    let no_strokes = || Error::Request("give at least one stroke of the fit and one that judges".into());
    let recorded: Vec<f64> = judges.iter().flat_map(Stroke::levels_db).collect();
    let baselines = of_baselines(fitted, judges, &recorded).ok_or_else(no_strokes)?;
    let library = of_library(texture, judges, seed, &recorded)?;
    Ok(AlongStrokes {
        texture: texture.name().to_owned(),
        verdict: verdict(library.each_ref(), &baselines),
        strokes: judges.len(),
        fitted: fitted.len(),
        windows: recorded.len(),
        recorded_spread_db: variance(&recorded).sqrt(),
        simulated: texture.provenance() == Provenance::Simulated
            || fitted.iter().chain(judges).any(|stroke| stroke.is_simulated),
        nearness: library.into_iter().chain(baselines).collect(),
    })
}

/// Nearness of the library along the `judges`, played once and as a mean over seeds, to the `recorded` levels.
fn of_library(texture: Texture<'_>, judges: &[Stroke], seed: u64, recorded: &[f64]) -> Result<[Nearness; 2]> {
    let play = |index: usize| {
        let of_seed = |playing: u64| {
            // No two playings of the comparison have the same noise.
            let own = (index as u64).wrapping_mul(PLAYINGS).wrapping_add(playing);
            judges[index].played(texture, seed.wrapping_add(own))
        };
        (0..PLAYINGS).map(of_seed).collect::<Result<Vec<_>>>()
    };
    let played = (0..judges.len())
        .into_par_iter()
        .map(play)
        .collect::<Result<Vec<_>>>()?;
    let strokes = || judges.iter().zip(&played);
    let of_playings = |of: &dyn Fn(&[Vec<f64>], usize) -> f64| -> Vec<f64> {
        strokes()
            .flat_map(|(stroke, played)| (stroke.windows.iter()).map(move |(window, _)| of(played, *window)))
            .collect()
    };
    let once = of_playings(&|played, window| level_db(&played[0], window));
    let averaged = of_playings(&|played, window| {
        let levels: Vec<f64> = played.iter().map(|signal| level_db(signal, window)).collect();
        mean(&levels)
    });
    let parts = strokes().map(|(stroke, played)| stroke.parts(&played[0]));
    let bands = band_error_db(judges, &parts.collect::<Vec<_>>());
    Ok([
        Nearness::of("library", recorded, &once, bands),
        Nearness::of("library, mean over seeds", recorded, &averaged, None),
    ])
}

/// Nearness of predictions from the `fitted` strokes to the `recorded` levels of the `judges`; none if either kind of
/// stroke is missing.
fn of_baselines(fitted: &[Stroke], judges: &[Stroke], recorded: &[f64]) -> Option<[Nearness; 3]> {
    let levels: Vec<LevelAt> = fitted.iter().flat_map(|s| s.windows.iter().map(|w| w.1)).collect();
    let law = MotionLaw::of(&levels).filter(|_| !judges.is_empty())?;
    let constant_db = mean(&levels.iter().map(|at| at.level_db).collect::<Vec<_>>());
    let by_law: Vec<f64> = judges
        .iter()
        .flat_map(|stroke| &stroke.windows)
        .map(|(_, at)| law.level_db(at.speed_mm_s, at.force_n))
        .collect();
    let nearest: Vec<&Stroke> = judges.iter().map(|stroke| nearest(stroke, fitted)).collect();
    let replayed: Vec<f64> = (judges.iter().zip(&nearest))
        .flat_map(|(stroke, near)| {
            // A shorter stroke is repeated.
            near.levels_db().into_iter().cycle().take(stroke.windows.len())
        })
        .collect();
    let parts = nearest.iter().map(|near| near.parts(&near.signal));
    let bands = band_error_db(judges, &parts.collect::<Vec<_>>());
    let near = |by, levels: &[f64], bands| Nearness::of(by, recorded, levels, bands);
    Some([
        near("constant level", &vec![constant_db; recorded.len()], None),
        near("line over log speed, log force", &by_law, None),
        Nearness {
            is_recording: true,
            ..near("nearest stroke", &replayed, bands)
        },
    ])
}

/// Returns the verdict on the `library`, as one synthesis and as a mean over seeds, compared with the nearest of the
/// `baselines`, of which there is at least one.
///
/// A prediction has no noise, so it is compared with the mean. Another stroke has noise, so it is compared with one
/// synthesis.
fn verdict(library: [&Nearness; 2], baselines: &[Nearness]) -> String {
    let [played, averaged] = library;
    let nearest = baselines.iter().min_by(|a, b| a.error_db.total_cmp(&b.error_db));
    let best = nearest.expect("there is at least one");
    let own = if best.is_recording { played } else { averaged };
    let (own_db, best_db) = (own.error_db, best.error_db);
    let mut clauses = vec![if further(own_db, best_db) <= NEAR_DB {
        format!("levels as near as the best baseline, the {} ({best_db:.1} dB)", best.by)
    } else {
        format!(
            "levels {own_db:.1} dB off, the best baseline, the {}, {best_db:.1} dB",
            best.by
        )
    }];
    let bias_db = played.bias_db;
    if bias_db.abs() > AMPLITUDE_JND_DB {
        let way = if bias_db > 0.0 { "loud" } else { "quiet" };
        clauses.push(format!("{:.0} dB too {way}", bias_db.abs()));
    }
    clauses.join("; ")
}

/// Returns an error if `texture` cannot be played along strokes, or if one of them has nothing to compare.
fn check(texture: Texture<'_>, fitted: &[Stroke], judges: &[Stroke]) -> Result<()> {
    if texture.sample_rate_hz() != SAMPLE_RATE_HZ {
        return Err(Error::Request(format!(
            "texture '{}' plays at {} Hz, strokes are compared at {SAMPLE_RATE_HZ}",
            texture.name(),
            texture.sample_rate_hz()
        )));
    }
    for strokes in [fitted, judges] {
        if let Some(still) = strokes.iter().find(|stroke| stroke.windows.is_empty()) {
            let problem = format!(
                "no {WINDOW_S} s in motion and contact: at least {LEAST_SPEED_MM_S} mm/s and {LEAST_FORCE_N} N"
            );
            return Err(Error::file(&still.file, problem));
        }
    }
    Ok(())
}

/// Returns the stroke of `others`, which has at least one, whose motion is nearest to that of `stroke`, by mean
/// logarithms.
fn nearest<'a>(stroke: &Stroke, others: &'a [Stroke]) -> &'a Stroke {
    let own = stroke.middle();
    let distance = |other: &Stroke| {
        let middle = other.middle();
        (middle[0] - own[0]).hypot(middle[1] - own[1])
    };
    others
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .expect("there are levels of at least one")
}

/// Returns the mean magnitude of the errors of third octaves over all strokes that have a spectrum. `others` are the
/// predictions of the strokes.
fn band_error_db(strokes: &[Stroke], others: &[Vec<&[f64]>]) -> Option<f64> {
    let mut errors = Vec::new();
    for (stroke, other) in strokes.iter().zip(others) {
        let own = stroke.parts(&stroke.signal);
        // The shortest part that may count decides what can be resolved.
        let (rate_hz, shortest) = (stroke.source_rate_hz, SPECTRUM_WINDOWS * WINDOW);
        let range = ScoringRange::of_filtered(rate_hz, shortest, stroke.cut_hz);
        let Some(range) = range.filter(|_| !own.is_empty() && !other.is_empty()) else {
            continue;
        };
        let spectrum = |parts: &[&[f64]]| PowerSpectrum::of_blocks(parts, range.segment, f64::from(SAMPLE_RATE_HZ));
        let bands = band_errors_within_db(&spectrum(&own), &spectrum(other), range.band_edges_hz());
        errors.extend(bands.into_iter().flatten().map(f64::abs));
    }
    (!errors.is_empty()).then(|| mean(&errors))
}

impl Nearness {
    fn of(by: &'static str, recorded: &[f64], levels: &[f64], band_error_db: Option<f64>) -> Self {
        let off: Vec<f64> = levels.iter().zip(recorded).map(|(level, own)| level - own).collect();
        let (bias_db, middle) = (mean(&off), (mean(recorded), mean(levels)));
        let product = recorded
            .iter()
            .zip(levels)
            .map(|(a, b)| (a - middle.0) * (b - middle.1))
            .sum::<f64>()
            / recorded.len() as f64;
        let correlation = product / (variance(recorded) * variance(levels)).sqrt();
        Self {
            by,
            is_recording: false,
            correlation: Some(correlation).filter(|value| value.is_finite()),
            error_db: (energy(&off) / off.len() as f64).sqrt(),
            bias_db,
            spread_db: variance(levels).sqrt(),
            band_error_db,
        }
    }
}

impl AlongStrokes {
    /// The table of all predictions.
    pub fn table(&self) -> Table {
        let row = |near: &Nearness| {
            vec![
                near.by.to_owned(),
                number(near.correlation, 2),
                number(Some(near.error_db), 2),
                number(Some(near.bias_db), 2),
                number(Some(near.spread_db), 2),
                number(near.band_error_db, 2),
            ]
        };
        let headings = [
            "predicted by",
            "correlation",
            "error dB",
            "bias dB",
            "spread dB",
            "|band| dB",
        ];
        let title = format!("'{}' along {}", self.texture, counted(self.strokes, "stroke"));
        Table::new(&title, headings, self.nearness.iter().map(row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn along_strokes_the_nearest_baseline_is_named_with_its_figure() {
        let near = |by, error_db, is_recording| Nearness {
            by,
            is_recording,
            correlation: None,
            error_db,
            bias_db: -3.0,
            spread_db: 0.0,
            band_error_db: None,
        };
        let library = |played_db, averaged_db| [near("library", played_db, false), near("mean", averaged_db, false)];
        let said = |library: &[Nearness; 2], line_db, stroke_db| {
            let constant = near("constant level", 8.0, false);
            let line = near("line", line_db, false);
            let stroke = near("nearest stroke", stroke_db, true);
            let [played, averaged] = library;
            verdict([played, averaged], &[constant, line, stroke])
        };
        let far = said(&library(6.2, 6.0), 1.1, 6.1);
        assert_eq!(
            far,
            "levels 6.0 dB off, the best baseline, the line, 1.1 dB; 3 dB too quiet"
        );
        let by_stroke = said(&library(2.0, 1.0), 4.0, 2.5);
        assert!(
            by_stroke.starts_with("levels as near as the best baseline, the nearest stroke (2.5 dB)"),
            "{by_stroke}"
        );
        assert!(said(&library(4.0, 1.0), 1.2, 2.5).starts_with("levels as near as"));
    }
}
