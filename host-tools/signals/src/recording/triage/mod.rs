//! Verdicts on a recording before it is fitted.
//!
//! | verdict | found if | consequence besides a warning |
//! |---|---|---|
//! | silent | the RMS about the mean is below the silence floor | a silent node |
//! | too-short | fewer than [`SHORT_SAMPLES`] samples | a lower order |
//! | clipped | at least [`CLIPPED_SHARE`] of an axis's samples are at its extreme, in runs or at round tops | |
//! | dropouts, stuck | one value for 2 to 100 ms, longer than a natural run of equal values; zero, or another | cut |
//! | dropouts | gaps in the times; single samples that are missing | cut; interpolated up to 1 % |
//! | spikes | a sample's fourth difference is 20 times that of the 48 samples on either side | cut |
//! | bursts | 4 to 25 white samples on one axis are far from their prediction, and their surroundings are calm | cut |
//! | repeated | values are held, in even steps | each value is used once |
//! | coarse | the round-off of the steps is less than [`COARSE_SNR_DB`] below the signal | |
//! | truncated | the file is shorter than its header states, beyond the part that is used | |
//! | partly-silent | 0.1 s or more at 50 dB below the loud parts, or 0.4 s of steady noise at 15 dB below | cut |
//! | tap | 40 ms with 25 % of the energy, 9 dB above the next event | cut |
//! | level-change | a step or a ramp of 6 dB explains 60 % of the level's variance | |
//! | drifting | a straight line explains at least [`DRIFT_SHARE`] of an axis's energy | |
//! | wandering | 25 % of the energy is below [`SLOW_HZ`](stylus_dsp::high_pass::SLOW_HZ) | |
//! | hum | a mains line, or a harmonic's, is [`HUM_RATIO_DB`] above its surroundings at half the speeds | |
//! | scale | RMS above [`LARGE_RMS_M_S2`] or below feeling, mean above 2 g, 0.9 to 1.1 or 1 mg, header, 45 dB off | |
//! | dead-axis | an axis is 60 dB below the strongest, or constant | |
//! | duplicate | a copy of an earlier trial, equal or scaled | |
//! | unlike | from some frequency on, more than [`UNLIKE_NEIGHBOURS_DB`] from both neighbours in speed | |
//! | wrong-rate | the file's sample rate is below [`LEAST_RATE_HZ`] | |
//! | time-unit | only the steps of the times show that they are not in seconds | |
//! | joined | rows repeat the previous row out of step, like rows of other sensors | removed |
//! | bunches | short steps of the times, with long steps at regular intervals | |
//!
//! Hum keeps its frequency while the speed changes: a line that moves with the speed, and so explains lines at more
//! speeds, is the texture's. With one or two speeds every other line at a mains frequency counts as hum. A sample that
//! is not finite has no verdict, because [`read`](super::read) fails on it, and with it the whole fit. The same holds
//! for a file that ends within the part that is used, and for times that do not rise.
//!
//! A trial that is used in spite of a verdict marks its node as doubtful, unless it is silent, or all that was found
//! are rests that are cut. A flagged stretch is cut if
//! the remaining parts of at least 0.4 s make up half of the trial without its rests. Dropouts are cut also if the
//! remaining parts of at least 0.1 s do ([`usable`]). Silent trials are not compared for copies. At rest or without
//! contact, slow motion is not a finding. The option `--drop` leaves trials out, and `--strict` refuses the set.
//!
//! Bounds come from 24 real takes of a tool on 12 surfaces, whole and in parts of 2 s. None of them is in the
//! repository; the comments of the constants state the values that they reach. All measures are relative to the take
//! itself and robust, because the level of a take varies by 7 dB and its residual has a kurtosis of 25.
//!
//! Invariant: samples in (m/s² at 5 kHz, cut and scaled), verdicts out. Nothing here reads a file or drops a trial.

mod copies;
mod cut;
mod hum;
mod level;
mod scale;
mod set;
mod single_trial;
mod unlike;
mod verdict;

pub use copies::Sketch;
pub use cut::{LEAST_KEPT, kept, kept_spans, stretches, usable};
pub use hum::{HUM_RATIO_DB, MainsLine, mains_lines};
pub use scale::{LARGE_RMS_M_S2, SILENCE_FLOOR_M_S2};
pub use set::all_verdicts;
pub use single_trial::{CLIPPED_SHARE, COARSE_SNR_DB, DRIFT_SHARE, LEAST_RATE_HZ, SHORT_SAMPLES, flaws, samples};
pub use unlike::UNLIKE_NEIGHBOURS_DB;
pub use verdict::{Kind, Span, Verdict, in_words};

/// The properties of a trial that are compared with those of others.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// Name of the trial's texture.
    pub texture: &'a str,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Third-octave bands in which the recording is valid: centre, Hz, ascending, and level, dB.
    pub bands_db: &'a [(f64, f64)],
    /// True at rest or without contact, where there is only slow motion to record.
    pub is_idle: bool,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// False if the samples are integers of unknown acceleration.
    pub has_scale: bool,
    /// Lines at mains frequencies.
    pub mains_lines: &'a [MainsLine],
    /// Sketch of the trial's signal.
    pub sketch: &'a Sketch,
    /// Verdicts on the trial so far.
    pub verdicts: &'a [Verdict],
}

impl Compared<'_> {
    pub(super) fn is_silent(&self) -> bool {
        self.verdicts.iter().any(|verdict| verdict.kind() == Kind::Silent)
    }
}

/// Signals that several tests of this folder use.
#[cfg(test)]
pub(super) mod test_signals {
    use rand::{RngExt, SeedableRng};

    use model_format::SAMPLE_RATE_HZ;

    pub const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

    /// White noise of 2 s within ±2 m/s², of which no sample stands out as those of Gaussian noise do: not clipped, and
    /// without bursts.
    pub fn bounded_noise(seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..10_000)
            .map(|_| rng.random_range(-1.0..1.0) + rng.random_range(-1.0..1.0))
            .collect()
    }

    pub fn tone(frequency_hz: f64, amplitude: f64) -> impl Iterator<Item = f64> {
        let step = core::f64::consts::TAU * frequency_hz / RATE_HZ;
        (0..10_000).map(move |n| amplitude * (step * f64::from(n)).sin())
    }

    pub fn plus(signal: &[f64], other: impl Iterator<Item = f64>) -> Vec<f64> {
        signal.iter().zip(other).map(|(a, b)| a + b).collect()
    }
}
