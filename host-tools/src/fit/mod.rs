//! From a recording set to the textures of a library: each trial is read, reduced to one axis, triaged and correlated;
//! each node of a texture's grid gets a linear predictor from its trials; holes of the grid are filled.
//!
//! Invariant: recordings in, models and their textures out. Nothing here draws, prints or writes a file.

use std::borrow::Cow;

use model_format::{Provenance, SAMPLE_RATE_HZ};

use crate::recording::triage::{Compared, Verdict};
use crate::recording::{RecordingSet, Trial, triage};
use crate::support::error::{Error, Result};
use crate::support::file_name::portable;
use crate::support::in_order::in_order;
use crate::support::warning::Warning;
use crate::texture::library::stored_texture;

pub mod conditioning;
pub mod densify;
mod estimate;
pub mod excitation;
mod fitted;
mod grid;
pub mod hatt;
pub mod inputs;
pub mod lines;
mod notes;
mod options;
pub mod part;
pub mod parts;
pub mod record;
mod separated;
mod trial;

pub use fitted::{Fit, FittedTexture, encoded};
pub use options::{ExcitationChoice, ModulationChoice, Options, Order};
pub use separated::signals_without_lines;
pub use trial::TrialReport;
pub use trial::{Analysis, Signal, analyse, analyse_with_signal, signal, signal_of_judged};

use lines::Lines;
use trial::{Budget, KeptSignals};

/// Memory for signals that are kept for a later step instead of being read again, bytes.
const KEPT_SIGNALS: usize = 128 << 20;

/// Fits `set` with the excitation that its recordings have, telling `progress` of each trial done.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// The first trial that cannot be used; with [`Options::strict`] the first with a verdict; a texture that the chosen
/// library cannot hold; options that [`Options::check_rate`] refuses.
pub fn fit(set: &RecordingSet, options: &Options, progress: impl Fn() + Sync) -> Result<Fit> {
    fit_between(set, options, progress, || ())
}

/// As [`fit`], calling `between` between the later steps, which have no count: for programs that may end the work.
///
/// # Errors
/// As [`fit`].
pub fn fit_between(
    set: &RecordingSet,
    options: &Options,
    progress: impl Fn() + Sync,
    between: impl Fn() + Sync,
) -> Result<Fit> {
    options.check_rate()?;
    let options = &options.at_their_rate();
    let (analyses, kept) = analyse_keeping(set, options, KEPT_SIGNALS, &progress)?;
    between();
    let mut fit = fit_analysed(set, &analyses, options)?;
    // Room is needed for residuals.
    drop(analyses);
    add_excitation(set, &mut fit, options, kept, between)?;
    Ok(fit)
}

/// Adds what excites the models of `fit` to it: the residual is that of each trial without its texture's lines. Signals
/// that are not `kept` are read again.
fn add_excitation(
    set: &RecordingSet,
    fit: &mut Fit,
    options: &Options,
    mut kept: KeptSignals,
    progress: impl Fn() + Sync,
) -> Result<()> {
    if !excitation::is_wanted(options) {
        return Ok(());
    }
    let room = excitation::bytes_per_texture(fit)?;
    for (index, (_, members)) in set.by_texture().into_iter().enumerate() {
        let has_lines = fit.textures[index].grid.parts.lines.is_some();
        if has_lines && !kept.has_all(&members) {
            kept.extend(&members, without_lines(set, &members, options)?);
        }
        let verdicts: Vec<Vec<Verdict>> = members
            .iter()
            .map(|&member| fit.trials[member].verdicts.clone())
            .collect();
        let read = |member: usize| {
            if let Some(signal) = kept.get(member) {
                return Ok(signal.clone());
            }
            let place = members.binary_search(&member).unwrap_or_default();
            signal_of_judged(&set.trials[member], &verdicts[place], options.conditioning)
        };
        let texture = (&mut *fit, index);
        excitation::add_to(
            (set, &members),
            texture,
            options,
            (room, false),
            read,
            &progress,
        )?;
        kept.forget(&members);
    }
    Ok(())
}

