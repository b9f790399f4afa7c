//! One trial: from its file to the statistics that a model is fitted to.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};

use super::estimate::Bands;
use super::estimate::estimate_at;
use super::lines::TrialLines;
use super::options::Options;
use crate::dsp::autocorrelation::Autocorrelation;
use crate::dsp::high_pass::{high_pass, slow_share};
use crate::dsp::reduction::{Reduction, angle_deg, reduce, remove_mean};
use crate::dsp::sums::mean;
use crate::fit::conditioning::{Conditioning, HighPass};
use crate::recording::triage::{Kind, Sketch, Verdict, in_words};
use crate::recording::{self, Samples, Trial, triage};
use crate::support::error::{Error, Result};

/// A trial's slow motion, and its remedy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SlowMotion {
    /// Share of the axes' power below 10 Hz.
    pub share: f64,
    /// Cut-off frequency at which the axes were filtered, Hz; none if they were not.
    pub cut_hz: Option<f64>,
    /// Angle by which slow motion turns the principal axis, degrees; 0 where it is not one of several axes.
    pub turn_deg: f64,
}

/// The statistics of a trial that a fit keeps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Slow motion of hand or rig.
    pub slow: SlowMotion,
    /// Duration that triage cut out of the trial, s.
    pub cut_s: f64,
    /// Findings of triage on the trial by itself.
    pub verdicts: Vec<Verdict>,
    /// A line at a mains frequency, Hz; whether it is hum, the other trials tell.
    pub mains_line_hz: Option<f64>,
    /// Sketch of the reduced signal, by which copies are found.
    pub sketch: Sketch,
    /// Its share of the texture's lines, which `lags` and `bands` are without; none before they are sought.
    pub lines: TrialLines,
}

impl Analysis {
    /// Returns whether triage found it silent.
    pub fn is_silent(&self) -> bool {
        self.verdicts
            .iter()
            .any(|verdict| verdict.kind() == Kind::Silent)
    }
}

/// A trial without what triage cuts, filtered.
struct Triaged {
    samples: Samples,
    /// Largest magnitude of an axis's mean before the filter, m/s².
    mean_m_s2: f64,
    slow: SlowMotion,
    verdicts: Vec<Verdict>,
    /// Duration that was cut, s.
    cut_s: f64,
    /// Stretches of the samples left that are no surface's.
    flaws: Vec<Range<usize>>,
    /// Stretches of the whole trial that are left.
    parts: Vec<Range<usize>>,
}

/// Reads `trial`, keeps what triage does not cut, and filters it.
fn triaged(trial: &Trial, conditioning: Conditioning) -> Result<Triaged> {
    let samples = recording::read(trial)?;
    let verdicts = triage::samples(&samples);
    Ok(without_cuts(samples, verdicts, conditioning))
}

/// Keeps what `verdicts` do not cut, filtered.
fn without_cuts(
    mut samples: Samples,
    verdicts: Vec<Verdict>,
    conditioning: Conditioning,
) -> Triaged {
    let length = |samples: &Samples| samples.axes.first().map_or(0, Vec::len);
    let before = length(&samples);
    let parts = triage::usable(&verdicts, before);
    let flaws = triage::kept_spans(&triage::flaws(&samples, &verdicts), &parts);
    let whole = samples.axes.clone();
    samples.axes = triage::kept(samples.axes, &parts);
    let mean_of = |axis: &Vec<f64>| mean(axis).abs();
    let mean_m_s2 = samples.axes.iter().map(mean_of).fold(0.0, f64::max);
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let share = slow_share(&samples.axes, rate_hz);
    let mut slow = SlowMotion {
        share,
        cut_hz: conditioning.high_pass.cut_hz(share),
        turn_deg: 0.0,
    };
    let advised = HighPass::Auto.cut_hz(share).or(slow.cut_hz);
    if let Some(cut_hz) = advised {
        let filtered = triage::kept(filtered(whole, &parts, rate_hz, cut_hz), &parts);
        if conditioning.reduction == Reduction::Pca && filtered.len() > 1 {
            samples.axes.iter_mut().for_each(|axis| remove_mean(axis));
            slow.turn_deg = angle_deg(&samples.axes, &filtered);
        }
        if slow.cut_hz.is_some() {
            samples.axes = filtered;
        }
    }
    let cut_s = (before - length(&samples)) as f64 / f64::from(SAMPLE_RATE_HZ);
    Triaged {
        samples,
        mean_m_s2,
        slow,
        verdicts,
        cut_s,
        flaws,
        parts,
    }
}

