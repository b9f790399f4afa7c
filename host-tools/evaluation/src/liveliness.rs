//! Properties of a texture that a power spectrum does not show, on held-out data: impulses, changes of level, and a
//! steady line. They are measured for the recording that judges, for the synthesis, and for another recording.
//!
//! A synthesis is longer than its judge, and kurtosis, crest factor and ranges grow with duration. So the synthesis is
//! measured in pieces with as many blocks as the judge has, and the median of the pieces counts. The line is the
//! judge's strongest line; the other signals are measured at its frequency.

use model_format::SAMPLE_RATE_HZ;
use serde::Serialize;
use stylus_dsp::liveliness::{Liveliness, median, strongest_line_hz};

use super::played::{Played, Version};

/// A signal's role in a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The recording that judges.
    Recording,
    /// The synthesis.
    Synthesis,
    /// Another version of the texture.
    Version(Played),
    /// Another recording: the fitted one.
    Other,
}

/// The measures of one signal of a comparison.
#[derive(Clone, Debug, Serialize)]
pub struct SignalMeasures {
    /// The signal's role.
    pub role: Role,
    /// The parts of the texture that are played, in words; none of recordings.
    pub parts: Option<String>,
    /// The measures.
    #[serde(flatten)]
    pub measures: Liveliness,
}

/// Signals of a comparison, m/s².
pub(super) struct Signals<'a> {
    /// The recording that judges, in blocks.
    pub judged: &'a [Vec<f64>],
    /// The synthesis.
    pub synthesised: &'a [f64],
    /// The parts of the texture that the synthesis plays, in words.
    pub parts: &'a str,
    /// Other versions of the texture.
    pub versions: &'a [Version],
    /// Another recording, the fitted one, in blocks.
    pub other: &'a [Vec<f64>],
}

/// The measures of a trial's signals.
#[derive(Clone, Debug, Serialize)]
pub struct TrialLiveliness {
    /// Frequency of the judge's strongest narrow line, Hz, if it has one.
    pub line_hz: Option<f64>,
    /// The recording first, then what was played, then the other recording.
    pub signals: Vec<SignalMeasures>,
}

/// Magnitudes of the differences of a signal's measures from those of the recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Differences {
    /// Difference of the kurtosis, as |log₂| of the ratio.
    pub kurtosis_octaves: Option<f64>,
    /// Difference of the residual's kurtosis, as |log₂| of the ratio.
    pub residual_kurtosis_octaves: Option<f64>,
    /// Difference of the crest factor, dB.
    pub crest_db: Option<f64>,
    /// Difference of the modulation, dB.
    pub modulation_db: Option<f64>,
    /// Difference of the spread of levels, dB.
    pub level_spread_db: Option<f64>,
    /// Difference of the range of the line's levels, dB.
    pub line_range_db: Option<f64>,
}

/// Medians over trials of the signals with one role in the comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The signals' role.
    pub role: Role,
    /// The parts of the texture that are played, in words; none of recordings.
    pub parts: Option<String>,
    /// Medians of the measures.
    pub median: Liveliness,
    /// Medians of the differences from the recording.
    pub differences: Differences,
}

impl TrialLiveliness {
    /// Measures the signals of a comparison.
    pub(super) fn of(signals: &Signals<'_>) -> Self {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let judged = slices(signals.judged);
        let line_hz = strongest_line_hz(&judged, rate_hz);
        let blocks = judged.len().max(1);
        let len = judged.iter().map(|block| block.len()).max().unwrap_or(0);
        let in_pieces = |of: &[&[f64]]| -> Liveliness {
            let measured: Vec<Liveliness> = of
                .chunks_exact(blocks)
                .map(|piece| Liveliness::of(piece, rate_hz, line_hz))
                .collect();
            // A signal with fewer blocks than the judge is one piece.
            if measured.is_empty() {
                Liveliness::of(of, rate_hz, line_hz)
            } else {
                Liveliness::median(&measured)
            }
        };
        let played = |role, parts: &str, synthesised: &[f64]| {
            let of: Vec<&[f64]> = synthesised.chunks_exact(len.max(1)).collect();
            SignalMeasures {
                role,
                parts: Some(parts.to_owned()),
                measures: in_pieces(&of),
            }
        };
        let recorded = |role, measures| SignalMeasures {
            role,
            parts: None,
            measures,
        };
        let mut measured = vec![
            recorded(Role::Recording, Liveliness::of(&judged, rate_hz, line_hz)),
            played(Role::Synthesis, signals.parts, signals.synthesised),
        ];
        measured.extend(
            signals
                .versions
                .iter()
                .map(|version| played(Role::Version(version.played), &version.parts, &version.synthesised)),
        );
        measured.push(recorded(Role::Other, in_pieces(&slices(signals.other))));
        Self {
            line_hz,
            signals: measured,
        }
    }

