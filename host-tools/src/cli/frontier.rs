//! `stylus frontier`

use std::path::PathBuf;

use host_tools::dsp::reduction::Reduction;
use host_tools::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use host_tools::evaluation::frontier;
use host_tools::evaluation::frontier::{
    Frontier, Material, Options, PARTS_COLUMNS, PartsRow, Point, Prepared,
};
use host_tools::recording::RecordingSet;
use host_tools::report::frontier_page;
use host_tools::support::error::{Error, Result};
use host_tools::support::{atomic_file, progress};

use super::input::not_negative;
use super::table::table;
use crate::cli::output::{print, to_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Recordings to fit and to evaluate against: a folder with trials.csv, or such a list [default: simulated ones]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Another take of the same trials to evaluate against [default: the second half of each recording; the first is
    /// fitted]
    #[arg(long, value_name = "DIR", requires = "data")]
    takes: Option<PathBuf>,
    /// Folder for the page, its figures and its numbers
    #[arg(long, value_name = "DIR", default_value = "frontier-out")]
    out: PathBuf,
    /// Orders that are the same for all nodes, beside orders chosen per node
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = order, default_values_t = frontier::ORDERS)]
    orders: Vec<usize>,
    /// Reduction from three axes to one
    #[arg(long, value_enum, default_value = "pca")]
    reduce: Reduction,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, in hertz
    #[arg(long, value_name = "HZ", value_parser = not_negative, default_value_t = DEFAULT_SMOOTHING_WIDTH_HZ)]
    smoothing: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let out = arguments.out.as_path();
    std::fs::create_dir_all(out).map_err(Error::io("create", out))?;
    // Simulated recordings are needed only during the comparison.
    let scratch = tempfile::tempdir().map_err(Error::io("create", &std::env::temp_dir()))?;
    let material = match (&arguments.data, &arguments.takes) {
        (None, _) => Material::simulated(scratch.path())?,
        (Some(data), None) => Material::halves(&RecordingSet::open(std::slice::from_ref(data))?)?,
        (Some(data), Some(takes)) => Material::takes(
            RecordingSet::open(std::slice::from_ref(data))?,
            RecordingSet::open(std::slice::from_ref(takes))?,
        )?,
    };
    let options = Options {
        orders: arguments.orders.clone(),
        reduction: arguments.reduce,
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
    let pictures = frontier_page::pictures(&frontier)?;
    for (name, picture) in [
        ("error-against-time.svg", &pictures.total),
        ("cost-against-time.svg", &pictures.cost),
        ("snr-against-time.svg", &pictures.snr),
        ("error-by-interval.svg", &pictures.intervals),
    ] {
        picture.write(&out.join(name))?;
    }
    atomic_file::write(&out.join("frontier.json"), to_json(&frontier).as_bytes())?;
    let page = out.join("index.html");
    frontier_page::write(&frontier, &pictures, &page)?;
    print(&summary(&frontier))?;
    print(&format!("\n{}", page.display()))
}

/// Parses an order that a library can hold.
fn order(text: &str) -> std::result::Result<usize, String> {
    const MAX_ORDER: usize = model_format::limits::MAX_ORDER;
    match text.parse() {
        Ok(order) if (1..=MAX_ORDER).contains(&order) => Ok(order),
        _ => Err(format!("must be 1 to {MAX_ORDER}")),
    }
}

/// Table of the Pareto front, and an explanation of its columns.
fn summary(frontier: &Frontier) -> String {
    let header = [
        "structure",
        "order",
        "update ms",
        "error dB",
        "C %",
        "SNR dB",
        "cycles M4",
        "80 MHz",
        "168 MHz",
        "480 MHz",
        "hard cases",
        "safe front",
    ];
    let mut points: Vec<&Point> = frontier
        .points
        .iter()
        .filter(|point| point.on_front || point.on_safe_front)
        .collect();
    points.sort_by(|a, b| a.worst_cycles.total_cmp(&b.worst_cycles));
    let row = |point: &Point| {
        let filter = &frontier.filters[point.filter];
        let mut row = vec![
            filter.structure.to_string(),
            filter.order_text(),
            point.interval_ms().to_string(),
            format!("{:.2}", point.total_error_db),
            format!("{:.1}", 100.0 * filter.still.cost),
            format!("{:.0}", filter.still.lowest_snr_db),
            format!("{:.0}", point.worst_cycles),
        ];
        row.extend(
            point
                .shares()
                .map(|share| format!("{:.1} %", 100.0 * share)),
        );
        row.push(format!("{} of {}", filter.hard.held, filter.hard.cases));
        row.push(if point.on_safe_front { "x" } else { "" }.to_owned());
        row
    };
    let rows: Vec<Vec<String>> = points.into_iter().map(row).collect();
    let parts: Vec<Vec<String>> = frontier.parts.iter().map(PartsRow::cells).collect();
    let origin = if frontier.simulated {
        "\nThe recordings are SIMULATED."
    } else {
        ""
    };
    format!(
        "The Pareto front of {} choices (structure, order, update interval): no cheaper choice has a lower \
         error.\n\n{}\n\n\
         error: third-octave bands, at rest against held-out recordings, in motion against float64; cycles: modelled \
         worst case\nper sample, with updates; shares are of 200 µs; safe front: the front of the choices that hold \
         every hard case\n\nOptional parts of the lattice at its highest order, against the held-out \
         recordings\n\n{}{origin}",
        frontier.points.len(),
        table(&header, &rows),
        table(&PARTS_COLUMNS.map(|(heading, _)| heading), &parts),
    )
}
