//! From a recording set to the textures of a library: each trial is read, reduced to one axis, triaged and correlated;
//! each node of a texture's grid gets a linear predictor from its trials; holes of the grid are filled.

mod grid;
mod notes;
mod quantise;
mod trial;

use model_format::{Provenance, TextureSpec};
use rayon::prelude::*;
use serde::Serialize;

use crate::certificate;
use crate::error::{Error, Result};
use crate::recording::{MODEL_RATE_HZ, RecordingSet, Trial};
use crate::reduction::Reduction;
use crate::triage::{self, SILENCE_FLOOR_M_S2, Verdict};

pub use grid::{Grid, Model};
pub use quantise::{StructureChoice, nodes as quantised_nodes};
pub use trial::{Analysis, analyse, signal};

/// How a model's order is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// For each node by the Bayesian information criterion, at most 400.
    Auto,
    /// For each node by Akaike's criterion, which spends more on accuracy, at most this one: what a budget of cycles leaves.
    AtMost(usize),
    /// The same for all nodes, as in the paper (whose order is 400).
    Fixed(usize),
}

impl Order {
    /// The highest order that it allows.
    pub fn highest(self) -> usize {
        match self {
            Self::Auto => model_format::limits::MAX_ORDER,
            Self::AtMost(order) | Self::Fixed(order) => order,
        }
    }
}

impl std::str::FromStr for Order {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        const MAX_ORDER: usize = model_format::limits::MAX_ORDER;
        match text.parse::<usize>() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(order) if order <= MAX_ORDER => Ok(Self::Fixed(order)),
            _ => Err(format!("must be 'auto' or 0 to {MAX_ORDER}")),
        }
    }
}

/// How a recording's autocorrelation is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Estimator {
    /// Biased, of the recording as it was cut out, as in the paper: the finest lines, and leakage from strong ones.
    #[default]
    Rectangular,
    /// From seven sine tapers: lines are 4 Hz wide, and next to nothing leaks into weak parts of the spectrum.
    Multitaper,
}

/// How to fit.
#[derive(Clone, Debug)]
pub struct Options {
    /// Orders of the models.
    pub order: Order,
    /// Estimate of the autocorrelation.
    pub estimator: Estimator,
    /// Structure of the models in the library.
    pub structure: StructureChoice,
    /// From three axes to one.
    pub reduction: Reduction,
    /// RMS below which a trial is silent, m/s².
    pub silence_floor_m_s2: f64,
    /// Names of verdicts whose trials are left out, to be filled from their neighbours.
    pub drop: Vec<String>,
    /// Refuse a set in which any trial has a verdict.
    pub strict: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            order: Order::Auto,
            estimator: Estimator::Rectangular,
            structure: StructureChoice::Lattice,
            reduction: Reduction::Pca,
            silence_floor_m_s2: SILENCE_FLOOR_M_S2,
            drop: Vec::new(),
            strict: false,
        }
    }
}

/// What became of a trial.
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
    /// What triage found; nothing is ok.
    pub verdicts: Vec<Verdict>,
    /// Whether the fit used it.
    pub used: bool,
}

/// A fitted texture.
#[derive(Clone, Debug)]
pub struct FittedTexture {
    /// Name.
    pub name: String,
    /// Where its recordings came from.
    pub provenance: Provenance,
    /// Its models.
    pub grid: Grid,
}

/// What a fit gives.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// The textures, ready to be encoded.
    pub specs: Vec<TextureSpec>,
    /// The textures before quantisation, in the same order.
    pub textures: Vec<FittedTexture>,
    /// What the user should know, a line each.
    pub warnings: Vec<String>,
}

/// Fits `set`, telling `progress` of each trial done.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// The first trial that cannot be used; with [`Options::strict`] the first with a verdict; a texture that the chosen
/// structure or the library cannot hold.
pub fn fit(set: &RecordingSet, options: &Options, progress: impl Fn() + Sync) -> Result<Fit> {
    let max_order = options.order.highest();
    let analyses = set
        .trials
        .par_iter()
        .map(|trial| {
            let analysis = analyse(trial, options, max_order);
            progress();
            analysis
        })
        .collect::<Result<Vec<Analysis>>>()?;
    let verdicts = all_verdicts(set, &analyses);
    let dropped = |verdicts: &[Verdict]| {
        let is_dropped = |verdict: &Verdict| options.drop.iter().any(|d| d == verdict.name());
        verdicts.iter().any(is_dropped)
    };
    let trials: Vec<TrialReport> = set
        .trials
        .iter()
        .zip(&analyses)
        .zip(verdicts)
        .map(|((trial, analysis), verdicts)| TrialReport {
            file: trial.file.display().to_string(),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            rms_m_s2: analysis.power.sqrt(),
            mean_m_s2: analysis.mean_m_s2,
            energy_share: analysis.energy_share,
            used: !dropped(&verdicts),
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
        warnings: Vec::new(),
    };
    for name in set.textures() {
        fit_texture(name, set, &analyses, options, &mut fit)?;
    }
    Ok(fit)
}

/// The findings of every trial, those included that only a comparison of trials tells.
fn all_verdicts(set: &RecordingSet, analyses: &[Analysis]) -> Vec<Vec<Verdict>> {
    let mut verdicts: Vec<Vec<Verdict>> = analyses.iter().map(|a| a.verdicts.clone()).collect();
    for name in set.textures() {
        let members: Vec<usize> = (0..set.trials.len())
            .filter(|&index| set.trials[index].texture == name)
            .collect();
        let lines: Vec<_> = members
            .iter()
            .map(|&index| (set.trials[index].speed_mm_s, analyses[index].mains_line_hz))
            .collect();
        for (&index, line) in members.iter().zip(triage::confirmed_hum(&lines)) {
            verdicts[index].extend(line.map(|frequency_hz| Verdict::Hum { frequency_hz }));
        }
    }
    let mut first_with = std::collections::HashMap::new();
    for (index, analysis) in analyses.iter().enumerate() {
        // All silence is alike.
        if analysis.is_silent() {
            continue;
        }
        let of = *first_with.entry(analysis.fingerprint).or_insert(index);
        if of != index {
            verdicts[index].push(Verdict::Duplicate { of });
        }
    }
    verdicts
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
        let problem = format!("texture '{name}': every trial was dropped; nothing is left to fit");
        return Err(Error::Model(problem));
    }
    let simulated = members
        .iter()
        .any(|(trial, ..)| trial.provenance == Provenance::Simulated);
    let provenance = if simulated {
        Provenance::Simulated
    } else {
        Provenance::Recorded
    };
    let (grid, warnings) = grid::assemble(name, &members, options)?;
    fit.warnings.extend(warnings);
    let reports: Vec<&TrialReport> = members.iter().map(|member| member.2).collect();
    let notes = notes::of(name, &grid, &reports, options);
    fit.warnings.extend(notes);
    fit.specs.push(certificate::certified(TextureSpec {
        name: name.to_owned(),
        sample_rate_hz: MODEL_RATE_HZ,
        structure: options.structure.structure(),
        provenance,
        speed_axis_mm_s: grid.speeds_mm_s.clone(),
        force_axis_n: grid.forces_n.clone(),
        nodes: quantise::nodes(name, &grid, options.structure)?,
        cell_margins: Vec::new(),
    })?);
    fit.textures.push(FittedTexture {
        name: name.to_owned(),
        provenance,
        grid,
    });
    Ok(())
}