    /// The recording's measures.
    fn recording(&self) -> Liveliness {
        self.signals
            .iter()
            .find(|s| s.role == Role::Recording)
            .map_or(Liveliness::default(), |signal| signal.measures)
    }
}

/// Slices of blocks.
pub(super) fn slices(blocks: &[Vec<f64>]) -> Vec<&[f64]> {
    blocks.iter().map(Vec::as_slice).collect()
}

impl Differences {
    /// The differences of `signal` from `recording`, where both have a measure.
    pub fn of(recording: &Liveliness, signal: &Liveliness) -> Self {
        let pair = |measure: fn(&Liveliness) -> Option<f64>| measure(signal).zip(measure(recording));
        let octaves = |measure| pair(measure).map(|(a, b): (f64, f64)| (a / b).log2().abs());
        let ratio_db = |measure| pair(measure).map(|(a, b): (f64, f64)| (20.0 * (a / b).log10()).abs());
        let decibels = |measure| pair(measure).map(|(a, b)| (a - b).abs());
        let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
        Self {
            kurtosis_octaves: finite(octaves(|l| l.kurtosis)),
            residual_kurtosis_octaves: finite(octaves(|l| l.residual_kurtosis)),
            crest_db: finite(ratio_db(|l| l.crest_factor)),
            modulation_db: finite(ratio_db(|l| l.modulation)),
            level_spread_db: decibels(|l| l.level_spread_db),
            line_range_db: decibels(|l| l.line_range_db),
        }
    }

    fn median(of: &[Self]) -> Self {
        let median = |pick: fn(&Self) -> Option<f64>| median(of.iter().filter_map(pick));
        Self {
            kurtosis_octaves: median(|d| d.kurtosis_octaves),
            residual_kurtosis_octaves: median(|d| d.residual_kurtosis_octaves),
            crest_db: median(|d| d.crest_db),
            modulation_db: median(|d| d.modulation_db),
            level_spread_db: median(|d| d.level_spread_db),
            line_range_db: median(|d| d.line_range_db),
        }
    }
}

/// Returns the medians over trials for each role in the comparison, the recording first.
///
/// A summary covers the trials that have a signal with its role. The synthesis is named by its parts if they are the
/// same in all trials.
pub fn summaries<'a>(trials: impl Iterator<Item = &'a TrialLiveliness>) -> Vec<Summary> {
    let trials: Vec<&TrialLiveliness> = trials.collect();
    let roles = [
        Role::Recording,
        Role::Synthesis,
        Role::Version(Played::Fitted),
        Role::Version(Played::Residual),
        Role::Version(Played::Gaussian),
        Role::Other,
    ];
    let summary = |role: Role| {
        let signals: Vec<(Liveliness, &SignalMeasures)> = trials
            .iter()
            .flat_map(|trial| trial.signals.iter().map(|signal| (trial.recording(), signal)))
            .filter(|(_, signal)| signal.role == role)
            .collect();
        let parts = signals.first()?.1.parts.clone();
        // Models that are fitted to blocks may lack parts that the library has.
        let are_alike = signals.iter().all(|(_, signal)| signal.parts == parts);
        let measures: Vec<Liveliness> = signals.iter().map(|(_, signal)| signal.measures).collect();
        let differences: Vec<Differences> = signals
            .iter()
            .map(|(recording, signal)| Differences::of(recording, &signal.measures))
            .collect();
        Some(Summary {
            role,
            parts: if are_alike { parts } else { Some("its parts".into()) },
            median: Liveliness::median(&measures),
            differences: if role == Role::Recording {
                Differences::default()
            } else {
                Differences::median(&differences)
            },
        })
    };
    roles.into_iter().filter_map(summary).collect()
}

impl Summary {
    /// The signal in words.
    pub fn in_words(&self) -> String {
        match (self.role, &self.parts) {
            (Role::Recording, _) => "recording".into(),
            (Role::Other, _) => "other recording".into(),
            (Role::Synthesis, Some(parts)) => format!("synthesis: {parts}"),
            (Role::Synthesis, None) => "synthesis".into(),
            (Role::Version(_), Some(parts)) => parts.clone(),
            (Role::Version(_), None) => "another version".into(),
        }
    }
}