/// As [`fit_analysed`], of `analysed` trials, with what excites the models: codebooks and tracks of fitted blocks.
///
/// # Errors
/// As [`fit_analysed`].
pub fn fit_blocks(
    set: &RecordingSet,
    analysed: Vec<part::PartlyAnalysed>,
    options: &Options,
) -> Result<Fit> {
    let (analyses, signals): (Vec<Analysis>, Vec<Signal>) = analysed
        .into_iter()
        .map(|trial| (trial.analysis, trial.signal))
        .unzip();
    let mut fit = fit_analysed(set, &analyses, options)?;
    if excitation::is_wanted(options) {
        let room = excitation::bytes_per_texture(&fit)?;
        for (index, (_, members)) in set.by_texture().into_iter().enumerate() {
            let read = |member: usize| Ok(signals[member].clone());
            let texture = (&mut fit, index);
            excitation::add_to((set, &members), texture, options, (room, true), read, || ())?;
        }
    }
    Ok(fit)
}

/// Signals of a texture's trials `members` without its lines, as its statistics were made of.
fn without_lines(set: &RecordingSet, members: &[usize], options: &Options) -> Result<Vec<Signal>> {
    let trials: Vec<&Trial> = members.iter().map(|&member| &set.trials[member]).collect();
    let analysed = analyse_texture(&trials, options, 1, &|| ())?;
    Ok(analysed.into_iter().map(|(_, signal)| signal).collect())
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
    Ok(analyse_keeping(set, options, 0, &progress)?.0)
}

/// As [`analyse_set`], and keeps signals for the excitation up to `most_kept` bytes.
fn analyse_keeping(
    set: &RecordingSet,
    options: &Options,
    most_kept: usize,
    progress: &(impl Fn() + Sync),
) -> Result<(Vec<Analysis>, KeptSignals)> {
    let max_order = options.order.highest();
    let kept = Budget::of(if excitation::is_wanted(options) {
        most_kept
    } else {
        0
    });
    let keep = |(analysis, signal): (Analysis, Signal)| {
        let is_kept = kept.takes(size_of_val(signal.samples.as_slice()));
        (analysis, is_kept.then_some(signal))
    };
    if options.lines == Lines::None {
        let analysed = in_order(&set.trials, |trial| {
            let analysed = analyse_with_signal(trial, options, max_order).map(&keep);
            progress();
            analysed
        })?;
        let (analyses, signals): (Vec<_>, Vec<_>) = analysed.into_iter().unzip();
        return Ok((analyses, KeptSignals::of(signals)));
    }
    // The lines of a texture show in its trials together, so that the samples of one texture are held at a time.
    let mut all: Vec<Option<(Analysis, Option<Signal>)>> = Vec::new();
    all.resize_with(set.trials.len(), || None);
    for (_, members) in set.by_texture() {
        let trials: Vec<&Trial> = members.iter().map(|&member| &set.trials[member]).collect();
        let analysed = analyse_texture(&trials, options, max_order, progress)?;
        for (member, analysed) in members.into_iter().zip(analysed) {
            all[member] = Some(keep(analysed));
        }
    }
    // Every trial has a texture.
    let (analyses, signals) = all.into_iter().flatten().unzip();
    Ok((analyses, KeptSignals::of(signals)))
}

/// Reads and analyses all `trials` of one texture, and takes its lines out of them.
fn analyse_texture(
    trials: &[&Trial],
    options: &Options,
    max_order: usize,
    progress: &(impl Fn() + Sync),
) -> Result<Vec<(Analysis, Signal)>> {
    let mut analysed = in_order(trials, |trial| {
        let analysed = analyse_with_signal(trial, options, max_order);
        progress();
        analysed
    })?;
    if options.lines != Lines::None {
        separated::separate_lines(trials, &mut analysed, options, max_order);
    }
    Ok(analysed)
}

/// Fits `set` to the analyses of its trials, in the order of the set, with Gaussian excitation of steady level. They
/// were made with `options`, or with an order at least as high.
///
/// # Errors
/// With [`Options::strict`] the first trial with a verdict; a texture that the library cannot
/// hold.
pub fn fit_analysed(set: &RecordingSet, analyses: &[Analysis], options: &Options) -> Result<Fit> {
    let trials = reports(set, analyses, options)?;
    let of_members = |members: &[usize]| {
        let own = members.iter().map(|&member| &analyses[member]);
        Ok(own.map(Cow::Borrowed).collect())
    };
    fit_reported(set, trials, options, of_members)
}

