//! From a recording set to the textures of a library: each trial is read, reduced to one axis, triaged and correlated;
//! each node of a texture's grid gets a linear predictor from its trials; holes of the grid are filled.
//!
//! Invariant: recordings in, models and their textures out. Nothing here draws, prints or writes a file.

mod bands;
pub mod densify;
mod estimate;
pub mod excitation;
mod fitted;
mod grid;
#[cfg(feature = "hatt")]
pub mod hatt;
mod holes;
pub mod lines;
mod notes;
mod options;
pub mod part;
pub mod record;
mod separated;
mod trial;
mod trial_report;

use model_format::Provenance;
use rayon::prelude::*;

use crate::recording::triage;
use crate::recording::triage::Verdict;
use crate::recording::{RecordingSet, Trial};
use crate::support::error::{Error, Result};
use crate::texture::certificate;
use crate::texture::library::texture_spec;

pub use fitted::{Fit, FittedTexture};
use lines::Lines;
pub use options::{Estimator, ExcitationChoice, ModulationChoice, Options, Order};
pub use separated::{separate_lines, signals_without_lines};
pub use trial::{Analysis, Signal, analyse, analyse_with_signal, signal};
pub use trial_report::TrialReport;

/// Fits `set` with the excitation that its recordings have, telling `progress` of each trial done.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// The first trial that cannot be used; with [`Options::strict`] the first with a verdict; a texture that the chosen
/// structure or the library cannot hold.
pub fn fit(set: &RecordingSet, options: &Options, progress: impl Fn() + Sync) -> Result<Fit> {
    let analyses = analyse_set(set, options, &progress)?;
    let mut fit = fit_analysed(set, &analyses, options)?;
    add_excitation(set, &mut fit, options)?;
    Ok(fit)
}

/// Adds what excites the models of `fit` to it: the residual is that of each trial without its texture's lines.
fn add_excitation(set: &RecordingSet, fit: &mut Fit, options: &Options) -> Result<()> {
    let has_lines = |name: &str| {
        let mut textures = fit.textures.iter();
        textures.any(|texture| texture.name == name && texture.grid.parts.lines.is_some())
    };
    let trials = set.trials.iter().zip(&fit.trials);
    let lined: Vec<bool> = trials
        .map(|(trial, report)| report.used && has_lines(&trial.texture))
        .collect();
    if !lined.contains(&true) {
        return excitation::add(set, fit, options, || ());
    }
    let without_lines = signals_without_lines(set, &lined, options, || ())?;
    let read = |index: usize, trial: &Trial| {
        let whole = signal(trial, options.reduction)?;
        Ok(if lined[index] {
            Signal {
                samples: without_lines[index].clone(),
                ..whole
            }
        } else {
            whole
        })
    };
    excitation::add_from(set, fit, options, read, || ())
}

