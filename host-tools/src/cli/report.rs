//! `stylus report`

use std::path::PathBuf;

use host_tools::dsp::reduction::Reduction;
use host_tools::dsp::spectrum::DEFAULT_SMOOTHING_WIDTH_HZ;
use host_tools::evaluation::evaluate;
use host_tools::evaluation::leave_one_out;
use host_tools::evaluation::leave_one_out::{Prepared, Row};
use host_tools::fit::record::FitRecord;
use host_tools::fit::{self, Order};
use host_tools::report::removed_nodes::RemovedNodeTest;
use host_tools::report::set_page;
use host_tools::report::set_page::Inputs;
use host_tools::report::sound::node_seconds;
use host_tools::support::error::Result;
use host_tools::support::output::OutputFolder;
use host_tools::support::progress;

use super::input::{Recordings, not_negative};
use super::overwrite::Overwrite;
use crate::cli::evaluate::removed_nodes::removed_node_test;
use crate::cli::library_file::{decode_library, read_library};
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    recordings: Recordings,
    /// HTML file to write
    #[arg(long, value_name = "HTML")]
    out: PathBuf,
    /// Folder for the data of every figure: a CSV file each, and all of them as figures.npz for NumPy
    #[arg(long, value_name = "DATA_DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Library to report on [default: fitted to the recordings]
    #[arg(long, value_name = "LIB")]
    library: Option<PathBuf>,
    /// Other takes of the same trials, as a folder or a list, which judge the library instead
    #[arg(long, value_name = "DIR")]
    takes: Option<PathBuf>,
    /// Order of fitted models: 0 to 400, or 'auto'
    #[arg(long, default_value = "400")]
    order: Order,
    /// Reduction from three axes to one; the same as for the fit
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
    let inputs = (arguments.recordings.inputs().iter()).chain(&arguments.library);
    let inputs: Vec<PathBuf> = inputs.chain(&arguments.takes).cloned().collect();
    arguments.overwrite.file(&arguments.out, &inputs)?;
    if let Some(data) = &arguments.data {
        arguments.overwrite.folder(data, &inputs)?;
    }
    let set = arguments.recordings.open()?;
    let (bytes, record) = if let Some(path) = &arguments.library {
        let bytes = read_library(path)?;
        let record = FitRecord::beside(path, &bytes)?;
        (bytes, record)
    } else {
        let options = fit::Options {
            order: arguments.order,
            reduction: arguments.reduce,
            ..fit::Options::default()
        };
        let (fit, bytes) = super::fit::fit_library(&set, &options)?;
        let record = FitRecord::of(&set, &options, &bytes)?.with_account_of(&fit);
        (bytes, Some(record))
    };
    let set = super::evaluate::takes::as_fitted(record.as_ref(), set)?;
    let path = arguments.library.clone().unwrap_or_default();
    let library = decode_library(&path, &bytes)?;
    let options = evaluate::Options {
        reduction: arguments.reduce,
        smoothing_hz: arguments.smoothing,
        seed: arguments.seed,
        in_sample: true,
        excerpt_s: node_seconds(set.trials.len()),
        ..evaluate::Options::default()
    };
    let takes = arguments.takes.as_deref();
    let chosen = super::evaluate::takes::choose(&set, takes, record.as_ref(), arguments.reduce)?;
    let evaluation =
        super::evaluate::evaluate_set(&set, &library, chosen.judges, record.as_ref(), &options)?;
    let removal = leave_one_out::Options {
        reduction: arguments.reduce,
        order: arguments.order,
        smoothing_hz: arguments.smoothing,
        seed: arguments.seed,
        ..leave_one_out::Options::default()
    };
    // A set without a node between others has no such test, and the page is written without it.
    let prepared = Prepared::new(&set, &removal).ok();
    let test = prepared
        .as_ref()
        .map(|prepared| removed_node_test(prepared, &Row::all(), &removal))
        .transpose()?;
    let inputs = Inputs {
        set: &set,
        library: &library,
        evaluation: &evaluation,
        options: &options,
        test: test
            .as_ref()
            .zip(prepared.as_ref())
            .map(|(test, prepared)| RemovedNodeTest {
                test,
                prepared,
                options: removal,
            }),
        unused_takes: &chosen.unused,
    };
    let bar = progress::bar(evaluation.textures.len() as u64, "reporting");
    let out = &arguments.out;
    if let Some(data) = &arguments.data {
        OutputFolder::begin(data, arguments.overwrite.is_asked())?
            .fill(|folder| set_page::write(&inputs, out, Some(folder.path()), || bar.inc(1)))?;
    } else {
        set_page::write(&inputs, out, None, || bar.inc(1))?;
    }
    bar.finish_and_clear();
    let origin = if evaluation.simulated {
        ", of SIMULATED recordings"
    } else {
        ""
    };
    print(&format!("{}{origin}", out.display()))?;
    match &arguments.data {
        Some(data) => print(&format!("data of its figures: {}", data.display())),
        None => Ok(()),
    }
}