/// `axes` at `rate_hz`, each of their `parts` filtered by itself, so that nothing rings from what is cut out.
fn filtered(
    mut axes: Vec<Vec<f64>>,
    parts: &[Range<usize>],
    rate_hz: f64,
    cut_hz: f64,
) -> Vec<Vec<f64>> {
    for axis in &mut axes {
        if parts.is_empty() {
            high_pass(axis, rate_hz, cut_hz);
        }
        for part in parts {
            high_pass(&mut axis[part.clone()], rate_hz, cut_hz);
        }
    }
    axes
}

/// The axes of `trial` at `rate_hz`, a multiple of 5 kHz, without what triage cut out of it at 5 kHz, filtered at
/// `cut_hz`.
fn kept_at(
    trial: &Trial,
    rate_hz: u32,
    parts: &[Range<usize>],
    cut_hz: Option<f64>,
) -> Result<Vec<Vec<f64>>> {
    let samples = recording::read_at(trial, rate_hz)?;
    if samples.source_rate_hz < f64::from(rate_hz) {
        let problem = format!(
            "has {} Hz, and models at {rate_hz} Hz need recordings of that rate or above: fit at {SAMPLE_RATE_HZ} Hz",
            samples.source_rate_hz
        );
        return Err(Error::file(&trial.file, problem));
    }
    let ratio = (rate_hz / SAMPLE_RATE_HZ) as usize;
    let length = samples.axes.first().map_or(0, Vec::len);
    let at_rate = |at: usize| (at * ratio).min(length);
    let parts: Vec<_> = (parts.iter())
        .map(|part| at_rate(part.start)..at_rate(part.end))
        .collect();
    let axes = match cut_hz {
        Some(cut_hz) => filtered(samples.axes, &parts, f64::from(rate_hz), cut_hz),
        None => samples.axes,
    };
    Ok(triage::kept(axes, &parts))
}

/// A trial reduced to one axis, without what triage cuts.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Samples at the models' rate, m/s², with a mean of zero.
    pub samples: Vec<f64>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Cut-off frequency at which the axes were filtered, Hz; none if they were not.
    pub cut_hz: Option<f64>,
    /// Stretches of the samples that are no surface's: clipped peaks, joints, and what triage would have cut.
    pub flaws: Vec<Range<usize>>,
}

/// Reads `trial` as a fit does. What judges a fit is read by this too, so that both mean the same samples.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn signal(trial: &Trial, conditioning: Conditioning) -> Result<Signal> {
    reduced(trial, triaged(trial, conditioning)?, conditioning.reduction)
}

/// As [`signal`], without triage: `verdicts` are what triage found on this trial. Without verdicts nothing is cut, and
/// every moment stays in its place.
///
/// # Errors
/// Those of [`signal`].
pub fn signal_of_judged(
    trial: &Trial,
    verdicts: &[Verdict],
    conditioning: Conditioning,
) -> Result<Signal> {
    let triaged = without_cuts(recording::read(trial)?, verdicts.to_vec(), conditioning);
    reduced(trial, triaged, conditioning.reduction)
}

fn reduced(trial: &Trial, triaged: Triaged, reduction: Reduction) -> Result<Signal> {
    let Triaged {
        mut samples,
        flaws,
        slow,
        ..
    } = triaged;
    let reduced = reduce(&mut samples.axes, reduction)
        .map_err(|missing| Error::file(&trial.file, missing.to_string()))?;
    Ok(Signal {
        samples: reduced.signal,
        source_rate_hz: samples.source_rate_hz,
        cut_hz: slow.cut_hz,
        flaws,
    })
}

/// Reads and analyses `trial` for models of up to `max_order`, at the rate of `options`. Triage is at 5 kHz.
///
/// # Errors
/// A file that cannot be used, or without the axis that was asked for.
pub fn analyse(trial: &Trial, options: &Options, max_order: usize) -> Result<Analysis> {
    Ok(analyse_with_signal(trial, options, max_order)?.0)
}