/// Reads and analyses every trial of `set` for models of the highest order of `options`, telling `progress` of each
/// trial done.
///
/// # Errors
/// The first trial that cannot be used.
pub fn analyse_set(
    set: &RecordingSet,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Vec<Analysis>> {
    let max_order = options.order.highest();
    if options.lines == Lines::None {
        let analyses = set.trials.par_iter().map(|trial| {
            let analysis = analyse(trial, options, max_order);
            progress();
            analysis
        });
        return analyses.collect();
    }
    // The lines of a texture show in its trials together, so that the samples of one texture are held at a time.
    let mut analyses: Vec<Option<Analysis>> = vec![None; set.trials.len()];
    for name in set.textures() {
        let (indices, trials) = separated::of_texture(set, name);
        let mut analysed = trials
            .par_iter()
            .map(|trial| {
                let analysed = analyse_with_signal(trial, options, max_order);
                progress();
                analysed
            })
            .collect::<Result<Vec<_>>>()?;
        separated::separate_lines(&trials, &mut analysed, options, max_order);
        for (index, (analysis, _)) in indices.into_iter().zip(analysed) {
            analyses[index] = Some(analysis);
        }
    }
    // Every trial has a texture.
    Ok(analyses.into_iter().flatten().collect())
}

/// Fits `set` to the analyses of its trials, in the order of the set, with Gaussian excitation of steady level. They
/// were made with `options`, or with an order at least as high.
///
/// # Errors
/// With [`Options::strict`] the first trial with a verdict; a texture that the chosen structure or the library cannot
/// hold.
pub fn fit_analysed(set: &RecordingSet, analyses: &[Analysis], options: &Options) -> Result<Fit> {
    let verdicts = all_verdicts(set, analyses);
    let dropped = |verdicts: &[Verdict]| {
        let is_dropped = |verdict: &Verdict| options.drop.iter().any(|d| d == verdict.name());
        verdicts.iter().any(is_dropped)
    };
    let trials: Vec<TrialReport> = set
        .trials
        .iter()
        .zip(analyses)
        .zip(verdicts)
        .map(|((trial, analysis), verdicts)| TrialReport {
            file: trial.file.display().to_string(),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            rms_m_s2: analysis.power.sqrt(),
            mean_m_s2: analysis.mean_m_s2,
            energy_share: analysis.energy_share,
            cut_s: analysis.cut_s,
            used: !dropped(&verdicts) && trial.is_in_motion_and_contact(),
            verdicts,
        })
        .collect();
    if options.strict {
        refuse_doubtful(set, &trials)?;
    }
    let mut fit = Fit {
        trials,
        specs: Vec::new(),
        textures: Vec::new(),
        excitations: Vec::new(),
        warnings: Vec::new(),
    };
    for name in set.textures() {
        fit_texture(name, set, analyses, options, &mut fit)?;
    }
    Ok(fit)
}

/// The findings of every trial, those included that only a comparison of trials tells.
fn all_verdicts(set: &RecordingSet, analyses: &[Analysis]) -> Vec<Vec<Verdict>> {
    let trials = set.trials.iter().zip(analyses);
    let compared: Vec<_> = trials
        .map(|(trial, analysis)| triage::Compared {
            texture: &trial.texture,
            speed_mm_s: trial.speed_mm_s,
            is_idle: trial.speed_mm_s <= 0.0 || trial.force_n <= 0.0,
            rms_m_s2: analysis.power.sqrt(),
            mains_line_hz: analysis.mains_line_hz,
            fingerprint: &analysis.fingerprint,
            verdicts: &analysis.verdicts,
        })
        .collect();
    triage::all_verdicts(&compared)
}

fn refuse_doubtful(set: &RecordingSet, trials: &[TrialReport]) -> Result<()> {
    for (trial, report) in set.trials.iter().zip(trials) {
        if let Some(verdict) = report.verdicts.first() {
            let problem = format!("{verdict}; refused because of --strict");
            return Err(Error::file(&trial.file, problem));
        }
    }
    Ok(())
}

/// Number of trials of texture `name` at speed 0 or force 0, where the stylus is silent whatever was recorded.
fn idle_trials(name: &str, set: &RecordingSet) -> usize {
    let idle = |trial: &&Trial| trial.texture == name && !trial.is_in_motion_and_contact();
    set.trials.iter().filter(idle).count()
}

/// The error of a texture of which no trial can be used.
fn nothing_to_fit(name: &str, set: &RecordingSet) -> Error {
    let all = set.trials.iter().filter(|trial| trial.texture == name);
    Error::Model(if idle_trials(name, set) == all.count() {
        format!(
            "texture '{name}': every trial is at speed 0 or force 0, where the stylus is silent: record it in motion \
             and contact, or give light contact its force, such as 0.05 N"
        )
    } else {
        format!("texture '{name}': every trial was dropped; nothing is left to fit")
    })
}

fn fit_texture(
    name: &str,
    set: &RecordingSet,
    analyses: &[Analysis],
    options: &Options,
    fit: &mut Fit,
) -> Result<()> {
    let members: Vec<(&Trial, &Analysis, &TrialReport)> = set
        .trials
        .iter()
        .zip(analyses)
        .zip(&fit.trials)
        .filter(|((trial, _), report)| trial.texture == name && report.used)
        .map(|((trial, analysis), report)| (trial, analysis, report))
        .collect();
    if members.is_empty() {
        return Err(nothing_to_fit(name, set));
    }
    let simulated = members
        .iter()
        .any(|(trial, ..)| trial.provenance == Provenance::Simulated);
    let provenance = if simulated {
        Provenance::Simulated
    } else {
        Provenance::Recorded
    };
    let (grid, misses) = grid::assemble(name, &members, options)?;
    let reports: Vec<&TrialReport> = members.iter().map(|member| member.2).collect();
    let idle = idle_trials(name, set);
    let notes = notes::of(name, &grid, &misses, &reports, idle, options);
    fit.warnings.extend(notes);
    let spec = texture_spec(name, provenance, &grid, options.structure)?;
    fit.specs.push(certificate::certified(spec)?);
    fit.textures.push(FittedTexture {
        name: name.to_owned(),
        provenance,
        grid,
        lines: std::sync::Arc::clone(&members[0].1.lines.findings),
    });
    Ok(())
}
