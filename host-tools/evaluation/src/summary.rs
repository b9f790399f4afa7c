//! Summary of an evaluation per texture, and the rows of the tables that commands and pages show.

use serde::Serialize;
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT};

use super::held_out::JudgeKind;
use super::impulses::Impulses;
use super::liveliness::{self, Summary, TrialLiveliness};
use super::loudness::{Loudness, Placed, TrialLoudness};
use super::perception::{Perceived, ScoringRange};
use super::table::{Table, number, percent};

/// Summary of a texture's trials. Silent trials are counted, and left out of all means.
#[derive(Clone, Debug, Serialize)]
pub struct TextureEvaluation {
    /// The texture.
    pub texture: String,
    /// The answer in one line.
    pub verdict: String,
    /// Number of trials that were compared.
    pub trials: usize,
    /// Number of trials in which the stylus or the recording is silent.
    pub silent: usize,
    /// Lowest and highest frequency of the bands at which all trials could be judged, Hz.
    pub bands_hz: Option<(f64, f64)>,
    /// Lowest and highest frequency of C, Hz.
    pub cost_hz: Option<(f64, f64)>,
    /// Mean of C.
    pub mean_cost: Option<f64>,
    /// Standard deviation of C.
    pub cost_deviation: Option<f64>,
    /// Mean of what C would be for a perfect model of broadband noise.
    pub mean_cost_floor: Option<f64>,
    /// Figures of the synthesis.
    #[serde(flatten)]
    pub synthesis: Means,
    /// Figures of another recording in place of the synthesis.
    pub other: Means,
    /// Mean of C of the other recording.
    pub mean_cost_other: Option<f64>,
    /// Properties that a spectrum does not show: of the judges, of what was played, and of the other recordings.
    pub liveliness: Vec<Summary>,
    /// Impulses, by speed.
    pub impulses: Impulses,
    /// The loudest events; none if nothing is held out, or if all trials are silent.
    pub loudest_5_ms: Option<Loudness>,
}

/// Means over trials; none where no trial has a value.
#[derive(Clone, Debug, Serialize)]
pub struct Means {
    /// Mean magnitude of the bands' errors, dB.
    pub mean_band_error_db: Option<f64>,
    /// Fraction of all bands within the amplitude JND of 2.2 dB.
    pub bands_within_jnd: Option<f64>,
    /// Mean log-spectral distance, dB.
    pub mean_log_spectral_distance_db: Option<f64>,
    /// Level error in third octaves, JND: the root of the mean square over trials, minus scatter.
    pub level_error_jnd: Option<f64>,
    /// Mean magnitude of the balance's error, dB.
    pub mean_balance_error_db: Option<f64>,
}

impl Means {
    fn of(scores: &[&Scores]) -> Self {
        let perceived = || scores.iter().filter_map(|scores| scores.perceived);
        let errors: Vec<f64> = scores
            .iter()
            .flat_map(|scores| scores.band_errors_db)
            .flatten()
            .map(f64::abs)
            .collect();
        let within = errors.iter().filter(|e| **e <= AMPLITUDE_JND_DB).count();
        Self {
            mean_band_error_db: mean(errors.iter().copied()),
            bands_within_jnd: (!errors.is_empty()).then(|| within as f64 / errors.len() as f64),
            mean_log_spectral_distance_db: mean(scores.iter().filter_map(|s| s.log_spectral_distance_db)),
            // Negative squares count in the mean. If each became 0 before, the scatter of noise would not cancel.
            level_error_jnd: mean(perceived().filter_map(|p| p.level_error_squared_jnd))
                .map(|square| square.max(0.0).sqrt()),
            mean_balance_error_db: mean(perceived().filter_map(|p| p.balance_error_db.map(f64::abs))),
        }
    }
}

/// The table of an evaluation: the synthesis, and in brackets the target.
pub(super) fn table(textures: &[TextureEvaluation], target: &str) -> Table {
    let row = |texture: &TextureEvaluation| {
        let (own, other) = (&texture.synthesis, &texture.other);
        let beside = |own: String, other: String| format!("{own} ({other})");
        let both = |of: &dyn Fn(&Means) -> String| beside(of(own), of(other));
        let costs = [texture.mean_cost, texture.mean_cost_other];
        let [cost, cost_other] = costs.map(|cost| percent(cost, 1));
        vec![
            ("texture", texture.texture.clone()),
            ("trials", texture.trials.to_string()),
            ("C, %", beside(cost, cost_other)),
            ("LSD, dB", both(&|m| number(m.mean_log_spectral_distance_db, 2))),
            ("bands within JND, %", both(&|m| percent(m.bands_within_jnd, 0))),
            ("level, JND", both(&|m| number(m.level_error_jnd, 2))),
        ]
    };
    Table::headed(target, textures.iter().map(row))
}

