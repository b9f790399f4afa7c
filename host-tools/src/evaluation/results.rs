//! Results of an evaluation, trial by trial.

use serde::Serialize;

use super::held_out::JudgeKind;
use super::liveliness::TrialLiveliness;
use super::perception::Perceived;
use super::scoring_range::ScoringRange;
use crate::dsp::spectrum::BAND_COUNT;

/// Distances of a signal from the judge, a recording that was held out; none where they do not exist.
#[derive(Clone, Debug, Serialize)]
pub struct Scores {
    /// The paper's cost C, equation (6); of blocks, C of the mean of their smoothed amplitudes.
    pub cost: Option<f64>,
    /// Level over the judge's in each third-octave band from 20 to 1000 Hz that can be judged, dB.
    pub band_errors_db: [Option<f64>; BAND_COUNT],
    /// Log-spectral distance in sliding third octaves, dB.
    pub log_spectral_distance_db: Option<f64>,
    /// Differences that are felt.
    #[serde(flatten)]
    pub perceived: Option<Perceived>,
}

impl Scores {
    /// The scores of what cannot be compared.
    pub const NONE: Self = Self {
        cost: None,
        band_errors_db: [None; BAND_COUNT],
        log_spectral_distance_db: None,
        perceived: None,
    };
}

/// The comparison of one trial.
#[derive(Clone, Debug, Serialize)]
pub struct TrialEvaluation {
    /// The recording.
    pub file: String,
    /// Its texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// The kind of data that judged.
    pub judge: JudgeKind,
    /// The other take that judged, if one did.
    pub other_take: Option<String>,
    /// Frequencies that were judged; none if the judge is too short.
    pub range: Option<ScoringRange>,
    /// True if the judge or the stylus is silent; there are no scores then.
    pub is_silent: bool,
    /// RMS of the judge, m/s².
    pub recorded_rms_m_s2: f64,
    /// RMS of the synthesis, m/s².
    pub synthesised_rms_m_s2: f64,
    /// Properties that a spectrum does not show, of the judge and of what was played; none if nothing is held out or
    /// heard.
    pub liveliness: Option<TrialLiveliness>,
    /// The synthesis against the judge.
    #[serde(flatten)]
    pub scores: Scores,
    /// C of a perfect model of broadband noise, which is not 0 because its synthesis is noise of its own.
    pub cost_floor: f64,
    /// Another recording against the judge: the blocks or the take that were fitted.
    pub other: Scores,
    /// Log-spectral distance of the library as it is from what it was, or may have been, fitted to, dB.
    pub in_sample_log_spectral_distance_db: Option<f64>,
    /// Samples of the synthesis at full scale.
    pub saturations: u32,
}
