//! `stylus fit`

use std::path::PathBuf;

use host_tools::dsp::reduction::Reduction;
use host_tools::evaluation::budget;
use host_tools::evaluation::budget::{Budget, Concession};
use host_tools::evaluation::frontier::costs;
use host_tools::evaluation::leave_one_out::LeaveOneOut;
use host_tools::fit;
use host_tools::fit::densify::AddedLine;
use host_tools::fit::{Estimator, Fit, Order, TrialReport};
use host_tools::recording::RecordingSet;
use host_tools::recording::triage::SILENCE_FLOOR_M_S2;
use host_tools::support::error::{Error, Result};
use host_tools::support::{atomic_file, progress};
use host_tools::texture::quantise::StructureChoice;
use model_format::TextureSpec;

use super::input::{Recordings, not_negative, positive};
use super::inspect::Summary;
use super::table::table;
use crate::cli::library_file::decode_library;
use crate::cli::output::{print, print_json};

/// Verdicts that `--drop` takes.
const DROPPABLE: [&str; 7] = [
    "silent",
    "too-short",
    "clipped",
    "drifting",
    "hum",
    "duplicate",
    "wrong-rate",
];

/// How many trials with a verdict are shown one by one.
const SHOWN_VERDICTS: usize = 20;

/// The table's cores, as the command line names them.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Core {
    /// Cortex-M4
    M4,
    /// Cortex-M7, whose cycles are bounded by the Cortex-M4's worst ones
    M7,
}

impl From<Core> for costs::Core {
    fn from(core: Core) -> Self {
        match core {
            Core::M4 => Self::M4,
            Core::M7 => Self::M7,
        }
    }
}

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    recordings: Recordings,
    /// Library to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    /// Order of the models: 0 to 400, or 'auto' to choose it for each node (BIC)
    #[arg(long, default_value = "auto")]
    order: Order,
    /// Cycles that the synthesis of a sample may take at worst: orders are chosen within it, and what that gives up is told
    #[arg(long, value_name = "N", value_parser = positive, conflicts_with = "densify")]
    budget_cycles: Option<f64>,
    /// The core that --budget-cycles is of
    #[arg(long, value_enum, requires = "budget_cycles", default_value = "m4")]
    core: Core,
    /// Estimate of the autocorrelation
    #[arg(long, value_enum, default_value = "rectangular")]
    estimator: Estimator,
    /// Structure that the stylus plays
    #[arg(long, value_enum, default_value = "lattice")]
    structure: StructureChoice,
    /// From three axes to one
    #[arg(long, value_enum, default_value = "pca")]
    reduce: Reduction,
    /// RMS below which a trial counts as silent, in m/s²
    #[arg(long, value_name = "M_S2", value_parser = not_negative, default_value_t = SILENCE_FLOOR_M_S2)]
    silence_floor: f64,
    /// Leave out trials with these verdicts; their nodes are filled from neighbours
    #[arg(long, value_delimiter = ',', value_parser = clap::builder::PossibleValuesParser::new(DROPPABLE))]
    drop: Vec<String>,
    /// Refuse a set in which triage finds anything
    #[arg(long)]
    strict: bool,
    /// Fill the grid between recorded nodes as densely as the slot allows, and show what it gains
    #[arg(long)]
    densify: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct Report<'a> {
    library: String,
    bytes: usize,
    warnings: &'a [String],
    textures: Vec<Summary>,
    trials: &'a [TrialReport],
    #[serde(skip_serializing_if = "Option::is_none")]
    added_lines: Option<&'a [AddedLine]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    removed_nodes: Option<&'a LeaveOneOut>,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget: Option<&'a [Concession]>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let set = arguments.recordings.open()?;
    let budget = arguments.budget_cycles.map(|cycles| Budget {
        cycles,
        core: arguments.core.into(),
    });
    let highest_order = match &budget {
        Some(budget) => Some(budget.highest_order(arguments.structure)?),
        None => None,
    };
    let options = fit::Options {
        order: highest_order.map_or(arguments.order, |highest| {
            budget::capped(arguments.order, highest)
        }),
        estimator: arguments.estimator,
        structure: arguments.structure,
        reduction: arguments.reduce,
        silence_floor_m_s2: arguments.silence_floor,
        drop: arguments.drop.clone(),
        strict: arguments.strict,
    };
    let (fit, mut bytes) = fit_library(&set, &options)?;
    let concessions = match highest_order {
        Some(highest) => Some(concessions(&set, &fit, &options, arguments.order, highest)?),
        None => None,
    };
    let denser = if arguments.densify {
        Some(super::densify::densify(&set, &fit, &options)?)
    } else {
        None
    };
    if let Some(denser) = &denser {
        bytes = encoded(&denser.densified.specs)?;
    }
    atomic_file::write(&arguments.out, &bytes)?;
    let library = decode_library(&arguments.out, &bytes)?;
    let textures: Vec<Summary> = library
        .textures()
        .map(|t| Summary::of(&t, arguments.json))
        .collect();
    if arguments.json {
        return print_json(&Report {
            library: arguments.out.display().to_string(),
            bytes: bytes.len(),
            warnings: &fit.warnings,
            textures,
            trials: &fit.trials,
            added_lines: denser.as_ref().map(|d| d.densified.lines.as_slice()),
            removed_nodes: denser.as_ref().and_then(|d| d.test.as_ref()),
            budget: concessions.as_deref(),
        });
    }
    show_verdicts(&fit);
    print(&super::inspect::summary_table(&textures))?;
    if let Some(denser) = &denser {
        print(&format!("\n{}", super::densify::summary(denser)))?;
    }
    if let (Some(concessions), Some(budget)) = (&concessions, &budget) {
        print(&format!("\n{}", given_up(concessions, budget)))?;
    }
    print(&format!(
        "\n{} trials -> {} ({} bytes); the axes' energy kept: {}",
        fit.trials.len(),
        arguments.out.display(),
        bytes.len(),
        energy_kept(&fit.trials)
    ))
}

