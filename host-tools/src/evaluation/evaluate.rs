//! Comparison with recordings: each trial is played by the device's own kernel at its speed and force, and
//! compared with what was recorded.

use model_format::{Library, MillimetresPerSecond, Newton, Texture};
use rayon::prelude::*;
use serde::Serialize;

use crate::dsp::reduction::Reduction;
use crate::dsp::spectrum;
use crate::dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ};
use crate::fit;
use crate::playing::motion::MotionPath;
use crate::playing::render::{Rendered, render};
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};
use crate::texture::library::uncertified_library;
use crate::texture::quantise::StructureChoice;
use model_format::SAMPLE_RATE_HZ;

/// Beginning of a synthesis that no comparison uses, s, because filters start from rest.
pub(super) const WARM_UP_S: f64 = 0.5;

/// The range over which the log-spectral distance is taken, Hz.
pub const DISTANCE_RANGE_HZ: (f64, f64) = (30.0, 1000.0);

/// Options of an evaluation.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// From three axes to one; as for the fit.
    pub reduction: Reduction,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, Hz.
    pub smoothing_hz: f64,
    /// Duration of each synthesis, s; at least that of the recording. Longer ones give more exact levels of bands.
    pub synthesis_s: f64,
    /// Seed of the syntheses; each trial has its own noise.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            reduction: Reduction::Pca,
            smoothing_hz: spectrum::DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 10.0,
            seed: 1,
        }
    }
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
    /// RMS of the recording, m/s².
    pub recorded_rms_m_s2: f64,
    /// RMS of the synthesis, m/s².
    pub synthesised_rms_m_s2: f64,
    /// The paper's cost C, equation (6); none where the recording or the stylus is silent.
    pub cost: Option<f64>,
    /// C of a perfect model of broadband noise, which is not 0 because its synthesis is noise of its own.
    pub cost_floor: f64,
    /// Level of the synthesis over that of the recording in each third-octave band from 20 to 1000 Hz, dB.
    pub band_errors_db: [Option<f64>; BAND_COUNT],
    /// Log-spectral distance from 30 to 1000 Hz in sliding third octaves, dB.
    pub log_spectral_distance_db: Option<f64>,
    /// Samples of the synthesis at full scale.
    pub saturations: u32,
}

impl TrialEvaluation {
    /// Returns whether the stylus plays nothing here.
    pub fn is_silent(&self) -> bool {
        self.cost.is_none()
    }
}

/// A texture's trials in a few numbers; silent trials are counted and left out of all means.
#[derive(Clone, Debug, Serialize)]
pub struct TextureEvaluation {
    /// The texture.
    pub texture: String,
    /// Trials compared.
    pub trials: usize,
    /// Trials at which the stylus or the recording is silent.
    pub silent: usize,
    /// Mean of C.
    pub mean_cost: f64,
    /// Standard deviation of C.
    pub cost_deviation: f64,
    /// Mean of what C would be for a perfect model of broadband noise.
    pub mean_cost_floor: f64,
    /// Mean magnitude of the bands' errors, dB.
    pub mean_band_error_db: f64,
    /// Share of all bands within the amplitude JND of 2.2 dB.
    pub bands_within_jnd: f64,
    /// Mean log-spectral distance, dB.
    pub mean_log_spectral_distance_db: f64,
}

impl TextureEvaluation {
    /// The fields as a table's row, in their order.
    pub fn cells(&self) -> [String; 9] {
        [
            self.texture.clone(),
            self.trials.to_string(),
            self.silent.to_string(),
            format!("{:.3}", self.mean_cost),
            format!("{:.3}", self.cost_deviation),
            format!("{:.3}", self.mean_cost_floor),
            format!("{:.2}", self.mean_band_error_db),
            format!("{:.0} %", 100.0 * self.bands_within_jnd),
            format!("{:.2}", self.mean_log_spectral_distance_db),
        ]
    }
}

/// The outcome of an evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// The bands' nominal centre frequencies, Hz.
    pub bands_hz: [&'static str; BAND_COUNT],
    /// True if any recording behind it is simulated.
    pub simulated: bool,
    /// One line per texture.
    pub textures: Vec<TextureEvaluation>,
    /// Every trial, in the order of the set.
    pub trials: Vec<TrialEvaluation>,
}

