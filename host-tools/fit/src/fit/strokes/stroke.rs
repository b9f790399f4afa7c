//! A free hand's stroke as a fit reads it: one axis at the models' rate, and the motion at each sample.

use std::ops::Range;
use std::path::{Path, PathBuf};

use model_format::{Provenance, SAMPLE_RATE_HZ, Texture};
use stylus_dsp::high_pass::high_pass;
use stylus_dsp::motion_law::LevelAt;
use stylus_dsp::sums::{energy, mean, sliding};
use stylus_signals::playing::motion::{MotionPath, MotionRow};
use stylus_signals::playing::render::render;
use stylus_signals::recording::freehand::{Freehand, jumps_s, moving};
use stylus_signals::recording::triage::{self, Kind, Verdict};
use stylus_signals::recording::{HeldSamples, Trial, read};
use stylus_support::Result;

use crate::fit::conditioning::Conditioning;
use crate::fit::trial::{Signal, whole_signal};

/// Length of the windows in which levels are measured, s.
const WINDOW_S: f64 = 0.1;

/// Rate of the models, Hz.
const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// Length of a window in samples at the models' rate.
const WINDOW: usize = (WINDOW_S * RATE_HZ) as usize;

/// Number of samples at the models' rate over which speed and force are averaged: 20 ms, which removes a sensor's noise
/// but not the hand's motion.
const STEADY: usize = 100;

/// Samples between two moments of the motion when a texture is played along it: 2 ms, as on the device.
const PATH_STEP: usize = 10;

/// Ratio of the cut-off frequency of the filter before levels are measured to that of the stroke's own filter. Near the
/// latter, a recording still holds some of the hand's motion, and a model holds none.
const LEVELS_OVER_CUT: f64 = 2.0;

/// Findings of triage that are normal for a hand, which moves, rests and lifts.
const BY_HAND: [Kind; 4] = [Kind::PartlySilent, Kind::Tap, Kind::LevelChange, Kind::Wandering];

/// Seed of the noise that is played along strokes.
const SEED: u64 = 1;

/// A stroke.
pub(super) struct Stroke {
    /// The file.
    pub file: PathBuf,
    /// Signal at the models' rate, m/s².
    pub signal: Vec<f64>,
    /// Speed, mm/s, and force, N, at each sample of the signal.
    pub motion: Vec<(f64, f64)>,
    /// Stretches of the signal in motion and contact, without what triage cuts.
    pub moving: Vec<Range<usize>>,
    /// Rate at which the stroke was recorded, Hz.
    pub recorded_hz: f64,
    /// Where the file's samples come from.
    pub provenance: Provenance,
    /// Cut-off frequency of the high-pass filter of the axes, Hz; `None` if they were not filtered.
    pub cut_hz: Option<f64>,
    /// Times at which the speed jumps by more than a hand can cause, s.
    pub jumps_s: Vec<f64>,
    /// Findings of triage, except those that are normal for a free hand.
    pub verdicts: Vec<Verdict>,
}

impl Stroke {
    /// Reads the stroke `recording`, which is in `file`.
    pub fn of(file: &Path, recording: &Freehand, conditioning: Conditioning) -> Result<Self> {
        let axes = HeldSamples::new(recording.rate_hz, recording.axes.clone(), false)?;
        let trial = Trial {
            held: Some(axes.into()),
            ..Trial::of(file, "", 0.0, 0.0)
        };
        let samples = read(&trial)?;
        let mut verdicts = triage::samples(&samples, samples.slow_share());
        // What is normal for a hand is not reported, but cut all the same.
        let cut: Vec<Range<usize>> = verdicts.iter().flat_map(Verdict::spans).cloned().collect();
        verdicts.retain(|verdict| !BY_HAND.contains(&verdict.kind()));
        // Nothing is cut from the signal, so that its samples keep the times of the motion.
        let Signal {
            samples: signal,
            cut_hz,
            ..
        } = whole_signal(&trial, conditioning)?;
        let per_sample = RATE_HZ / recording.rate_hz;
        let at_rate = |index: usize| ((index as f64 * per_sample) as usize).min(signal.len());
        let moving: Vec<Range<usize>> = moving(recording, WINDOW_S)
            .into_iter()
            .flat_map(|run| without(&(at_rate(run.start)..at_rate(run.end)), &cut))
            .filter(|run| run.len() >= WINDOW)
            .collect();
        let at_samples = |values: &[f64]| {
            let of = |sample: usize| values[((sample as f64 / per_sample) as usize).min(values.len() - 1)];
            averaged(&(0..signal.len()).map(of).collect::<Vec<_>>())
        };
        let speeds = at_samples(&recording.speed_mm_s);
        Ok(Self {
            motion: speeds.into_iter().zip(at_samples(&recording.force_n)).collect(),
            moving,
            signal,
            recorded_hz: recording.rate_hz,
            provenance: match (recording.is_simulated, recording.is_unscaled) {
                (true, _) => Provenance::Simulated,
                (false, true) => Provenance::Unscaled,
                (false, false) => Provenance::Recorded,
            },
            file: file.to_owned(),
            cut_hz,
            jumps_s: jumps_s(recording),
            verdicts,
        })
    }

