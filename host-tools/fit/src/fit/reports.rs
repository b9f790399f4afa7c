//! The report on every trial of a set: findings on the trial by itself, and findings from the comparison of all trials.

use serde::Serialize;
use stylus_signals::recording::Unscaled;
use stylus_signals::recording::triage::{self, Compared, Verdict, in_words};
use stylus_support::names::portable;
use stylus_support::{Error, Result};

use super::options::Options;
use super::recordings::{Recorded, Recordings};
use super::trial::FloorShares;

/// The report on a trial.
#[derive(Clone, Debug, Serialize)]
pub struct TrialReport {
    /// The file.
    pub file: String,
    /// Texture of the trial.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// RMS of the reduced signal, m/s².
    pub rms_m_s2: f64,
    /// Largest magnitude of an axis's mean, m/s². The means were removed.
    pub mean_m_s2: f64,
    /// Fraction of the axes' energy that the reduced signal keeps.
    pub energy_share: f64,
    /// Fraction of the axes' power below 10 Hz.
    pub slow_share: f64,
    /// Cut-off frequency of the high-pass filter of the axes, Hz; `None` if they were not filtered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub high_pass_hz: Option<f64>,
    /// Angle by which slow motion turns the principal axis, degrees.
    pub axis_turn_deg: f64,
    /// Duration that triage cut out of the recording, s.
    pub cut_s: f64,
    /// Number of samples behind its model, at the models' rate.
    pub samples: usize,
    /// Duration of these samples, s.
    pub seconds: f64,
    /// Changes made to the samples when they were read, such as a conversion of units.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// Kind of the samples, if nothing states their acceleration.
    #[serde(skip)]
    pub unscaled: Option<Unscaled>,
    /// Findings of triage; empty if there are none.
    #[serde(serialize_with = "in_words")]
    pub verdicts: Vec<Verdict>,
    /// Fraction of the rig's noise in the recording's power, 0 to 1, for each third octave from 20 Hz to 2 kHz; `None`
    /// if the noise is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor_shares: Option<Box<FloorShares>>,
    /// True if the fit used the trial.
    pub used: bool,
}

impl TrialReport {
    /// Returns true for a trial with a verdict, unless all that was found are rests that the fit left out.
    pub fn is_doubtful(&self) -> bool {
        let is_left_out = |own: &Verdict| own.kind() == triage::Kind::PartlySilent && self.cut_s > 0.0;
        !self.verdicts.iter().all(is_left_out)
    }
}

/// Returns the report on every trial, including the verdicts that need a comparison of trials.
///
/// # Errors
/// With [`Options::strict`] the first trial with a verdict, or of samples without a unit.
pub(super) fn reports(recordings: &[Recordings<'_>], options: &Options) -> Result<Vec<TrialReport>> {
    let mut recorded: Vec<&Recorded> = recordings.iter().flat_map(|own| &own.trials).collect();
    // In the order of the list, because a copy is reported with its original's number in it.
    recorded.sort_by_key(|own| own.number);
    let is_dropped = |verdict: &Verdict| options.drop.iter().any(|d| d == verdict.name());
    let reports: Vec<TrialReport> = recorded
        .iter()
        .zip(all_verdicts(&recorded))
        .map(|(own, verdicts)| {
            let (trial, analysis) = (own.trial, &own.analysis);
            TrialReport {
                file: portable(&trial.file),
                texture: trial.texture.clone(),
                speed_mm_s: trial.speed_mm_s,
                force_n: trial.force_n,
                source_rate_hz: analysis.source_rate_hz,
                rms_m_s2: analysis.power.sqrt(),
                mean_m_s2: analysis.mean_m_s2,
                energy_share: analysis.energy_share,
                slow_share: analysis.slow.share,
                high_pass_hz: analysis.slow.cut_hz,
                axis_turn_deg: analysis.slow.turn_deg,
                cut_s: analysis.cut_s,
                samples: analysis.samples,
                seconds: analysis.samples as f64 / f64::from(options.sample_rate_hz),
                remarks: analysis.account.remarks.clone(),
                unscaled: analysis.account.unscaled,
                floor_shares: analysis.floor.clone(),
                used: !verdicts.iter().any(is_dropped) && trial.is_in_motion_and_contact(),
                verdicts,
            }
        })
        .collect();
    let mut doubtful = recorded.iter().zip(&reports).filter_map(|(own, report)| {
        let unscaled = || report.unscaled.map(|_| "samples without a unit: give --scale".into());
        let first = report.verdicts.first().map(ToString::to_string);
        Some((own, first.or_else(unscaled)?))
    });
    match doubtful.next() {
        Some((own, problem)) if options.strict => {
            let problem = format!("{problem}; refused because of --strict");
            Err(Error::file(&own.trial.file, problem))
        }
        _ => Ok(reports),
    }
}

/// Returns the findings on every trial, including those that need a comparison of trials.
fn all_verdicts(recorded: &[&Recorded<'_>]) -> Vec<Vec<Verdict>> {
    let bands_of = |own: &&Recorded<'_>| own.analysis.bands.known_db(own.analysis.samples);
    let bands: Vec<_> = recorded.iter().map(bands_of).collect();
    let compared = recorded.iter().zip(&bands).map(|(own, bands_db)| Compared {
        texture: &own.trial.texture,
        speed_mm_s: own.trial.speed_mm_s,
        force_n: own.trial.force_n,
        bands_db,
        is_idle: !own.trial.is_in_motion_and_contact(),
        rms_m_s2: own.analysis.power.sqrt(),
        has_scale: own.analysis.account.unscaled.is_none(),
        mains_lines: &own.analysis.mains_lines,
        sketch: &own.analysis.sketch,
        verdicts: &own.analysis.verdicts,
    });
    triage::all_verdicts(&compared.collect::<Vec<_>>())
}