/// A recording and its synthesis, at the models' rate, m/s².
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The reduced recording.
    pub recorded: Vec<f64>,
    /// The synthesis after warming up; at least as long.
    pub synthesised: Vec<f64>,
    /// Samples of the synthesis at full scale.
    pub saturations: u32,
}

/// The texture of `library` that a trial names.
///
/// # Errors
/// A texture that is not there, with those that are.
pub fn texture_named<'a>(library: &Library<'a>, name: &str) -> Result<Texture<'a>> {
    library.texture(name).ok_or_else(|| {
        let names: Vec<&str> = library.textures().map(|texture| texture.name()).collect();
        Error::Request(format!(
            "the library has no texture '{name}'; it has {}",
            names.join(", ")
        ))
    })
}

/// Plays `trial` from `texture` and reads its recording. `seed` is this trial's own.
///
/// # Errors
/// A recording that cannot be used.
pub fn compare(
    trial: &Trial,
    texture: Texture<'_>,
    options: &Options,
    seed: u64,
) -> Result<Comparison> {
    let (recorded, _) = fit::signal(trial, options.reduction)?;
    play_beside(recorded, trial, texture, options, seed)
}

/// Plays `trial` from `texture` for at least as long as its reduced signal `recorded`.
fn play_beside(
    recorded: Vec<f64>,
    trial: &Trial,
    texture: Texture<'_>,
    options: &Options,
    seed: u64,
) -> Result<Comparison> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    if texture.sample_rate_hz() != SAMPLE_RATE_HZ {
        return Err(Error::Request(format!(
            "texture '{}' plays at {} Hz, recordings are compared at {SAMPLE_RATE_HZ}",
            texture.name(),
            texture.sample_rate_hz()
        )));
    }
    let seconds = (recorded.len() as f64 / rate_hz).max(options.synthesis_s) + WARM_UP_S;
    let motion = MotionPath::constant(
        MillimetresPerSecond(trial.speed_mm_s as f32),
        Newton(trial.force_n as f32),
    )?;
    let rendered: Rendered = render(texture, &motion, seconds, seed)?;
    let warm_up = (WARM_UP_S * rate_hz) as usize;
    Ok(Comparison {
        recorded,
        synthesised: rendered.accelerations_m_s2().split_off(warm_up),
        saturations: rendered.saturations,
    })
}

/// Evaluates every trial of `set` against `library`, telling `progress` of each one done.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// A texture that the library does not have, or a recording that cannot be used.
pub fn evaluate(
    set: &RecordingSet,
    library: &Library<'_>,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Evaluation> {
    for name in set.textures() {
        texture_named(library, name)?;
    }
    let trials = (0..set.trials.len())
        .into_par_iter()
        .map(|index| {
            let trial = &set.trials[index];
            let texture = texture_named(library, &trial.texture)?;
            let seed = options.seed.wrapping_add(index as u64);
            let comparison = compare(trial, texture, options, seed)?;
            progress();
            Ok(judge(trial, &comparison, options))
        })
        .collect::<Result<Vec<_>>>()?;
    let textures = set
        .textures()
        .into_iter()
        .map(|name| summarise(name, &trials))
        .collect();
    let simulated = set
        .trials
        .iter()
        .any(|trial| trial.provenance == model_format::Provenance::Simulated);
    Ok(Evaluation {
        smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
        bands_hz: BAND_LABELS_HZ,
        simulated,
        textures,
        trials,
    })
}

fn judge(trial: &Trial, comparison: &Comparison, options: &Options) -> TrialEvaluation {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let Comparison {
        recorded,
        synthesised,
        saturations,
    } = comparison;
    let (low_hz, high_hz) = DISTANCE_RANGE_HZ;
    let silent = rms(recorded) <= 0.0 || rms(synthesised) <= 0.0;
    let heard = |value: Option<f64>| value.filter(|_| !silent);
    let cost = spectrum::spectral_cost(recorded, synthesised, rate_hz, options.smoothing_hz);
    let distance =
        spectrum::log_spectral_distance_db(recorded, synthesised, rate_hz, low_hz, high_hz);
    TrialEvaluation {
        file: trial.file.display().to_string(),
        texture: trial.texture.clone(),
        speed_mm_s: trial.speed_mm_s,
        force_n: trial.force_n,
        recorded_rms_m_s2: rms(recorded),
        synthesised_rms_m_s2: rms(synthesised),
        cost: heard(cost),
        cost_floor: spectrum::expected_cost_of_noise(recorded.len(), rate_hz, options.smoothing_hz),
        band_errors_db: spectrum::band_errors_db(recorded, synthesised, rate_hz),
        log_spectral_distance_db: heard(distance),
        saturations: *saturations,
    }
}

