//! `stylus fit`

mod densify;
mod library;
mod report;

use std::path::PathBuf;

use host_tools::dsp::reduction::Reduction;
use host_tools::evaluation::budget;
use host_tools::evaluation::budget::Budget;
use host_tools::evaluation::frontier::costs;
use host_tools::fit;
use host_tools::fit::{Estimator, ExcitationChoice, ModulationChoice, Order};
use host_tools::recording::triage::{SILENCE_FLOOR_M_S2, Verdict};
use host_tools::support::error::Result;
use host_tools::texture::quantise::StructureChoice;

use library::{concessions, encoded};
pub use library::{fit_library, write_library};
use report::{FitReport, energy_kept, excitations, given_up, show_verdicts};

use crate::cli::input::{Recordings, not_negative, positive};
use crate::cli::inspect::{TextureSummary, texture_table};
use crate::cli::library_file::decode_library;
use crate::cli::output::{print, print_json};

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
    /// Library file to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    /// Order of the models: 0 to 400, or chosen for each node: 'auto' (AIC) or 'bic', which is thriftier
    #[arg(long, default_value = "auto")]
    order: Order,
    /// Worst-case cycles per sample of the synthesis: bounds the orders, and reports the loss of accuracy
    #[arg(long, value_name = "N", value_parser = positive, conflicts_with = "densify")]
    budget_cycles: Option<f64>,
    /// Core to which --budget-cycles applies
    #[arg(long, value_enum, requires = "budget_cycles", default_value = "m4")]
    core: Core,
    /// Estimator of the autocorrelation
    #[arg(long, value_enum, default_value = "auto")]
    estimator: Estimator,
    /// Filter structure that the stylus runs
    #[arg(long, value_enum, default_value = "lattice")]
    structure: StructureChoice,
    /// Reduction from three axes to one
    #[arg(long, value_enum, default_value = "pca")]
    reduce: Reduction,
    /// RMS below which a trial counts as silent, in m/s²
    #[arg(long, value_name = "M_S2", value_parser = not_negative, default_value_t = SILENCE_FLOOR_M_S2)]
    silence_floor: f64,
    /// Source of the excitation: noise, pieces of the recordings' own residual, or what a test finds
    #[arg(long, value_enum, default_value = "auto")]
    excitation: ExcitationChoice,
    /// Level of the excitation: steady, pieces of the recordings' own level, or what a test finds
    #[arg(long, value_enum, default_value = "auto")]
    modulation: ModulationChoice,
    /// Verdicts of trials to leave out; their nodes are filled from neighbours
    #[arg(long, value_delimiter = ',', value_parser = clap::builder::PossibleValuesParser::new(Verdict::NAMES))]
    drop: Vec<String>,
    /// Refuse a set if triage finds anything
    #[arg(long)]
    strict: bool,
    /// Fill the grid between recorded nodes as densely as the slot allows, and show the gain
    #[arg(long)]
    densify: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
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
        excitation: arguments.excitation,
        modulation: arguments.modulation,
        drop: arguments.drop.clone(),
        strict: arguments.strict,
    };
    let (fit, mut bytes) = fit_library(&set, &options)?;
    let concessions = match highest_order {
        Some(highest) => Some(concessions(&set, &fit, &options, arguments.order, highest)?),
        None => None,
    };
    let denser = if arguments.densify {
        Some(densify::densify(&set, &fit, &options)?)
    } else {
        None
    };
    if let Some(denser) = &denser {
        bytes = encoded(&denser.densified.specs)?;
    }
    write_library(&arguments.out, &bytes, &set, &fit, &options)?;
    let library = decode_library(&arguments.out, &bytes)?;
    let textures: Vec<TextureSummary> = library
        .textures()
        .map(|t| TextureSummary::of(&t, arguments.json))
        .collect();
    if arguments.json {
        return print_json(&FitReport {
            library: arguments.out.display().to_string(),
            bytes: bytes.len(),
            warnings: &fit.warnings,
            textures,
            trials: &fit.trials,
            excitations: &fit.excitations,
            added_lines: denser.as_ref().map(|d| d.densified.lines.as_slice()),
            removed_nodes: denser.as_ref().and_then(|d| d.test.as_ref()),
            budget: concessions.as_deref(),
        });
    }
    show_verdicts(&fit);
    print(&texture_table(&textures))?;
    if let Some(denser) = &denser {
        print(&format!("\n{}", densify::summary(denser)))?;
    }
    if !fit.excitations.is_empty() {
        print(&format!("\n{}", excitations(&fit.excitations)))?;
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
