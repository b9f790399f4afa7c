//! The edges of an encoder's wheel in motion.

use proptest::prelude::*;
use virtual_stylus::motion::{Edge, Motion};

/// All edges until `until_ns`. The wheel starts with count 0, in the middle between two counts.
fn edges(motion: &Motion, until_ns: u64) -> Vec<Edge> {
    let mut from = Edge { at_ns: 0, count: 0 };
    std::iter::from_fn(|| {
        from = motion.next_edge(from.at_ns, from.count, 0.5)?;
        (from.at_ns <= until_ns).then_some(from)
    })
    .collect()
}

proptest! {
    #[test]
    fn between_two_edges_the_count_is_the_floor_of_the_position(
        speeds in prop::collection::vec(-400.0..400.0f64, 2..8),
    ) {
        let knots: Vec<(u64, f64)> = (0..).step_by(50_000_000).zip(speeds).collect();
        let until_ns = 60_000_000 * knots.len() as u64;
        let motion = Motion::linear(&knots, 0.1).unwrap();
        let edges = edges(&motion, until_ns);
        for pair in edges.windows(2) {
            prop_assert!(pair[0].at_ns < pair[1].at_ns);
            prop_assert_eq!(pair[0].count.abs_diff(pair[1].count), 1);
        }
        let mut left = edges.iter().peekable();
        let mut count = 0;
        for at_ns in (0..until_ns).step_by(99_991) {
            while let Some(edge) = left.next_if(|edge| edge.at_ns <= at_ns) {
                count = edge.count;
            }
            let position = motion.position(at_ns) + 0.5;
            // An edge is reported at the first whole nanosecond after the exact instant. At 4000 counts per second, the
            // highest speed here, that is 4e-6 of a count.
            prop_assert!((position - count as f64 - 0.5).abs() <= 0.5 + 1e-4, "{} at {}", position, count);
        }
    }
}
