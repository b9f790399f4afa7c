//! The report of `stylus fit`, as JSON and as text.

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::spectrum::band_centre_hz;
use stylus_fit::fit::excitation::{CodebookReport, ExcitationReport};
use stylus_fit::fit::record::FoundLines;
use stylus_fit::fit::{Fit, TrialReport, by_speed};
use stylus_fit::texture::summary::TextureSummary;
use stylus_support::Warning;
use stylus_support::number::counted;

use crate::cli::output::{is_full, warn_of};
use crate::cli::table::table;

/// The report as JSON.
#[derive(serde::Serialize)]
pub struct FitReport<'a> {
    pub library: String,
    pub bytes: usize,
    pub warnings: Vec<Warning>,
    pub textures: Vec<TextureSummary>,
    pub trials: &'a [TrialReport],
    pub excitations: Vec<ExcitationReport>,
    pub lines: Vec<FoundLines>,
}

/// Returns lines that state what excites each texture's models, and why.
pub fn excitations(reports: &[ExcitationReport]) -> String {
    let texts: Vec<String> = reports.iter().map(excitation).collect();
    texts.join("\n")
}

fn excitation(report: &ExcitationReport) -> String {
    let mut lines = vec![
        format!("excitation of '{}'", report.texture),
        format!("  {}", report.source),
    ];
    lines.extend(report.codebooks.iter().map(codebook));
    lines.extend(report.lowered_db.map(|lowered_db| {
        format!(
            "    loudest moments limited by {:.1} dB, because they were louder than the recordings'; the RMS is kept",
            -lowered_db
        )
    }));
    lines.join("\n")
}

fn codebook(codebook: &CodebookReport) -> String {
    let range = |[low, high]: [f32; 2]| {
        if low < high {
            format!("{low} to {high}")
        } else {
            low.to_string()
        }
    };
    format!(
        "    codebook for {} mm/s: {:.1} s of {}, peak {:.1} standard deviations, {} cut, SNR {:.0} dB",
        range(codebook.speeds_mm_s),
        codebook.seconds,
        counted(codebook.trials, "trial"),
        codebook.peak,
        counted(codebook.cut_samples, "peak"),
        codebook.snr_db
    )
}

/// Returns each texture's lines that are tied to position, or the reason why there are none. Textures with the same
/// text share a row.
pub fn lines_found(fit: &Fit) -> String {
    let mut said: Vec<(String, Vec<&str>)> = Vec::new();
    for texture in &fit.textures {
        let words = texture.lines.to_string();
        match said.iter_mut().find(|(known, _)| *known == words) {
            Some((_, names)) => names.push(&texture.name),
            None => said.push((words, vec![&texture.name])),
        }
    }
    said.iter()
        .map(|(words, names)| format!("{}: {words}", names.join(", ")))
        .collect::<Vec<_>>()
        .join("\n")
}

/// Smallest fraction of power due to the rig's noise that is shown without --full.
const SHOWN_FLOOR: f32 = 0.1;

/// Returns a table of the fraction of the recordings' power that is due to the rig, by texture and speed, or a sentence
/// if no fraction is large enough to be shown; `None` if none is known.
pub fn rigs_share(fit: &Fit) -> Option<String> {
    let least = if is_full() { 0.0 } else { SHOWN_FLOOR };
    let band = |(band, share): (usize, f32)| {
        let of_band = || format!("{:.0} Hz {:.0}", band_centre_hz(band), 100.0 * share);
        (share >= least).then(of_band)
    };
    let (mut rows, mut is_known) = (Vec::new(), false);
    for texture in &fit.textures {
        let known = fit
            .trials
            .iter()
            .filter(|trial| trial.texture == texture.name && trial.used)
            .filter_map(|trial| Some((trial.speed_mm_s, trial.floor_shares.as_deref()?)));
        for at in by_speed(known) {
            is_known = true;
            let bands: Vec<String> = at.shares.into_iter().enumerate().filter_map(band).collect();
            if !bands.is_empty() {
                rows.push(vec![texture.name.clone(), at.speed_mm_s.to_string(), bands.join(", ")]);
            }
        }
    }
    if rows.is_empty() {
        let none = "the rig's own noise is below 10 % of the power of every third octave";
        return is_known.then(|| none.to_owned());
    }
    let heading = "the rig's share of each third octave's power, %";
    Some(table(&["texture", "speed (mm/s)", heading], &rows))
}

/// Returns the number of trials that were used; if some were left out, also the total.
pub fn trials_used(trials: &[TrialReport]) -> String {
    let used = trials.iter().filter(|trial| trial.used).count();
    if used == trials.len() {
        return counted(used, "trial");
    }
    format!("{used} of {}", counted(trials.len(), "trial"))
}

/// Returns mean and standard deviation of the fraction of energy that the reduction kept, over trials that are not
/// silent.
pub fn energy_kept(trials: &[TrialReport]) -> String {
    let shares: Vec<f64> = trials
        .iter()
        .filter(|trial| trial.rms_m_s2 > 0.0)
        .map(|trial| trial.energy_share * 100.0)
        .collect();
    if shares.is_empty() {
        return "none, because every trial is silent".to_owned();
    }
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let square: f64 = shares.iter().map(|share| (share - mean).powi(2)).sum();
    let deviation = (square / shares.len() as f64).sqrt();
    format!("{mean:.0} % ± {deviation:.0} %")
}

/// Describes recordings that were sampled below 5 kHz, and the frequency above which they contain nothing of the
/// surface; `None` if there are none. Rates too low for skin also have a verdict.
pub fn low_rates(trials: &[TrialReport]) -> Option<String> {
    let is_low = |rate_hz: &f64| *rate_hz < f64::from(SAMPLE_RATE_HZ);
    let low: Vec<f64> = (trials.iter().map(|trial| trial.source_rate_hz))
        .filter(is_low)
        .collect();
    let least_hz = low.iter().copied().reduce(f64::min)?;
    Some(format!(
        "sample rates below {SAMPLE_RATE_HZ} Hz in {} of {}, the lowest {least_hz} Hz: above {:.0} Hz nothing is known \
         of the surface",
        low.len(),
        counted(trials.len(), "recording"),
        least_hz / 2.0
    ))
}

/// Prints triage's verdicts and the fit's warnings to standard error.
pub fn show_verdicts(fit: &Fit) {
    warn_of(&[fit.verdicts(), fit.warnings()].concat());
}
