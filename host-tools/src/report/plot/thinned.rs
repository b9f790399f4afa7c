//! Curves thinned to what can be seen.

/// At most `MAX_POINTS` points that look like `points`, whose x rise: of each of equal shares, in their order, the
/// lowest and the highest. What is not finite is left out.
pub fn thinned(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    const MAX_POINTS: usize = 1500;
    let points: Vec<(f64, f64)> = points
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .collect();
    if points.len() <= MAX_POINTS {
        return points;
    }
    let share = points.len().div_ceil(MAX_POINTS / 2);
    let extremes = points.chunks(share).flat_map(|chunk| {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let lowest = chunk.iter().min_by(by_y);
        let highest = chunk.iter().max_by(by_y);
        let mut both: Vec<(f64, f64)> = lowest.into_iter().chain(highest).copied().collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both
    });
    extremes.collect()
}
