//! Pareto fronts of a comparison: the choices that nothing cheaper beats.

use super::pareto;
use super::results::{Filter, Frontier};

/// Least gains that count for more time: less is the scatter of the measurement.
mod worth {
    /// Of C.
    pub const COST: f64 = 0.005;
    /// Of errors in bands, dB.
    pub const BAND_DB: f64 = 0.05;
}

/// Marks what nothing cheaper beats. Where a structure does not hold all nodes or textures it is not in the running.
pub(super) fn mark_fronts(frontier: &mut Frontier) {
    let costs = frontier.filters.iter().map(|filter| {
        let holds = filter.still.refused == 0;
        let cost = if holds { filter.still.cost } else { f64::NAN };
        (filter.m4.sample.cycles, cost)
    });
    let on_cost_front = pareto::front(&costs.collect::<Vec<_>>(), worth::COST);
    let front = |holds: fn(&Filter) -> bool| {
        let points = frontier.points.iter().map(|point| {
            let filter = &frontier.filters[point.filter];
            let is_played = filter.still.refused == 0 && filter.refused_textures.is_empty();
            let error = if is_played && holds(filter) {
                point.total_error_db
            } else {
                f64::NAN
            };
            (point.cycles, error)
        });
        pareto::front(&points.collect::<Vec<_>>(), worth::BAND_DB)
    };
    let on_front = front(|_| true);
    let on_safe_front = front(|filter| filter.hard.held == filter.hard.cases);
    for (filter, on_front) in frontier.filters.iter_mut().zip(on_cost_front) {
        filter.on_cost_front = on_front;
    }
    let marks = on_front.into_iter().zip(on_safe_front);
    for (point, (on_front, on_safe_front)) in frontier.points.iter_mut().zip(marks) {
        (point.on_front, point.on_safe_front) = (on_front, on_safe_front);
    }
}