/// Explanation of the columns of the table of verdicts.
pub fn explanation() -> String {
    format!(
        "C: mismatch of spectra, equation (6) of the paper; as low as its target is good. LSD: log-spectral distance. \
         JND: just noticeable difference of level, {AMPLITUDE_JND_DB} dB; bands: share of third octaves within one; \
         level: their RMS error without the scatter of noise."
    )
}

/// Further tables of an evaluation: of spectra, and what a spectrum does not show.
pub(super) fn tables(textures: &[TextureEvaluation], liveliness: &[Summary]) -> [Table; 2] {
    let row = |texture: &TextureEvaluation| {
        let (own, other) = (&texture.synthesis, &texture.other);
        let hz = |(low, high): (f64, f64)| format!("{low:.0} to {high:.0}");
        vec![
            ("texture", texture.texture.clone()),
            ("silent trials", texture.silent.to_string()),
            ("judged, Hz", texture.bands_hz.map_or("-".into(), hz)),
            ("C, ± sd", percent(texture.cost_deviation, 1)),
            ("|band|, dB", number(own.mean_band_error_db, 2)),
            ("|balance|, dB", number(own.mean_balance_error_db, 1)),
            ("balance, other", number(other.mean_balance_error_db, 1)),
        ]
    };
    let lively = textures.iter().map(|t| (t.texture.clone(), t.liveliness.as_slice()));
    let all = (textures.len() > 1).then(|| ("all".to_owned(), liveliness));
    let lively: Vec<(String, &[Summary])> = lively.chain(all).collect();
    [
        Table::headed("Spectra", textures.iter().map(row)),
        liveliness_table("What the spectrum does not show", &lively),
    ]
}

/// Properties that a spectrum does not show, of textures or trials by name.
pub fn liveliness_table(title: &str, of: &[(String, &[Summary])]) -> Table {
    let row = |name: &str, summary: &Summary| {
        let Summary {
            median, differences, ..
        } = summary;
        vec![
            name.to_owned(),
            summary.in_words(),
            number(median.kurtosis, 1),
            number(differences.kurtosis_octaves, 2),
            number(median.residual_kurtosis, 2),
            number(median.crest_factor, 1),
            number(median.modulation, 2),
            number(differences.modulation_db, 1),
            number(median.level_spread_db, 1),
            number(differences.level_spread_db, 1),
            number(median.line_range_db, 1),
        ]
    };
    let rows = of.iter().flat_map(|(name, summaries)| {
        // Only the first row has the name.
        std::iter::once(name.as_str())
            .chain(std::iter::repeat(""))
            .zip(*summaries)
            .map(|(name, summary)| row(name, summary))
    });
    Table::new(
        title,
        [
            "texture",
            "signal",
            "signal's kurtosis",
            "off, log2",
            "residual's kurtosis",
            "crest factor",
            "modulation",
            "off, dB",
            "50 ms levels, dB",
            "off, dB",
            "line's range, dB",
        ],
        rows,
    )
}

/// An explanation of [`liveliness_table`].
pub const LIVELINESS_EXPLANATION: &str = "\
     Medians over trials. Kurtosis: 3 for Gaussian noise; residual kurtosis: of the prediction error in windows of \
     50 ms, 2.94 for Gaussian noise; crest factor: greatest magnitude over the RMS; modulation: the envelope's 8 to \
     64 Hz over its mean, of 100 to 1000 Hz; 50 ms levels: their standard deviation; line's range: of the \
     recording's strongest narrow line in windows of 0.5 s; off: distance from the recording, which the other \
     recording has, too.";