/// Root of the mean square.
pub fn rms(signal: &[f64]) -> f64 {
    (signal.iter().map(|x| x * x).sum::<f64>() / signal.len().max(1) as f64).sqrt()
}

fn summarise(name: &str, trials: &[TrialEvaluation]) -> TextureEvaluation {
    let members: Vec<&TrialEvaluation> = trials.iter().filter(|t| t.texture == name).collect();
    let heard: Vec<&TrialEvaluation> = members
        .iter()
        .copied()
        .filter(|trial| !trial.is_silent())
        .collect();
    let costs: Vec<f64> = heard.iter().filter_map(|trial| trial.cost).collect();
    let mean_cost = mean(&costs);
    let squares: Vec<f64> = costs.iter().map(|c| (c - mean_cost).powi(2)).collect();
    let errors: Vec<f64> = heard
        .iter()
        .flat_map(|trial| trial.band_errors_db)
        .flatten()
        .map(f64::abs)
        .collect();
    let within = errors.iter().filter(|e| **e <= AMPLITUDE_JND_DB).count();
    let floors: Vec<f64> = heard.iter().map(|trial| trial.cost_floor).collect();
    let distances: Vec<f64> = heard
        .iter()
        .filter_map(|trial| trial.log_spectral_distance_db)
        .collect();
    TextureEvaluation {
        texture: name.to_owned(),
        trials: heard.len(),
        silent: members.len() - heard.len(),
        mean_cost,
        cost_deviation: mean(&squares).sqrt(),
        mean_cost_floor: mean(&floors),
        mean_band_error_db: mean(&errors),
        bands_within_jnd: within as f64 / errors.len().max(1) as f64,
        mean_log_spectral_distance_db: mean(&distances),
    }
}

/// The mean, or zero of nothing.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// C of models of `trial` of each of `orders`, as in the paper's figure 8. Orders that the data do not bear are left out.
///
/// # Errors
/// A recording that cannot be used.
pub fn cost_by_order(
    trial: &Trial,
    orders: &[usize],
    options: &Options,
) -> Result<Vec<(usize, f64)>> {
    let Some(&highest) = orders.iter().max() else {
        return Ok(Vec::new());
    };
    let alone = RecordingSet {
        trials: vec![trial.clone()],
        is_listed: true,
    };
    let fit_options = fit::Options {
        order: fit::Order::Fixed(highest),
        reduction: options.reduction,
        ..fit::Options::default()
    };
    let (analysis, recorded) = fit::analyse_with_signal(trial, &fit_options, highest)?;
    let fit = fit::fit_analysed(&alone, &[analysis], &fit_options)?;
    let fitted = &fit.textures[0];
    let costs = orders.par_iter().map(|&order| {
        let mut grid = fitted.grid.clone();
        // Levinson-Durbin's model of a lower order is the first stages of that of a higher one.
        let reflection = &mut grid.models[0].reflection;
        reflection.truncate(order);
        if reflection.len() < order {
            return Ok(None);
        }
        let bytes = uncertified_library(&fitted.name, &grid, StructureChoice::Lattice)?;
        let library = Library::decode_uncertified(&bytes)
            .map_err(|failure| Error::Model(failure.to_string()))?;
        let texture = texture_named(&library, &trial.texture)?;
        let comparison = play_beside(recorded.clone(), trial, texture, options, options.seed)?;
        Ok(judge(trial, &comparison, options)
            .cost
            .map(|cost| (order, cost)))
    });
    let costs = costs.collect::<Result<Vec<_>>>()?;
    Ok(costs.into_iter().flatten().collect())
}
