//! Places of labels beside their points, so that none covers another, a marked point, or a line more than it must.
//!
//! All is in drawn pixels. Labels are placed from left to right; each takes the best of places around its point, nearer
//! ones first, and further away a line leads to it.

use std::f64::consts::TAU;

/// A point, x to the right and y down.
pub type Place = (i32, i32);

/// A rectangle along the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its left edge.
    pub left: i32,
    /// Its upper edge.
    pub top: i32,
    /// Its right edge.
    pub right: i32,
    /// Its lower edge.
    pub bottom: i32,
}

impl Frame {
    /// The frame of this size around `middle`.
    pub fn around((x, y): Place, (width, height): (i32, i32)) -> Self {
        Self {
            left: x - width / 2,
            top: y - height / 2,
            right: x + width - width / 2,
            bottom: y + height - height / 2,
        }
    }

    /// Returns whether both have a common inner point.
    pub fn meets(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    /// Returns whether `other` lies in this.
    pub fn holds(&self, other: &Self) -> bool {
        self.left <= other.left
            && self.top <= other.top
            && self.right >= other.right
            && self.bottom >= other.bottom
    }

    /// The point of the frame that is nearest to `place`.
    fn nearest(&self, (x, y): Place) -> Place {
        (
            x.clamp(self.left, self.right),
            y.clamp(self.top, self.bottom),
        )
    }

    /// Returns whether a straight line touches the frame, by the sides of its corners and by its ends.
    pub fn is_crossed_by(&self, (from, to): (Place, Place)) -> bool {
        let beside = |a: i32, b: i32, low: i32, high: i32| a.max(b) < low || a.min(b) > high;
        if beside(from.0, to.0, self.left, self.right)
            || beside(from.1, to.1, self.top, self.bottom)
        {
            return false;
        }
        let side = |(x, y): Place| {
            let (dx, dy) = (i64::from(to.0 - from.0), i64::from(to.1 - from.1));
            dx * i64::from(y - from.1) - dy * i64::from(x - from.0)
        };
        let sides = [
            (self.left, self.top),
            (self.right, self.top),
            (self.left, self.bottom),
            (self.right, self.bottom),
        ]
        .map(side);
        sides.iter().any(|side| *side <= 0) && sides.iter().any(|side| *side >= 0)
    }
}

/// A point with the size of its label.
#[derive(Clone, Copy, Debug)]
pub struct Labelled {
    /// The point.
    pub point: Place,
    /// Width and height of the label.
    pub size: (i32, i32),
}

/// The place of a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    /// The frame that the label fills.
    pub frame: Frame,
    /// A line from beside the point to the label, where that is not next to it.
    pub leader: Option<(Place, Place)>,
}

/// Directions that are tried around a point.
const DIRECTIONS: usize = 16;

/// Steps away from a point that are tried.
const STEPS: usize = 14;

/// Places labels within `area`, each beside its point, whose mark has the radius `clear`.
///
/// No label meets another, nor a mark, nor the leader of another; lines of the picture, as pairs of ends, are avoided
/// as far as that goes. `None` is a label that there is no room for.
pub fn placed(
    labels: &[Labelled],
    lines: &[(Place, Place)],
    area: Frame,
    clear: i32,
) -> Vec<Option<Placed>> {
    let marks: Vec<Frame> = labels
        .iter()
        .map(|label| Frame::around(label.point, (2 * clear, 2 * clear)))
        .collect();
    let mut order: Vec<usize> = (0..labels.len()).collect();
    order.sort_by_key(|&index| labels[index].point);
    let mut found: Vec<Option<Placed>> = vec![None; labels.len()];
    for index in order {
        let Labelled { point, size } = labels[index];
        let is_free = |placed: &Placed| {
            let others = found.iter().flatten();
            let mut marks = marks.iter().enumerate();
            area.holds(&placed.frame)
                && !others.clone().any(|other| {
                    let crossed = other.leader.is_some_and(|l| placed.frame.is_crossed_by(l));
                    other.frame.meets(&placed.frame) || crossed
                })
                && !marks.any(|(other, mark)| {
                    let crosses = |leader| mark.is_crossed_by(leader);
                    let is_led_over = other != index
                        && labels[other].point != point
                        && placed.leader.is_some_and(crosses);
                    mark.meets(&placed.frame) || is_led_over
                })
                && !placed.leader.is_some_and(|leader| {
                    let mut others = found.iter().flatten();
                    others.any(|other| other.frame.is_crossed_by(leader))
                })
        };
        let covered = |placed: &Placed| {
            let covered = lines
                .iter()
                .filter(|line| placed.frame.is_crossed_by(**line));
            covered.count() as i32
        };
        let candidates = candidates(point, size, clear);
        let free = candidates.filter(|(_, placed)| is_free(placed));
        // A line that is covered is as bad as four steps away.
        let best = free.min_by_key(|(step, placed)| *step as i32 + 4 * covered(placed));
        found[index] = best.map(|(_, placed)| placed);
    }
    found
}

