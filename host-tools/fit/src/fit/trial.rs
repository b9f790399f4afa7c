//! One trial: from its file to the statistics to which a model is fitted.

use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};
use stylus_dsp::autocorrelation::PaddedSpectrum;
use stylus_dsp::high_pass::high_pass;
use stylus_dsp::reduction::{Reduced, Reduction, angle_deg, reduce, remove_mean};
use stylus_dsp::sums::mean;
use stylus_signals::recording::triage::{Kind, MainsLine, Sketch, Verdict};
use stylus_signals::recording::{self, Account, Samples, Trial, triage};
use stylus_support::{Error, Result};

use super::blocks::Part;
use super::estimate::{Bands, Estimate, KnownBand, estimate, estimate_of};
use super::lines::TrialLines;
use super::options::Options;
use crate::fit::conditioning::{Conditioning, HighPass};

/// Number of third octaves for which the fraction of the rig's noise is given: those of
/// [`band_edges_hz`](stylus_dsp::spectrum::band_edges_hz) from 20 Hz to 2 kHz.
pub const FLOOR_BANDS: usize = 21;

/// Fraction of the rig's noise in a recording's power, 0 to 1, for each third octave.
pub type FloorShares = [f32; FLOOR_BANDS];

/// A trial's slow motion, and the filter against it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SlowMotion {
    /// Fraction of the axes' power below 10 Hz.
    pub share: f64,
    /// Cut-off frequency of the high-pass filter of the axes, Hz; `None` if they were not filtered.
    pub cut_hz: Option<f64>,
    /// Angle by which slow motion turns the principal axis, degrees; 0 if the signal is not the principal one of
    /// several axes, or if the slow motion is too little for a filter.
    pub turn_deg: f64,
}

/// The statistics of a trial that a fit keeps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// Biased autocorrelation of the reduced signal from lag 0 on, (m/s²)².
    pub lags: Vec<f64>,
    /// Third-octave bands of the reduced signal, computed so that no model order limits them.
    pub bands: Bands,
    /// Number of samples behind the statistics.
    pub samples: usize,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// What was found out about the file's samples when it was read.
    pub account: Account,
    /// Variance of the reduced signal with its lines and the rig's noise, (m/s²)².
    pub power: f64,
    /// Largest magnitude of an axis's mean, m/s². The means were removed.
    pub mean_m_s2: f64,
    /// Fraction of the axes' energy that the reduced signal keeps.
    pub energy_share: f64,
    /// Slow motion of hand or rig.
    pub slow: SlowMotion,
    /// Duration that triage cut out of the trial, s.
    pub cut_s: f64,
    /// Findings of triage on the trial by itself.
    pub verdicts: Vec<Verdict>,
    /// Lines at mains frequencies. Whether they are hum depends on the other trials.
    pub mains_lines: Vec<MainsLine>,
    /// Sketch of the reduced signal, by which copies are found.
    pub sketch: Sketch,
    /// Fraction of the rig's noise in each band of the recording; `None` if the noise is not known.
    pub floor: Option<Box<FloorShares>>,
    /// The texture's lines in the trial. `lags` and `bands` are without them. Empty before lines are sought.
    pub lines: TrialLines,
}

impl Analysis {
    /// Returns whether triage found the trial silent.
    pub fn is_silent(&self) -> bool {
        self.verdicts.iter().any(|verdict| verdict.kind() == Kind::Silent)
    }

    /// Returns the surface's band that the recording holds, for models at `rate_hz`.
    pub(super) fn known_band(&self, rate_hz: u32) -> KnownBand {
        KnownBand::of(self.source_rate_hz, rate_hz, self.slow.cut_hz)
    }

    /// Returns whether the trial has a verdict that `options` drop.
    pub(super) fn is_dropped(&self, options: &Options) -> bool {
        let is_dropped = |verdict: &Verdict| options.drop.iter().any(|dropped| dropped == verdict.name());
        self.verdicts.iter().any(is_dropped)
    }
}

/// A trial after triage's cuts and the filter.
struct Triaged {
    samples: Samples,
    /// Largest magnitude of an axis's mean before the filter, m/s².
    mean_m_s2: f64,
    slow: SlowMotion,
    verdicts: Vec<Verdict>,
    /// Duration that was cut, s.
    cut_s: f64,
    /// Flawed stretches of the remaining samples, which are not the surface's vibration.
    flaws: Vec<Range<usize>>,
    /// Stretches of the whole trial that were kept.
    parts: Vec<Range<usize>>,
}

/// Reads `trial`, keeps what triage does not cut, and filters it.
fn triaged(trial: &Trial, conditioning: Conditioning) -> Result<Triaged> {
    let samples = recording::read(trial)?;
    let slow_share = samples.slow_share();
    let verdicts = triage::samples(&samples, slow_share);
    Ok(without_cuts(samples, slow_share, verdicts, conditioning))
}

