//! `stylus frontier`

use std::path::{Path, PathBuf};

use host_tools::dsp::reduction::Reduction;
use host_tools::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use host_tools::evaluation::frontier;
use host_tools::evaluation::frontier::{
    Earlier, Frontier, Material, Options, PARTS_COLUMNS, PartsRow, Point, Prepared,
};
use host_tools::recording::RecordingSet;
use host_tools::report::evaluation_folder::DATA;
use host_tools::report::{figures, frontier_page};
use host_tools::support::atomic_file::folder_of;
use host_tools::support::error::{Error, Result};
use host_tools::support::output::OutputFolder;
use host_tools::support::temporaries::Temporary;
use host_tools::support::{atomic_file, progress};

use super::input::not_negative;
use super::overwrite::Overwrite;
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
    /// Folder for the page, its figures and its numbers [default: frontier-out, or the folder of --redraw]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Numbers of an earlier comparison, whose front is to stand beside the new one: its frontier.json
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// Draw page and figures anew from the numbers of a comparison, its frontier.json, without computing anything
    #[arg(long, value_name = "FILE", conflicts_with_all = ["data", "orders", "reduce", "smoothing", "seed"])]
    redraw: Option<PathBuf>,
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
    // Read before the work, and before the new numbers may take the file's place.
    let before = arguments.before.as_deref().map(Earlier::read).transpose()?;
    let out = match (&arguments.out, &arguments.redraw) {
        (Some(out), _) => out,
        (None, Some(numbers)) => folder_of(numbers),
        (None, None) => Path::new("frontier-out"),
    };
    let redrawn = arguments.redraw.as_deref().map(read).transpose()?;
    let inputs = arguments.data.iter().chain(&arguments.takes);
    (arguments.overwrite).folder(out, &inputs.cloned().collect::<Vec<_>>())?;
    let (frontier, numbers) = if let Some(redrawn) = redrawn {
        redrawn
    } else {
        let frontier = compute(arguments)?;
        let numbers = to_json(&frontier).into_bytes();
        (frontier, numbers)
    };
    let page = OutputFolder::begin(out, arguments.overwrite.is_asked())?.fill(|folder| {
        let page = write(&frontier, &numbers, before.as_ref(), folder.path())?;
        Ok(folder.named(&page))
    })?;
    print(&summary(&frontier))?;
    print(&format!("\n{}", page.display()))
}

/// Reads the numbers of a comparison, also as they are written.
fn read(path: &Path) -> Result<(Frontier, Vec<u8>)> {
    let frontier = Frontier::read(path)?;
    let numbers = std::fs::read(path).map_err(Error::io("read", path))?;
    Ok((frontier, numbers))
}

/// Fits, plays and compares.
fn compute(arguments: &Arguments) -> Result<Frontier> {
    // Simulated recordings are needed only during the comparison.
    let scratch = std::env::temp_dir();
    let scratch = Temporary::folder_in(&scratch).map_err(Error::io("create", &scratch))?;
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
    Ok(frontier)
}

/// Writes the numbers, the pictures with their data, and the page into `out`; gives the page's path.
fn write(
    frontier: &Frontier,
    numbers: &[u8],
    before: Option<&Earlier>,
    out: &Path,
) -> Result<PathBuf> {
    let pictures = frontier_page::pictures(frontier, before)?;
    let mut data = figures::Folder::new(&out.join(DATA))?;
    for (name, picture) in [
        ("error-against-time", &pictures.total),
        ("cost-against-time", &pictures.cost),
        ("snr-against-time", &pictures.snr),
        ("error-by-interval", &pictures.intervals),
    ] {
        picture.write(&out.join(format!("{name}.svg")))?;
        data.add(name, picture)?;
    }
    data.finish()?;
    atomic_file::write(&out.join("frontier.json"), numbers)?;
    let page = out.join("index.html");
    frontier_page::write(frontier, before, &pictures, &page)?;
    Ok(page)
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
    points.sort_by(|a, b| a.cycles.total_cmp(&b.cycles));
    let row = |point: &Point| {
        let filter = &frontier.filters[point.filter];
        let mut row = vec![
            filter.structure.to_string(),
            filter.order_text(),
            point.interval_ms().to_string(),
            format!("{:.2}", point.total_error_db),
            format!("{:.1}", 100.0 * filter.still.cost),
            format!("{:.0}", filter.still.lowest_snr_db),
            format!("{:.0}", point.cycles),
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
