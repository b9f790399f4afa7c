//! Fits with progress bars.

use std::path::Path;

use host_tools::evaluation::budget;
use host_tools::evaluation::budget::Concession;
use host_tools::fit;
use host_tools::fit::record::FitRecord;
use host_tools::fit::{ExcitationChoice, Fit, ModulationChoice, Order};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::progress;

/// Fits `set` with a progress bar, and encodes the library.
pub fn fit_library(set: &RecordingSet, options: &fit::Options) -> Result<(Fit, Vec<u8>)> {
    let bar = progress::bar(set.trials.len() as u64, "fitting");
    let fit = fit::fit(set, options, || bar.inc(1))?;
    bar.finish_and_clear();
    let bytes = fit.library()?;
    Ok((fit, bytes))
}

/// Writes a library of `fit`, made of `set` with `options`, and beside it the record of the fit.
///
/// The library gets its name first: a record that is missing, or of an earlier library, is not believed.
pub fn write_library(
    path: &Path,
    bytes: &[u8],
    set: &RecordingSet,
    fit: &Fit,
    options: &fit::Options,
) -> Result<FitRecord> {
    let record = FitRecord::of(set, options, bytes)?.with_account_of(fit);
    record.write_with(path, bytes)?;
    Ok(record)
}

/// Loss of accuracy of `fit`, bounded to orders up to `highest`, against a fit with `order`. The unbounded fit is a
/// lattice, because the comparison is of the models alone.
pub fn concessions(
    set: &RecordingSet,
    fit: &Fit,
    options: &fit::Options,
    order: Order,
    highest: usize,
) -> Result<Vec<Concession>> {
    let unbounded = fit::Options {
        order: budget::capped(order, model_format::limits::MAX_ORDER),
        // The models are compared, not what excites them.
        excitation: ExcitationChoice::Gaussian,
        modulation: ModulationChoice::None,
        ..options.clone()
    };
    let bar = progress::bar(set.trials.len() as u64, "fitting without bounds");
    let without = fit::fit(set, &unbounded, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(budget::concessions(&without, fit, highest))
}