/// As [`analyse`], with the reduced signal.
///
/// # Errors
/// Those of [`analyse`].
pub fn analyse_with_signal(
    trial: &Trial,
    options: &Options,
    max_order: usize,
) -> Result<(Analysis, Signal)> {
    let Triaged {
        mut samples,
        mean_m_s2,
        slow,
        mut verdicts,
        cut_s,
        flaws,
        parts,
    } = triaged(trial, options.conditioning)?;
    let reduction = options.conditioning.reduction;
    let reduced = reduce(&mut samples.axes, reduction)
        .map_err(|missing| Error::file(&trial.file, missing.to_string()))?;
    let sketch = Sketch::of(&reduced.signal);
    let mut autocorrelation = Autocorrelation::of(&reduced.signal, max_order);
    let mut power = autocorrelation.lags[0];
    if !power.is_finite() {
        let problem = "its samples are too large to be squared; check scale_m_s2";
        return Err(Error::file(&trial.file, problem));
    }
    let silent = power.sqrt() < options.silence_floor_m_s2 || power <= 0.0;
    if silent {
        verdicts.insert(0, Verdict::silent());
    }
    let mains_line_hz = if silent {
        None
    } else {
        triage::mains_line(&autocorrelation)
    };
    let signal = if options.sample_rate_hz == SAMPLE_RATE_HZ {
        reduced.signal
    } else {
        let mut axes = kept_at(trial, options.sample_rate_hz, &parts, slow.cut_hz)?;
        let reduced = reduce(&mut axes, reduction)
            .map_err(|missing| Error::file(&trial.file, missing.to_string()))?;
        autocorrelation = Autocorrelation::of(&reduced.signal, max_order);
        power = autocorrelation.lags[0];
        reduced.signal
    };
    let rate_hz = f64::from(options.sample_rate_hz);
    let estimate = estimate_at(rate_hz, &signal, autocorrelation, slow.cut_hz);
    if slow.cut_hz.is_some() {
        power = estimate.lags[0];
    }
    let analysis = Analysis {
        samples: signal.len(),
        power,
        mean_m_s2,
        energy_share: reduced.energy_share,
        slow,
        cut_s,
        verdicts,
        mains_line_hz,
        sketch,
        lines: TrialLines::default(),
        lags: estimate.lags,
        bands: estimate.bands,
    };
    let signal = Signal {
        samples: signal,
        source_rate_hz: samples.source_rate_hz,
        cut_hz: slow.cut_hz,
        flaws,
    };
    Ok((analysis, signal))
}

/// The account of a trial.
#[derive(Clone, Debug, Serialize)]
pub struct TrialReport {
    /// The file.
    pub file: String,
    /// Its texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// RMS of the reduced signal, m/s².
    pub rms_m_s2: f64,
    /// Largest magnitude of an axis's mean, which was removed, m/s².
    pub mean_m_s2: f64,
    /// Share of the axes' energy that the reduced signal keeps.
    pub energy_share: f64,
    /// Share of the axes' power below 10 Hz.
    pub slow_share: f64,
    /// Cut-off frequency at which the axes were filtered, Hz; none if they were not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub high_pass_hz: Option<f64>,
    /// Angle by which slow motion turns the principal axis, degrees.
    pub axis_turn_deg: f64,
    /// Duration that triage cut out of it, s.
    pub cut_s: f64,
    /// Findings of triage; none for a sound recording.
    #[serde(serialize_with = "in_words")]
    pub verdicts: Vec<Verdict>,
    /// True if the fit used it.
    pub used: bool,
}

/// Memory of which parts are taken until there is none left.
pub(super) struct Budget(AtomicUsize);

impl Budget {
    pub fn of(bytes: usize) -> Self {
        Self(AtomicUsize::new(bytes))
    }

    /// Returns whether there were `bytes` left, which are taken then.
    pub fn takes(&self, bytes: usize) -> bool {
        let less = |left: usize| left.checked_sub(bytes);
        self.0
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, less)
            .is_ok()
    }
}

/// Signals of the trials of a set, as far as they are kept.
#[derive(Default)]
pub(super) struct KeptSignals(Vec<Option<Signal>>);

impl KeptSignals {
    /// The signals of all trials, in the order of the set.
    pub fn of(signals: Vec<Option<Signal>>) -> Self {
        Self(signals)
    }

    /// Returns the signal of a trial, if it is kept.
    pub fn get(&self, trial: usize) -> Option<&Signal> {
        self.0.get(trial)?.as_ref()
    }

    /// Returns whether the signals of all `trials` are kept.
    pub fn has_all(&self, trials: &[usize]) -> bool {
        trials.iter().all(|&trial| self.get(trial).is_some())
    }

    /// Keeps the signals of `trials`.
    pub fn extend(&mut self, trials: &[usize], signals: Vec<Signal>) {
        for (&trial, signal) in trials.iter().zip(signals) {
            if self.0.len() <= trial {
                self.0.resize_with(trial + 1, || None);
            }
            self.0[trial] = Some(signal);
        }
    }

    /// Lets go of the signals of `trials`.
    pub fn forget(&mut self, trials: &[usize]) {
        for &trial in trials {
            if let Some(signal) = self.0.get_mut(trial) {
                *signal = None;
            }
        }
    }
}