/// Fits the textures of `set` one after the other to the analyses that `analyses_of` gives for the indices of their
/// trials.
fn fit_reported<'a>(
    set: &RecordingSet,
    trials: Vec<TrialReport>,
    options: &Options,
    mut analyses_of: impl FnMut(&[usize]) -> Result<Vec<Cow<'a, Analysis>>>,
) -> Result<Fit> {
    let mut fit = Fit {
        trials,
        specs: Vec::new(),
        textures: Vec::new(),
        excitations: Vec::new(),
        warnings: Vec::new(),
    };
    if options.sample_rate_hz != SAMPLE_RATE_HZ {
        let text = format!(
            "at {} Hz nothing but noise of steady level is fitted: residual, level and lines are sought at \
             {SAMPLE_RATE_HZ} Hz alone",
            options.sample_rate_hz
        );
        fit.warnings.push(Warning::of_set("rate", text));
    }
    fit.warnings.extend(notes::of_set(set, &fit.trials));
    for (name, members) in set.by_texture() {
        let analyses = analyses_of(&members)?;
        fit_texture(name, (set, &members), &analyses, options, &mut fit)?;
    }
    Ok(fit)
}

/// The account of every trial, with the verdicts that only a comparison of trials tells.
fn reports(
    set: &RecordingSet,
    analyses: &[Analysis],
    options: &Options,
) -> Result<Vec<TrialReport>> {
    let dropped = |verdicts: &[Verdict]| {
        let is_dropped = |verdict: &Verdict| options.drop.iter().any(|d| d == verdict.name());
        verdicts.iter().any(is_dropped)
    };
    let verdicts = all_verdicts(set, analyses);
    let trials: Vec<TrialReport> = set
        .trials
        .iter()
        .zip(analyses)
        .zip(verdicts)
        .map(|((trial, found), verdicts)| TrialReport {
            file: portable(&trial.file),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            rms_m_s2: found.power.sqrt(),
            mean_m_s2: found.mean_m_s2,
            energy_share: found.energy_share,
            slow_share: found.slow.share,
            high_pass_hz: found.slow.cut_hz,
            axis_turn_deg: found.slow.turn_deg,
            cut_s: found.cut_s,
            used: !dropped(&verdicts) && trial.is_in_motion_and_contact(),
            verdicts,
        })
        .collect();
    if options.strict {
        refuse_doubtful(set, &trials)?;
    }
    Ok(trials)
}

/// The findings of every trial, those included that only a comparison of trials tells.
fn all_verdicts(set: &RecordingSet, analyses: &[Analysis]) -> Vec<Vec<Verdict>> {
    let bands_of = |found: &Analysis| found.bands.known_db(found.samples);
    let bands: Vec<_> = analyses.iter().map(bands_of).collect();
    let trials = set.trials.iter().zip(analyses).zip(&bands);
    let compared: Vec<_> = trials
        .map(|((trial, found), bands_db)| Compared {
            texture: &trial.texture,
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            bands_db,
            is_idle: trial.speed_mm_s <= 0.0 || trial.force_n <= 0.0,
            rms_m_s2: found.power.sqrt(),
            mains_line_hz: found.mains_line_hz,
            sketch: &found.sketch,
            verdicts: &found.verdicts,
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

/// The error of a texture of which no trial can be used; `idle` of all its trials are at speed 0 or force 0.
fn nothing_to_fit(name: &str, idle: usize, all: usize) -> Error {
    Error::Model(if idle == all {
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
    (set, indices): (&RecordingSet, &[usize]),
    analyses: &[Cow<'_, Analysis>],
    options: &Options,
    fit: &mut Fit,
) -> Result<()> {
    let members: Vec<(&Trial, &Analysis, &TrialReport)> = indices
        .iter()
        .zip(analyses)
        .map(|(&index, analysis)| (&set.trials[index], analysis.as_ref(), &fit.trials[index]))
        .filter(|(.., report)| report.used)
        .collect();
    // Where the stylus is silent whatever was recorded.
    let is_idle = |&&index: &&usize| !set.trials[index].is_in_motion_and_contact();
    let idle = indices.iter().filter(is_idle).count();
    if members.is_empty() {
        return Err(nothing_to_fit(name, idle, indices.len()));
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
    let short = members.iter().filter_map(|(trial, analysis, report)| {
        let seconds = analysis.samples as f64 / f64::from(options.sample_rate_hz) + report.cut_s;
        notes::Short::of(trial, seconds)
    });
    let short: Vec<notes::Short> = short.collect();
    let notes = notes::of(name, &grid, &misses, (&reports, &short), idle, options);
    fit.warnings.extend(notes);
    let spec = stored_texture(name, provenance, &grid, options.sample_rate_hz)?;
    fit.specs.push(spec);
    fit.textures.push(FittedTexture {
        name: name.to_owned(),
        provenance,
        grid,
        lines: std::sync::Arc::clone(&members[0].1.lines.findings),
    });
    Ok(())
}