/// Fits `set` with a progress bar, and encodes the library.
pub fn fit_library(set: &RecordingSet, options: &fit::Options) -> Result<(Fit, Vec<u8>)> {
    let bar = progress::bar(set.trials.len() as u64, "fitting");
    let fit = fit::fit(set, options, || bar.inc(1))?;
    bar.finish_and_clear();
    let bytes = encoded(&fit.specs)?;
    Ok((fit, bytes))
}

/// What `fit`, bounded to orders up to `highest`, gives up of a fit with `order`. As a lattice: it is of the models alone.
fn concessions(
    set: &RecordingSet,
    fit: &Fit,
    options: &fit::Options,
    order: Order,
    highest: usize,
) -> Result<Vec<Concession>> {
    let unbounded = fit::Options {
        order: budget::capped(order, model_format::limits::MAX_ORDER),
        structure: StructureChoice::Lattice,
        ..options.clone()
    };
    let bar = progress::bar(set.trials.len() as u64, "fitting without bounds");
    let without = fit::fit(set, &unbounded, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(budget::concessions(&without, fit, highest))
}

fn given_up(concessions: &[Concession], budget: &Budget) -> String {
    let header = [
        "texture",
        "orders up to",
        "nodes lowered",
        "from",
        "prediction error dB",
        "largest dB",
        "at",
        "C expected %",
        "without %",
    ];
    let rows: Vec<Vec<String>> = concessions
        .iter()
        .map(|concession| {
            let mut row = vec![
                concession.texture.clone(),
                concession.highest_order.to_string(),
                format!("{} of {}", concession.capped, concession.nodes),
            ];
            let Some((speed_mm_s, force_n)) = concession.worst_node else {
                row.push("nothing is given up".to_owned());
                return row;
            };
            let (least, most) = concession.orders_without;
            row.extend([
                format!("{least} to {most}"),
                format!("{:+.2}", concession.mean_error_rise_db),
                format!("{:+.2}", concession.largest_error_rise_db),
                format!("{speed_mm_s} mm/s, {force_n} N"),
                format!("{:.1}", 100.0 * concession.expected_cost),
                format!("{:.1}", 100.0 * concession.expected_cost_without),
            ]);
            row
        })
        .collect();
    format!(
        "What a budget of {} cycles a sample on a {} gives up:\n\n{}\n\n\
         Means over the lowered nodes. C expected: of a synthesis of 2 s against one of the unbounded model; without: of two such of \
         the same model.\nCycles are modelled, at worst, and of the synthesis alone; a texture's highest order sets the time of all \
         its nodes.",
        budget.cycles,
        budget.core,
        table(&header, &rows),
    )
}

fn encoded(specs: &[TextureSpec]) -> Result<Vec<u8>> {
    model_format::encode(specs)
        .map_err(|failure| Error::Model(format!("the textures do not make a library: {failure}")))
}

/// Mean and deviation of the share of energy that the reduction kept, over trials that have any.
fn energy_kept(trials: &[TrialReport]) -> String {
    let shares: Vec<f64> = trials
        .iter()
        .filter(|trial| trial.rms_m_s2 > 0.0)
        .map(|trial| trial.energy_share * 100.0)
        .collect();
    let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    let square: f64 = shares.iter().map(|share| (share - mean).powi(2)).sum();
    let deviation = (square / shares.len().max(1) as f64).sqrt();
    format!("{mean:.0} % ± {deviation:.0} %")
}

/// Triage's findings and the fit's warnings, on standard error.
fn show_verdicts(fit: &Fit) {
    let doubtful: Vec<&TrialReport> = fit
        .trials
        .iter()
        .filter(|trial| !trial.verdicts.is_empty())
        .collect();
    let rows: Vec<Vec<String>> = doubtful
        .iter()
        .take(SHOWN_VERDICTS)
        .map(|trial| {
            let verdicts: Vec<String> = trial.verdicts.iter().map(ToString::to_string).collect();
            vec![
                trial.file.clone(),
                verdicts.join("; "),
                (if trial.used { "used" } else { "dropped" }).to_owned(),
            ]
        })
        .collect();
    if !rows.is_empty() {
        eprintln!("{}", table(&["trial", "triage", "and so"], &rows));
        if doubtful.len() > rows.len() {
            eprintln!(
                "... and {} more (all are in --json)",
                doubtful.len() - rows.len()
            );
        }
        eprintln!();
    }
    for warning in &fit.warnings {
        eprintln!("warning: {warning}");
    }
}