/// Places around a point with the number of steps to them, upwards first.
fn candidates(
    point: Place,
    (width, height): (i32, i32),
    clear: i32,
) -> impl Iterator<Item = (usize, Placed)> {
    (0..STEPS).flat_map(move |step| {
        (0..DIRECTIONS).map(move |direction| {
            // Up, a bit to the right, a bit to the left, and so on, down at last.
            let turn = direction.div_ceil(2) as f64 / DIRECTIONS as f64;
            let angle = TAU * if direction % 2 == 0 { -turn } else { turn };
            let gap = f64::from(clear) * (1.25 + step as f64 * 0.75);
            let reach = |half: i32| f64::from(half) + gap;
            let middle = (
                point.0 + (angle.sin() * reach(width / 2)).round() as i32,
                point.1 - (angle.cos() * reach(height / 2)).round() as i32,
            );
            let frame = Frame::around(middle, (width, height));
            let end = frame.nearest(point);
            let (dx, dy) = (f64::from(end.0 - point.0), f64::from(end.1 - point.1));
            let away = dx.hypot(dy);
            let is_far = away > 1.9 * f64::from(clear);
            let leader = is_far.then(|| {
                let part = f64::from(clear) / away;
                let begin = (
                    point.0 + (dx * part).round() as i32,
                    point.1 + (dy * part).round() as i32,
                );
                (begin, end)
            });
            (step, Placed { frame, leader })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AREA: Frame = Frame {
        left: 0,
        top: 0,
        right: 1700,
        bottom: 700,
    };
    const CLEAR: i32 = 14;

    fn labelled() -> impl Strategy<Value = Vec<Labelled>> {
        // In a corner of the area, closer than labels are wide.
        let point = (20..700i32, 20..500i32);
        let label = (point, 20..90i32).prop_map(|(point, width)| Labelled {
            point,
            size: (width, 24),
        });
        prop::collection::vec(label, 0..24)
    }

    proptest! {
        #[test]
        fn no_label_meets_another_or_a_mark_or_leaves_the_picture(
            labels in labelled(),
            lines in prop::collection::vec(((0..1700i32, 0..700i32), (0..1700i32, 0..700i32)), 0..12),
        ) {
            let found = placed(&labels, &lines, AREA, CLEAR);
            prop_assert_eq!(found.len(), labels.len());
            let all: Vec<&Placed> = found.iter().flatten().collect();
            for (index, label) in all.iter().enumerate() {
                prop_assert!(AREA.holds(&label.frame));
                for other in &all[index + 1..] {
                    prop_assert!(!label.frame.meets(&other.frame), "{:?} {:?}", label, other);
                }
                for mark in labels.iter().map(|l| Frame::around(l.point, (2 * CLEAR, 2 * CLEAR))) {
                    prop_assert!(!label.frame.meets(&mark));
                }
            }
        }

        #[test]
        fn a_line_that_has_a_point_in_a_frame_crosses_it(
            place in (10..90i32, 10..90i32), direction in (-50..50i32, -50..50i32),
        ) {
            let frame = Frame { left: 10, top: 10, right: 90, bottom: 90 };
            let ends = |by: i32| (place.0 + by * direction.0, place.1 + by * direction.1);
            prop_assert!(frame.is_crossed_by((ends(-3), ends(2))));
            prop_assert!(!frame.is_crossed_by(((0, place.1), (5, 95))));
            prop_assert!(!frame.is_crossed_by(((-100, 60), (60, 300))));
        }
    }

    #[test]
    fn two_dozen_points_close_to_each_other_all_get_their_labels() {
        let labels: Vec<Labelled> = (0..24)
            .map(|n| Labelled {
                point: (300 + 45 * n, 500 - 6 * n),
                size: (110, 24),
            })
            .collect();
        let found = placed(&labels, &[], AREA, CLEAR);
        assert!(found.iter().all(Option::is_some), "{found:?}");
    }

    #[test]
    fn a_point_alone_has_its_label_right_above_it_without_a_line() {
        let label = Labelled {
            point: (500, 400),
            size: (60, 24),
        };
        let found = placed(&[label], &[], AREA, CLEAR)[0].unwrap();
        assert_eq!(found.leader, None);
        assert!(found.frame.bottom < 400 - CLEAR && found.frame.bottom > 400 - 3 * CLEAR);
        assert_eq!(i32::midpoint(found.frame.left, found.frame.right), 500);
    }
}
