//! Pareto fronts of a comparison: the choices that nothing cheaper beats.

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
    let on_cost_front = pareto(&costs.collect::<Vec<_>>(), worth::COST);
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
        pareto(&points.collect::<Vec<_>>(), worth::BAND_DB)
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

/// Marks the pairs (cost, error) that no other beats: none that costs as much or less has an error as low within
/// `worth`, by which an error must fall for more cost to count. What is not a number is never on the front.
fn pareto(points: &[(f64, f64)], worth: f64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&index| points[index].0.is_finite() && points[index].1.is_finite())
        .collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut on_front = vec![false; points.len()];
    let mut lowest = f64::INFINITY;
    for index in order {
        let error = points[index].1;
        if error < lowest - worth {
            lowest = error;
            on_front[index] = true;
        }
    }
    on_front
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nothing_on_the_front_is_beaten_and_all_else_is(
            points in prop::collection::vec((0.0..10.0f64, 0.0..10.0f64), 1..40),
        ) {
            let on_front = pareto(&points, 0.0);
            for (index, point) in points.iter().enumerate() {
                let beaten = points.iter().any(|other| {
                    other.0 <= point.0 && other.1 <= point.1 && other != point
                });
                prop_assert_eq!(on_front[index], !beaten);
            }
        }

        #[test]
        fn each_step_along_the_front_is_worth_its_cost(
            points in prop::collection::vec((0.0..10.0f64, 0.0..10.0f64), 1..40), worth in 0.0..2.0f64,
        ) {
            let on_front = pareto(&points, worth);
            let mut kept: Vec<(f64, f64)> = points.iter().zip(&on_front).filter(|p| *p.1).map(|p| *p.0).collect();
            kept.sort_by(|a, b| a.0.total_cmp(&b.0));
            prop_assert!(!kept.is_empty());
            prop_assert!(kept.windows(2).all(|pair| pair[1].1 < pair[0].1 - worth));
        }
    }

    #[test]
    fn what_is_not_a_number_is_never_on_the_front() {
        let points = [(1.0, f64::NAN), (f64::INFINITY, 0.0), (2.0, 1.0)];
        assert_eq!(pareto(&points, 0.0), [false, false, true]);
    }
}