    /// Returns the windows in motion and contact that are louder than `silence_m_s2`.
    pub fn windows(&self, silence_m_s2: f64) -> Vec<LevelAt> {
        let signal = self.for_levels(self.signal.clone());
        let window_at = |window: Range<usize>| {
            let (speeds, forces): (Vec<f64>, Vec<f64>) = self.motion[window.clone()].iter().copied().unzip();
            let power = energy(&signal[window]) / WINDOW as f64;
            (power > silence_m_s2.powi(2)).then(|| LevelAt {
                speed_mm_s: mean(&speeds),
                force_n: mean(&forces),
                level_db: 10.0 * power.log10(),
                weight: 1.0,
            })
        };
        self.window_ranges().filter_map(window_at).collect()
    }

    /// Returns the recorded level relative to that of `texture` along the stroke, for each window, dB. A window that is
    /// silent in either of them is left out.
    ///
    /// # Errors
    /// None for a stroke that could be read.
    pub fn over_db(&self, texture: Texture<'_>) -> Result<Vec<f64>> {
        let seconds = self.signal.len() as f64 / RATE_HZ;
        let mut played = render(texture, &self.path()?, seconds, SEED)?.accelerations_m_s2();
        played.resize(self.signal.len(), 0.0);
        // Filtered as the recording was, so that both lack the same band.
        if let Some(cut_hz) = self.cut_hz {
            high_pass(&mut played, RATE_HZ, cut_hz);
        }
        let [recorded, played] = [self.signal.clone(), played].map(|own| self.for_levels(own));
        Ok(self
            .window_ranges()
            .map(|window| {
                let power = |signal: &[f64]| energy(&signal[window.clone()]);
                10.0 * (power(&recorded) / power(&played)).log10()
            })
            .filter(|over_db| over_db.is_finite())
            .collect())
    }

    /// Returns `signal` without the rest of the hand's motion that is left in a filtered stroke.
    fn for_levels(&self, mut signal: Vec<f64>) -> Vec<f64> {
        if let Some(cut_hz) = self.cut_hz {
            high_pass(&mut signal, RATE_HZ, LEVELS_OVER_CUT * cut_hz);
        }
        signal
    }

    /// Returns the motion at the intervals at which the device reads it.
    fn path(&self) -> Result<MotionPath> {
        let moments = self.motion.iter().enumerate().step_by(PATH_STEP);
        MotionPath::from_rows(moments.map(|(sample, &(speed_mm_s, force_n))| MotionRow {
            time_s: sample as f64 / RATE_HZ,
            speed_mm_s,
            force_n,
            position_mm: None,
            contact: None,
        }))
    }

    fn window_ranges(&self) -> impl Iterator<Item = Range<usize>> {
        self.moving.iter().flat_map(|run| {
            // No run is shorter than a window; see `Stroke::of`.
            let last = run.end - WINDOW;
            (run.start..=last).step_by(WINDOW).map(|start| start..start + WINDOW)
        })
    }
}

/// Returns the parts of `run` between the spans that are `cut`.
fn without(run: &Range<usize>, cut: &[Range<usize>]) -> Vec<Range<usize>> {
    let mut cut: Vec<&Range<usize>> = (cut.iter())
        .filter(|span| span.start < run.end && span.end > run.start)
        .collect();
    cut.sort_by_key(|span| span.start);
    let mut parts = Vec::new();
    let mut from = run.start;
    for span in cut {
        parts.push(from..span.start.max(from));
        from = from.max(span.end);
    }
    parts.push(from..run.end.max(from));
    parts
}

/// Returns the moving mean of `values`. Beyond their ends, the first and the last value count.
fn averaged(values: &[f64]) -> Vec<f64> {
    let (Some(first), Some(last)) = (values.first(), values.last()) else {
        return Vec::new();
    };
    let mut padded = vec![*first; STEADY / 2];
    padded.extend(values);
    padded.resize(values.len() + STEADY - 1, *last);
    sliding(&padded, &[1.0 / STEADY as f64; STEADY])
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init, reason = "the spans are ranges")]
mod tests {
    use super::*;
    use test_helpers::near;

    #[test]
    fn what_is_cut_leaves_the_parts_between() {
        let cut = [50..60, 10..20, 15..30, 95..200];
        let parts: Vec<_> = without(&(12..100), &cut)
            .into_iter()
            .filter(|part| !part.is_empty())
            .collect();
        assert_eq!(parts, [30..50, 60..95]);
        assert_eq!(without(&(12..100), &[]), [12..100]);
        let none = without(&(12..100), &[0..300]);
        assert!(none.iter().all(Range::is_empty));
    }

    #[test]
    fn a_moving_mean_keeps_what_is_even_and_its_place() {
        let ramp: Vec<f64> = (0..1000).map(f64::from).collect();
        let mean = averaged(&ramp);
        assert_eq!(mean.len(), ramp.len());
        for at in STEADY..900 {
            near(mean[at], ramp[at], 0.5 + 1e-9);
        }
        assert!(averaged(&[3.0; 7]).iter().all(|value| (value - 3.0).abs() < 1e-12));
    }
}