/// Keeps what `verdicts` do not cut, and filters it. `slow_share` is the fraction of slow motion in the whole trial.
fn without_cuts(mut samples: Samples, slow_share: f64, verdicts: Vec<Verdict>, conditioning: Conditioning) -> Triaged {
    let length = |samples: &Samples| samples.axes.first().map_or(0, Vec::len);
    let before = length(&samples);
    let parts = triage::usable(&verdicts, before);
    let flaws = triage::kept_spans(&triage::flaws(&samples, &verdicts), &parts);
    // The filter needs the parts before they are joined.
    let whole = samples.axes.clone();
    samples.axes = triage::kept(samples.axes, &parts);
    let mean_of = |axis: &Vec<f64>| mean(axis).abs();
    let mean_m_s2 = samples.axes.iter().map(mean_of).fold(0.0, f64::max);
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    // What was cut must not decide on the filter of the rest.
    let share = if length(&samples) < before {
        samples.slow_share()
    } else {
        slow_share
    };
    let mut slow = SlowMotion {
        share,
        cut_hz: conditioning.high_pass.cut_hz(share),
        turn_deg: 0.0,
    };
    // The effect that the filter has, or would have, on the axis is reported even if none was asked for.
    let advised = HighPass::Auto.cut_hz(share).or(slow.cut_hz);
    if let Some(cut_hz) = advised {
        let filtered = triage::kept(filtered(whole, &parts, rate_hz, cut_hz), &parts);
        if conditioning.reduction == Reduction::Pca && filtered.len() > 1 {
            // The filter has removed the means, which would otherwise turn the axis, too.
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

/// Returns `axes` at `rate_hz`, each of their `parts` filtered separately, so that nothing that is cut out rings into
/// them.
fn filtered(mut axes: Vec<Vec<f64>>, parts: &[Range<usize>], rate_hz: f64, cut_hz: f64) -> Vec<Vec<f64>> {
    for axis in &mut axes {
        for part in parts {
            high_pass(&mut axis[part.clone()], rate_hz, cut_hz);
        }
    }
    axes
}

/// Returns the axes of `trial` at `rate_hz`, a multiple of 5 kHz, without the stretches that triage removed (it judges
/// at 5 kHz), and high-passed at `cut_hz` if that is given.
fn kept_at(trial: &Trial, rate_hz: u32, parts: &[Range<usize>], cut_hz: Option<f64>) -> Result<Vec<Vec<f64>>> {
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
    // The conversions to the two rates may round the length differently.
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

/// A trial reduced to one axis, after triage's cuts.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Samples at the models' rate, m/s², with a mean of zero.
    pub samples: Vec<f64>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Cut-off frequency of the high-pass filter of the axes, Hz; `None` if they were not filtered.
    pub cut_hz: Option<f64>,
    /// Stretches of the samples that are not the surface's vibration: clipped peaks, joints, what triage would have
    /// cut, and the ends of what was resampled.
    pub flaws: Vec<Range<usize>>,
    /// Direction on which the axes were projected; empty if they were not.
    pub direction: Vec<f64>,
    /// Stretches within which nothing was cut out, from the first sample to the last at the rate of triage.
    pub stretches: Vec<Range<usize>>,
}

/// Reads `trial` like a fit does. Evaluations read with this function too, so that they use the same samples.
pub fn signal(trial: &Trial, conditioning: Conditioning) -> Result<Signal> {
    triaged(trial, conditioning)?.into_signal(trial, conditioning.reduction)
}

/// Like [`signal`], but nothing is cut: every sample keeps its time.
pub fn whole_signal(trial: &Trial, conditioning: Conditioning) -> Result<Signal> {
    signal_of_judged(trial, &[], conditioning)
}

/// Like [`signal`], but without running triage; `verdicts` are what it found on this trial before.
pub(super) fn signal_of_judged(trial: &Trial, verdicts: &[Verdict], conditioning: Conditioning) -> Result<Signal> {
    let samples = recording::read(trial)?;
    let slow_share = samples.slow_share();
    without_cuts(samples, slow_share, verdicts.to_vec(), conditioning).into_signal(trial, conditioning.reduction)
}

/// Reduces the axes of `trial` to one.
fn reduced(trial: &Trial, axes: &mut [Vec<f64>], reduction: Reduction) -> Result<Reduced> {
    reduce(axes, reduction).map_err(|missing| Error::file(&trial.file, missing.to_string()))
}

impl Triaged {
    fn into_signal(mut self, trial: &Trial, reduction: Reduction) -> Result<Signal> {
        let reduced = reduced(trial, &mut self.samples.axes, reduction)?;
        Ok(self.with_samples(reduced.signal, reduced.direction))
    }

    /// Returns the trial's signal with these `samples`, projected on this `direction`.
    fn with_samples(self, samples: Vec<f64>, direction: Vec<f64>) -> Signal {
        Signal {
            samples,
            source_rate_hz: self.samples.source_rate_hz,
            cut_hz: self.slow.cut_hz,
            flaws: self.flaws,
            direction,
            stretches: triage::stretches(&self.parts),
        }
    }
}

/// Returns the spectrum of the `samples` of `trial`, for lags up to `max_lag`.
fn spectrum(trial: &Trial, samples: &[f64], max_lag: usize) -> Result<PaddedSpectrum> {
    let spectrum = PaddedSpectrum::of(samples, max_lag);
    if spectrum.mean_square().is_finite() {
        return Ok(spectrum);
    }
    let problem = "its samples are too large to be squared; check scale_m_s2";
    Err(Error::file(&trial.file, problem))
}

/// Reads and analyses the `part` of `trial` that is fitted, for models of the highest order of `options` at their rate.
/// Triage examines the whole trial, at 5 kHz. Returns the analysis and the whole signal.
pub fn analyse(trial: &Trial, options: &Options, part: Part) -> Result<(Analysis, Signal)> {
    let (analysis, signal, _) = analyse_axes(trial, options, part)?;
    Ok((analysis, signal))
}

/// Reads the axes of `trial` like [`analyse`], with their means removed, m/s².
pub(super) fn read_axes(trial: &Trial, options: &Options) -> Result<Vec<Vec<f64>>> {
    let (_, _, axes) = analyse_axes(trial, options, Part::Whole)?;
    Ok(axes)
}

/// Like [`analyse`], but also returns the axes, with their means removed, m/s².
pub(super) fn analyse_axes(trial: &Trial, options: &Options, part: Part) -> Result<(Analysis, Signal, Vec<Vec<f64>>)> {
    let (reduction, max_lag) = (options.conditioning.reduction, options.order.highest());
    let mut triaged = triaged(trial, options.conditioning)?;
    let Reduced {
        signal: mut samples,
        energy_share,
        direction,
    } = reduced(trial, &mut triaged.samples.axes, reduction)?;
    let mut axes = std::mem::take(&mut triaged.samples.axes);
    let sketch = Sketch::of(&samples);
    // Silence and hum are judged at 5 kHz, whatever the models' rate.
    let mut plain = spectrum(trial, &samples, max_lag)?;
    let power = plain.mean_square();
    // With a floor of 0, digital silence is still silent.
    let is_silent = power.sqrt() < options.silence_floor_m_s2 || power <= 0.0;
    if is_silent {
        triaged.verdicts.insert(0, Verdict::silent());
    }
    let (rate_hz, cut_hz) = (options.sample_rate_hz, triaged.slow.cut_hz);
    let held = KnownBand::of(triaged.samples.source_rate_hz, SAMPLE_RATE_HZ, cut_hz).range_hz();
    let mains_lines = if is_silent {
        Vec::new()
    } else {
        triage::mains_lines(&plain, &axes, &held)
    };
    if rate_hz != SAMPLE_RATE_HZ {
        axes = kept_at(trial, rate_hz, &triaged.parts, cut_hz)?;
        samples = reduced(trial, &mut axes, reduction)?.signal;
        plain = spectrum(trial, &samples, max_lag)?;
    }
    let fitted: Vec<&[f64]> = part
        .of(samples.len())
        .into_iter()
        .map(|range| &samples[range])
        .collect();
    let whole_power = plain.mean_square();
    let known = KnownBand::of(triaged.samples.source_rate_hz, rate_hz, cut_hz);
    let Estimate { lags, bands } = match part {
        Part::Whole => estimate(rate_hz, &samples, plain, known),
        Part::Blocks => estimate_of(rate_hz, &fitted, max_lag, known),
    };
    // A high-pass filter removes power that `lags` have filled in again, and blocks have their own power.
    let is_whole = part == Part::Whole && cut_hz.is_none();
    let analysis = Analysis {
        source_rate_hz: triaged.samples.source_rate_hz,
        account: std::mem::take(&mut triaged.samples.account),
        samples: fitted.iter().map(|part| part.len()).sum(),
        power: if is_whole { whole_power } else { lags[0] },
        mean_m_s2: triaged.mean_m_s2,
        energy_share,
        slow: triaged.slow,
        cut_s: triaged.cut_s,
        verdicts: std::mem::take(&mut triaged.verdicts),
        mains_lines,
        sketch,
        floor: None,
        lines: TrialLines::default(),
        lags,
        bands,
    };
    Ok((analysis, triaged.with_samples(samples, direction), axes))
}
