//! Notes on a fit of recordings that are not as they should be.

use model_format::NodeFlags;

use crate::texture::grid::Grid;

use super::options::{Options, Order};
use super::trial_report::TrialReport;

/// A mean this many times the RMS is more than an offset of an amplifier: gravity, or a sensor that is not what it is taken
/// for.
const LARGE_MEAN: f64 = 1.0;

/// Returns the notes on texture `name`, one line each.
pub(super) fn of(
    name: &str,
    grid: &Grid,
    trials: &[&TrialReport],
    options: &Options,
) -> Vec<String> {
    let lowered = lowered_orders(grid, options).map(|(nodes, order, speed, force)| {
        format!(
            "texture '{name}': {nodes} node(s) have a lower order than was asked for, the lowest {order} at {speed} mm/s, \
             {force} N: too few samples, or a signal of a few lines, which higher orders only make ill-conditioned"
        )
    });
    let with_mean = trials
        .iter()
        .filter(|trial| trial.mean_m_s2 > LARGE_MEAN * trial.rms_m_s2 && trial.mean_m_s2 > 0.0);
    let largest = with_mean
        .clone()
        .map(|trial| trial.mean_m_s2)
        .fold(0.0, f64::max);
    let removed = (largest > 0.0).then(|| {
        format!(
            "texture '{name}': a mean above the RMS, up to {largest:.3} m/s², was removed from {} trial(s)",
            with_mean.count()
        )
    });
    lowered.into_iter().chain(removed).collect()
}

/// Returns the number of measured nodes below the fixed order that was asked for, the lowest order, its speed and force.
fn lowered_orders(grid: &Grid, options: &Options) -> Option<(usize, usize, f32, f32)> {
    let Order::Fixed(asked) = options.order else {
        return None;
    };
    let filled = NodeFlags::SILENT
        .with(NodeFlags::INTERPOLATED)
        .with(NodeFlags::EXTRAPOLATED);
    let lowered = || {
        grid.nodes().filter(|(.., model)| {
            model.flags.bits() & filled.bits() == 0 && model.reflection.len() < asked
        })
    };
    let (speed, force, lowest) = lowered().min_by_key(|(.., model)| model.reflection.len())?;
    Some((lowered().count(), lowest.reflection.len(), speed, force))
}
