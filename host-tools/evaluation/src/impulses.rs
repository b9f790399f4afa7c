//! Impulses at each speed, because a median over a grid hides the speeds at which impulses are missing.

use serde::Serialize;
use stylus_dsp::liveliness::median;

use super::liveliness::{Role, TrialLiveliness};

/// Difference of kurtosis above which a trial's impulses are off, octaves.
pub const OFF_OCTAVES: f64 = 1.0;

/// Impulses of a texture's trials, by the kurtosis of the residual.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Impulses {
    /// Number of trials with a kurtosis of recording and synthesis.
    pub trials: usize,
    /// Number of trials in which the synthesis is more than an octave off the recording.
    pub trials_octave_off: usize,
    /// Number of trials in which the other recording is more than an octave off.
    pub trials_octave_off_other: usize,
    /// Medians over the trials of each speed, ascending.
    pub by_speed: Vec<AtSpeed>,
}

/// Impulses at one speed: medians over its trials.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtSpeed {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Number of trials.
    pub trials: usize,
    /// Residual kurtosis of the recordings.
    pub recorded_kurtosis: f64,
    /// Residual kurtosis of the syntheses.
    pub kurtosis: f64,
    /// log₂ of the ratio of the synthesis's kurtosis to the recording's.
    pub octaves: f64,
    /// log₂ of the ratio of the other recording's kurtosis to the recording's; none without another recording.
    pub octaves_other: Option<f64>,
}

/// Residual kurtosis of a trial: of recording, synthesis and other recording.
#[derive(Clone, Copy)]
struct Kurtosis {
    speed_mm_s: f64,
    recorded: f64,
    synthesised: f64,
    other: Option<f64>,
}

impl Kurtosis {
    fn of(speed_mm_s: f64, liveliness: &TrialLiveliness) -> Option<Self> {
        let of = |role| {
            let own = liveliness.signals.iter().find(|signal| signal.role == role);
            own?.measures.residual_kurtosis
        };
        Some(Self {
            speed_mm_s,
            recorded: of(Role::Recording)?,
            synthesised: of(Role::Synthesis)?,
            other: of(Role::Other),
        })
    }

    fn octaves(&self) -> f64 {
        (self.synthesised / self.recorded).log2()
    }

    fn octaves_other(&self) -> Option<f64> {
        self.other.map(|other| (other / self.recorded).log2())
    }
}

impl Impulses {
    /// The impulses of `trials`, each with its speed, mm/s.
    pub(super) fn of<'a>(trials: impl Iterator<Item = (f64, &'a TrialLiveliness)>) -> Self {
        let mut all: Vec<Kurtosis> = trials.filter_map(|(v, own)| Kurtosis::of(v, own)).collect();
        // `chunk_by` below joins neighbours only.
        all.sort_by(|a, b| a.speed_mm_s.total_cmp(&b.speed_mm_s));
        let is_off = |octaves: f64| octaves.abs() > OFF_OCTAVES;
        let by_speed = all.chunk_by(|a, b| a.speed_mm_s == b.speed_mm_s);
        Self {
            trials: all.len(),
            trials_octave_off: all.iter().filter(|own| is_off(own.octaves())).count(),
            trials_octave_off_other: (all.iter().filter_map(Kurtosis::octaves_other))
                .filter(|octaves| is_off(*octaves))
                .count(),
            by_speed: by_speed.filter_map(AtSpeed::of).collect(),
        }
    }
}

impl AtSpeed {
    /// The medians of `trials` at one speed; `None` without a trial.
    fn of(trials: &[Kurtosis]) -> Option<Self> {
        Some(Self {
            speed_mm_s: trials.first()?.speed_mm_s,
            trials: trials.len(),
            recorded_kurtosis: median(trials.iter().map(|own| own.recorded))?,
            kurtosis: median(trials.iter().map(|own| own.synthesised))?,
            octaves: median(trials.iter().map(Kurtosis::octaves))?,
            octaves_other: median(trials.iter().filter_map(Kurtosis::octaves_other)),
        })
    }
}

/// Returns the speeds, mm/s, of `all` that `is_named` selects, in words after a space: " up to 80 mm/s".
pub(super) fn speeds_in_words(all: &[AtSpeed], is_named: impl Fn(&AtSpeed) -> bool) -> String {
    let runs = all.chunk_by(|a, b| is_named(a) == is_named(b));
    let mut begin = 0;
    let mut named = Vec::new();
    for run in runs {
        let (is_first, is_last) = (begin == 0, begin + run.len() == all.len());
        begin += run.len();
        let (low, high) = (run[0].speed_mm_s, run[run.len() - 1].speed_mm_s);
        if is_named(&run[0]) {
            named.push(match (is_first, is_last) {
                (true, true) => "at every speed".to_owned(),
                // A single speed is named as such, even at an end of the grid.
                _ if run.len() == 1 => format!("at {low} mm/s"),
                (true, false) => format!("up to {high} mm/s"),
                (false, true) => format!("at {low} mm/s and above"),
                (false, false) => format!("from {low} to {high} mm/s"),
            });
        }
    }
    format!(" {}", named.join(", "))
}
