//! `stylus frontier`

use std::path::PathBuf;

use stylus_dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use stylus_evaluation::frontier::{self, Frontier, Material, Options, Prepared};
use stylus_fit::fit::conditioning::Conditioning;
use stylus_report::frontier_page;
use stylus_signals::recording::RecordingSet;
use stylus_support::output::OutputFolder;
use stylus_support::temporaries::Temporary;
use stylus_support::{Error, Result};
use stylus_support::{atomic_file, progress};

use super::files::Overwrite;
use super::input::not_negative;
use super::output::folded_text;
use super::table::shown;
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    /// Recordings to fit and to evaluate against: a folder with trials.csv, or such a list [default: simulated ones]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Another take of the same trials to evaluate against [default: the second half of each recording; the first is
    /// fitted]
    #[arg(long, value_name = "DIR", requires = "data")]
    takes: Option<PathBuf>,
    /// Folder for the page and its numbers
    #[arg(long, value_name = "DIR", default_value = "frontier-out")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Orders that are the same for all nodes, beside orders chosen per node
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = order, default_values_t = frontier::ORDERS)]
    orders: Vec<usize>,
    #[command(flatten)]
    conditioning: Conditioning,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, in hertz
    #[arg(long, value_name = "HZ", value_parser = not_negative, default_value_t = DEFAULT_SMOOTHING_WIDTH_HZ)]
    smoothing: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.overwrite.folder(&arguments.out)?;
    let frontier = compute(arguments)?;
    let folder = OutputFolder::begin(&arguments.out, arguments.overwrite.is_asked())?;
    let page = folder.fill(|folder| {
        let numbers = folder.path().join("frontier.json");
        atomic_file::write(&numbers, frontier.to_json().as_bytes())?;
        let page = folder.path().join("index.html");
        frontier_page::write(&frontier, &page)?;
        Ok(folder.named(&page))
    })?;
    print(&summary(&frontier))?;
    print(&format!("\n{}", page.display()))
}

/// Fits the models, plays them and compares the results.
fn compute(arguments: &Arguments) -> Result<Frontier> {
    let scratch;
    let material = match (&arguments.data, &arguments.takes) {
        (None, _) => {
            // Simulated recordings are needed only during the comparison, so they go into a temporary folder.
            let folder = std::env::temp_dir();
            scratch = Temporary::folder_in(&folder).map_err(Error::io("create", &folder))?;
            Material::simulated(scratch.path())?
        }
        (Some(data), None) => Material::halves(&RecordingSet::open(std::slice::from_ref(data))?)?,
        (Some(data), Some(takes)) => Material::takes(
            RecordingSet::open(std::slice::from_ref(data))?,
            RecordingSet::open(std::slice::from_ref(takes))?,
        )?,
    };
    let options = Options {
        orders: arguments.orders.clone(),
        conditioning: arguments.conditioning,
        smoothing_hz: arguments.smoothing,
        seed: arguments.seed,
        ..Options::default()
    };
    let bar = progress::bar(material.fit.trials.len() as u64, "fitting");
    let prepared = Prepared::new(&material, &options, || bar.inc(1))?;
    bar.finish_and_clear();
    let bar = progress::bar(prepared.work() as u64, "comparing");
    let frontier = prepared.run(&options, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(frontier)
}

/// Parses an order that a library can hold.
fn order(text: &str) -> std::result::Result<usize, String> {
    const MAX_ORDER: usize = model_format::limits::MAX_ORDER;
    match text.parse() {
        Ok(order) if (1..=MAX_ORDER).contains(&order) => Ok(order),
        _ => Err(format!("must be 1 to {MAX_ORDER}")),
    }
}

/// Returns the answer, and the three choices that it names.
fn summary(frontier: &Frontier) -> String {
    let origin = if frontier.simulated {
        " The recordings are SIMULATED."
    } else {
        ""
    };
    format!(
        "{}\n\n{}\n\n{}",
        folded_text(&format!("{}{origin}", frontier.answer())),
        shown(&frontier.choice_table()),
        folded_text(frontier::CHOICES_NOTE)
    )
}
