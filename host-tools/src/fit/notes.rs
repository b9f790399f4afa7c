//! Notes on a fit of recordings that are not as they should be.

use model_format::NodeFlags;

use crate::texture::grid::Grid;

use super::grid::Miss;
use super::options::{Estimator, Options, Order};
use super::trial_report::TrialReport;

/// A mean this many times the RMS is more than an offset of an amplifier: gravity, or a sensor that is not what it is
/// taken for.
const LARGE_MEAN: f64 = 1.0;

/// Values of an axis that differ by less than this share of themselves may be one nominal value, measured twice.
const CLOSE_SHARE: f32 = 0.01;

/// Returns the notes on texture `name`, one line each: on its `grid`, on the bands that nodes miss, on the `trials`
/// that were used, and on the number of `idle` ones, which were not, because they are at rest or without contact.
pub(super) fn of(
    name: &str,
    grid: &Grid,
    misses: &[Miss],
    trials: &[&TrialReport],
    idle: usize,
    options: &Options,
) -> Vec<String> {
    let left_out = (idle > 0).then(|| {
        format!(
            "texture '{name}': {idle} trial(s) at speed 0 or force 0 are left out, because the stylus is silent there: \
             give light contact its force, such as 0.05 N, to use them"
        )
    });
    let close = [
        close_values("speeds", &grid.speeds_mm_s, "mm/s"),
        close_values("forces", &grid.forces_n, "N"),
    ];
    let close = close
        .into_iter()
        .flatten()
        .map(|pair| format!("texture '{name}': {pair}"));
    let lowered = lowered_orders(grid, options).map(|(nodes, order, speed, force)| {
        format!(
            "texture '{name}': {nodes} node(s) have a lower order than was asked for, the lowest {order} at {speed} \
             mm/s, {force} N: too few samples, or a signal of a few lines, which higher orders only make \
             ill-conditioned"
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
    let missed = missed_bands(name, misses, options);
    left_out
        .into_iter()
        .chain(close)
        .chain(lowered)
        .chain(removed)
        .chain(missed)
        .collect()
}

/// Returns a note on the closest values of an axis, if they are closer than nominal values would be.
fn close_values(what: &str, values: &[f32], unit: &str) -> Option<String> {
    let close = values
        .windows(2)
        .filter(|pair| pair[1] - pair[0] < CLOSE_SHARE * pair[1]);
    let share = |pair: &&[f32]| (pair[1] - pair[0]) / pair[1];
    let closest = close.clone().min_by(|a, b| share(a).total_cmp(&share(b)))?;
    Some(format!(
        "{} pair(s) of {what} are less than 1 % apart, such as {} and {} {unit}, and make a line of nodes each: give \
         nominal values in the list if they are meant to be one",
        close.count(),
        closest[0],
        closest[1]
    ))
}

/// Returns a note on the bands that nodes miss.
fn missed_bands(name: &str, misses: &[Miss], options: &Options) -> Option<String> {
    let level = |miss: &&Miss| miss.band.level_db.abs();
    let worst = misses.iter().max_by(|a, b| level(a).total_cmp(&level(b)))?;
    let remedy = match (options.estimator, options.order) {
        (Estimator::Rectangular | Estimator::Multitaper, _) => {
            "fit with --estimator auto, or record for longer"
        }
        (_, Order::Fixed(model_format::limits::MAX_ORDER)) => "record for longer",
        _ => "fit with --order 400, or record for longer",
    };
    Some(format!(
        "texture '{name}': {} node(s) miss a third-octave band of their recording, worst by {:+.1} dB at {:.0} Hz, {} \
         mm/s, {} N: {remedy}",
        misses.len(),
        worst.band.level_db,
        worst.band.centre_hz,
        worst.speed_mm_s,
        worst.force_n
    ))
}

/// Returns the number of measured nodes below the fixed order that was asked for, the lowest order, its speed and
/// force.
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