/// Summarises the trials of texture `name`.
pub(super) fn summarise<'t>(name: &str, trials: &'t [TrialEvaluation]) -> TextureEvaluation {
    let members: Vec<&'t TrialEvaluation> = trials.iter().filter(|t| t.texture == name).collect();
    let heard: Vec<&'t TrialEvaluation> = members.iter().copied().filter(|trial| !trial.is_silent).collect();
    let costs = || heard.iter().filter_map(|trial| trial.scores.cost);
    let mean_cost = mean(costs());
    let deviation = mean_cost.and_then(|m| mean(costs().map(|c| (c - m).powi(2))));
    let held_out = heard.iter().filter(|t| t.judge != JudgeKind::Nothing);
    let scores: Vec<&Scores> = heard.iter().map(|trial| &trial.scores).collect();
    let others: Vec<&Scores> = heard.iter().map(|trial| &trial.other).collect();
    let common = |ranges: &mut dyn Iterator<Item = (f64, f64)>| ranges.reduce(|a, b| (a.0.max(b.0), a.1.min(b.1)));
    let ranges = || heard.iter().filter_map(|trial| trial.range);
    let lively = || {
        let of = |trial: &&'t TrialEvaluation| Some((trial.speed_mm_s, trial.liveliness.as_ref()?));
        heard.iter().filter_map(of)
    };
    TextureEvaluation {
        texture: name.to_owned(),
        verdict: String::new(),
        trials: heard.len(),
        silent: members.len() - heard.len(),
        bands_hz: common(&mut ranges().map(|range| range.band_edges_hz())),
        cost_hz: common(&mut ranges().map(|range| range.cost_hz)),
        mean_cost,
        cost_deviation: deviation.map(f64::sqrt),
        mean_cost_floor: mean(held_out.map(|trial| trial.cost_floor)),
        synthesis: Means::of(&scores),
        other: Means::of(&others),
        mean_cost_other: mean(others.iter().filter_map(|scores| scores.cost)),
        liveliness: liveliness::summaries(lively().map(|(_, own)| own)),
        impulses: Impulses::of(lively()),
        loudest_5_ms: Loudness::of(heard.iter().filter_map(|trial| trial.loudest_5_ms)),
    }
}

/// Returns the mean; `None` without values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// The frequencies of all figures, in words.
pub(super) fn judged_hz(trials: &[TrialEvaluation]) -> String {
    let ends = |of: fn(ScoringRange) -> (f64, f64)| {
        let (low, high) = trials
            .iter()
            .filter(|trial| !trial.is_silent)
            .filter_map(|trial| trial.range)
            .map(of)
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some(format!("{low:.0} to {high:.0} Hz"))
    };
    let found = ends(|range| range.band_edges_hz())
        .zip(ends(|range| range.distance_hz()))
        .zip(ends(|range| range.cost_hz));
    let Some(((bands, distance), cost)) = found else {
        return "Nothing could be judged: recordings are silent, too short or too slow.".into();
    };
    format!(
        "Judged: third octaves from {bands}, LSD from {distance}, C from {cost}; nothing above 0.9 of half a \
         recording's own sample rate, nor where its blocks do not resolve a third octave."
    )
}

/// The target in words: the other recording in the place of the synthesis.
pub(super) fn target_in_words(trials: &[TrialEvaluation]) -> &'static str {
    let takes = trials.iter().filter(|trial| trial.judge == JudgeKind::OtherTake);
    match takes.count() {
        0 => "In brackets the target: how far two parts of one recording are from each other",
        all if all == trials.len() => "In brackets the target: how far two takes of one surface are from each other",
        _ => "In brackets the target: how far two takes, or parts of one, are from each other",
    }
}

/// Distances of a signal from the judge, which is a held-out recording. A distance is none if it does not exist.
#[derive(Clone, Debug, Serialize)]
pub struct Scores {
    /// The paper's cost C, equation (6); for blocks, it is that of the mean of their smoothed amplitudes.
    pub cost: Option<f64>,
    /// Level relative to the judge's in each third-octave band from 20 to 1000 Hz that can be judged, dB.
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
    /// Texture of the recording.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// The kind of data that judged.
    pub judge: JudgeKind,
    /// File of the other take, if that take is the judge.
    pub other_take: Option<String>,
    /// Frequencies that were judged; none if a recording is too short, or its sample rate too low.
    pub range: Option<ScoringRange>,
    /// True if the judge or the stylus is silent; there are no scores then.
    pub is_silent: bool,
    /// RMS of the judge, m/s².
    pub recorded_rms_m_s2: f64,
    /// RMS of the synthesis, m/s².
    pub synthesised_rms_m_s2: f64,
    /// Properties that a spectrum does not show, of the judge and of what was played; none if nothing is held out, or
    /// if the trial is silent.
    pub liveliness: Option<TrialLiveliness>,
    /// The loudest 5 ms; none if nothing is held out, or if the trial is silent.
    pub loudest_5_ms: Option<TrialLoudness>,
    /// The synthesis against the judge.
    #[serde(flatten)]
    pub scores: Scores,
    /// C of a perfect model of broadband noise, which is not 0 because the synthesis has noise of its own.
    pub cost_floor: f64,
    /// Another recording against the judge: the blocks or the take that were fitted.
    pub other: Scores,
    /// Samples of the synthesis at full scale.
    pub saturations: u32,
}

impl TrialEvaluation {
    /// The trial's loudness, if it has one, with its place.
    pub(super) fn placed(&mut self) -> Option<Placed<'_>> {
        Some(Placed {
            speed_mm_s: self.speed_mm_s,
            force_n: self.force_n,
            loudness: self.loudest_5_ms.as_mut()?,
        })
    }
}
