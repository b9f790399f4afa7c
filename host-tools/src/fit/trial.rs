//! One trial: from its file to the statistics that a model is fitted to.

use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::autocorrelation::Autocorrelation;
use crate::dsp::reduction::{Reduction, reduce};
use crate::recording::triage;
use crate::recording::triage::{Fingerprint, Verdict};
use crate::recording::{self, Samples, Trial};
use crate::support::error::{Error, Result};

use super::bands::Bands;
use super::estimate::estimate;
use super::options::Options;

/// The statistics of a trial that a fit keeps.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// Biased autocorrelation of the reduced signal from lag 0 on, (m/s²)².
    pub lags: Vec<f64>,
    /// Third-octave bands of the reduced signal, by a path that no order limits.
    pub bands: Bands,
    /// Number of samples that it comes from.
    pub samples: usize,
    /// Variance of the reduced signal, (m/s²)².
    pub power: f64,
    /// Largest magnitude of an axis's mean, which was removed, m/s².
    pub mean_m_s2: f64,
    /// Share of the axes' energy that the reduced signal keeps.
    pub energy_share: f64,
    /// Duration that triage cut out of the trial, s.
    pub cut_s: f64,
    /// Findings of triage on the trial by itself.
    pub verdicts: Vec<Verdict>,
    /// A line at a mains frequency, Hz; whether it is hum, the other trials tell.
    pub mains_line_hz: Option<f64>,
    /// Content of the reduced signal, by which copies are found.
    pub fingerprint: Fingerprint,
}

impl Analysis {
    /// Returns whether triage found it silent.
    pub fn is_silent(&self) -> bool {
        self.verdicts.contains(&Verdict::Silent)
    }
}

/// A trial without what triage cuts.
struct Triaged {
    samples: Samples,
    verdicts: Vec<Verdict>,
    /// Duration that was cut, s.
    cut_s: f64,
    /// Stretches of the samples left that are no surface's.
    flaws: Vec<Range<usize>>,
}

/// Reads `trial` and keeps what triage does not cut.
fn triaged(trial: &Trial) -> Result<Triaged> {
    let mut samples = recording::read(trial)?;
    let verdicts = triage::samples(&samples);
    let length = |samples: &Samples| samples.axes.first().map_or(0, Vec::len);
    let before = length(&samples);
    let parts = triage::usable(&verdicts, before);
    let flaws = triage::kept_spans(&triage::flaws(&samples, &verdicts), &parts);
    samples.axes = triage::kept(samples.axes, &parts);
    let cut_s = (before - length(&samples)) as f64 / f64::from(SAMPLE_RATE_HZ);
    Ok(Triaged {
        samples,
        verdicts,
        cut_s,
        flaws,
    })
}

/// A trial reduced to one axis, without what triage cuts.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Samples at the models' rate, m/s², with a mean of zero.
    pub samples: Vec<f64>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Stretches of the samples that are no surface's: clipped peaks, joints, and what triage would have cut.
    pub flaws: Vec<Range<usize>>,
}

/// Reads `trial` as a fit does. What judges a fit is read by this too, so that both mean the same samples.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn signal(trial: &Trial, reduction: Reduction) -> Result<Signal> {
    let Triaged {
        mut samples, flaws, ..
    } = triaged(trial)?;
    let reduced = reduce(&mut samples.axes, reduction)
        .map_err(|missing| Error::file(&trial.file, missing.to_string()))?;
    Ok(Signal {
        samples: reduced.signal,
        source_rate_hz: samples.source_rate_hz,
        flaws,
    })
}

/// Reads and analyses `trial` for models of up to `max_order`.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn analyse(trial: &Trial, options: &Options, max_order: usize) -> Result<Analysis> {
    Ok(analyse_with_signal(trial, options, max_order)?.0)
}

/// As [`analyse`], with the reduced signal, m/s², beside the analysis.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn analyse_with_signal(
    trial: &Trial,
    options: &Options,
    max_order: usize,
) -> Result<(Analysis, Vec<f64>)> {
    let Triaged {
        mut samples,
        mut verdicts,
        cut_s,
        ..
    } = triaged(trial)?;
    let mean = |axis: &Vec<f64>| (axis.iter().sum::<f64>() / axis.len().max(1) as f64).abs();
    let mean_m_s2 = samples.axes.iter().map(mean).fold(0.0, f64::max);
    let reduced = reduce(&mut samples.axes, options.reduction)
        .map_err(|missing| Error::file(&trial.file, missing.to_string()))?;
    let fingerprint = triage::fingerprint(&reduced.signal);
    let autocorrelation = Autocorrelation::of(&reduced.signal, max_order);
    let power = autocorrelation.lags[0];
    if !power.is_finite() {
        let problem = "its samples are too large to be squared; check scale_m_s2";
        return Err(Error::file(&trial.file, problem));
    }
    let silent = power.sqrt() < options.silence_floor_m_s2 || power <= 0.0;
    if silent {
        verdicts.insert(0, Verdict::Silent);
    }
    let mains_line_hz = if silent {
        None
    } else {
        triage::mains_line(&autocorrelation)
    };
    let estimate = estimate(&reduced.signal, autocorrelation, options.estimator);
    let analysis = Analysis {
        samples: reduced.signal.len(),
        power,
        mean_m_s2,
        energy_share: reduced.energy_share,
        cut_s,
        verdicts,
        mains_line_hz,
        fingerprint,
        lags: estimate.lags,
        bands: estimate.bands,
    };
    Ok((analysis, reduced.signal))
}
