//! Regions of a grid, of nearby speeds, that have recorded snippets of their own. A click lasts as long as the tip
//! takes to cross a groove, so that snippets of a slow trial would be too long and too low in frequency at a fast node.

use std::ops::Range;

/// Width of a range, octaves. Clicks of an octave's slowest trials are rarer and ring longer than its fastest trials'.
const WIDTH_OCTAVES: f32 = 0.75;

/// Divides the ascending `speeds_mm_s` into at most `most` ranges of indices with the same ratio of highest to lowest
/// speed, which is about [`WIDTH_OCTAVES`] if `most` allows. Ranges that hold no speed are left out.
pub(super) fn by_speed(speeds_mm_s: &[f32], most: usize) -> Vec<Range<usize>> {
    let lowest = speeds_mm_s.iter().copied().find(|&speed| speed > 0.0);
    let octaves = |speed: f32| (speed / lowest.unwrap_or(1.0)).log2().max(0.0);
    let widest = speeds_mm_s.last().copied().map_or(0.0, octaves);
    let count = ((widest / WIDTH_OCTAVES).round() as usize).clamp(1, most.max(1));
    // If all speeds are equal, the ratio of octaves is not a number, which is converted to zero.
    let part = |speed| (count as f32 * octaves(speed) / widest) as usize;
    let before = |number| speeds_mm_s.partition_point(|&speed| part(speed).min(count - 1) < number);
    (0..count)
        .map(|number| before(number)..before(number + 1))
        .filter(|range| !range.is_empty())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Covers speed 0 and grids with a single speed.
        #[test]
        fn each_speed_is_in_one_range_and_the_ratio_of_its_ends_is_bounded(
            mut speeds in prop::collection::vec(prop_oneof![Just(0.0f32), 1.0f32..1000.0], 1..16),
            count in 1usize..5,
        ) {
            speeds.sort_by(f32::total_cmp);
            let ranges = by_speed(&speeds, count);
            prop_assert!(ranges.len() <= count);
            let joined: Vec<usize> = ranges.iter().cloned().flatten().collect();
            prop_assert_eq!(joined, (0..speeds.len()).collect::<Vec<_>>());
            let ratio = |own: &[f32]| {
                let lowest = own.iter().find(|&&speed| speed > 0.0);
                lowest.map_or(1.0, |lowest| own[own.len() - 1] / lowest)
            };
            // An octave and a half, which rounding leaves, or what the number of ranges allows.
            let most = ratio(&speeds).powf(1.0 / count as f32).max(3.0);
            prop_assert!(ranges.iter().all(|own| ratio(&speeds[own.clone()]) <= 1.001 * most));
        }
    }
}
