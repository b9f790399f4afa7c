//! A half-plane without 0 that holds a cell's nodes on a part of an interval.

use super::expansion::{Expansion, scaled};
use super::table::TERMS;

/// Digits of a direction: its larger component's magnitude is from 2¹⁷ to 2¹⁸.
const DIRECTION_BITS: u32 = 17;

/// Digits after the point of t.
const T_BITS: u32 = 30;

/// Most halvings of an interval: parts of 10⁻¹⁰ rad at order 400.
pub(super) const MAX_DEPTH: u32 = 24;

const _: () = assert!(MAX_DEPTH < T_BITS);

/// A direction in the complex plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction {
    pub x: i32,
    pub y: i32,
}

/// A part of an interval: the one at `place` of 2^`depth` equal ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub depth: u32,
    pub place: u32,
}

/// A half-plane whose border goes through 0, and the nodes' distances from that border.
#[derive(Clone, Copy, Debug)]
pub(super) struct HalfPlane {
    /// From 0 into the half-plane.
    pub direction: Direction,
    /// Least distance of all nodes from the border on the whole part, units; 0 where that is not above zero.
    pub distance: i64,
    /// Least distance in the middle of the part.
    pub middle: i64,
}

impl Part {
    /// The whole interval.
    pub const WHOLE: Self = Self { depth: 0, place: 0 };

    /// Middle of the part on -1 ≤ t ≤ 1, in steps of 2⁻³⁰.
    pub fn middle(self) -> i32 {
        let step = 1i64 << (T_BITS - self.depth);
        (step * i64::from(2 * self.place + 1) - (1 << T_BITS)) as i32
    }

    /// The first half of the part; none where parts are as small as they get.
    pub fn halved(self) -> Option<Self> {
        (self.depth < MAX_DEPTH).then_some(Self {
            depth: self.depth + 1,
            place: 2 * self.place,
        })
    }

    /// The largest part that begins where this one ends; none at the end of the interval.
    pub fn next(self) -> Option<Self> {
        let Self {
            mut depth,
            mut place,
        } = self;
        place += 1;
        while depth > 0 && place.is_multiple_of(2) {
            (depth, place) = (depth - 1, place / 2);
        }
        (depth > 0).then_some(Self { depth, place })
    }
}

impl Direction {
    /// The direction of a vector; none of zero.
    fn of((x, y): (i64, i64)) -> Option<Self> {
        let largest = x.unsigned_abs().max(y.unsigned_abs());
        let bits = largest.checked_ilog2()?;
        let scale = |value: i64| {
            if bits >= DIRECTION_BITS {
                value >> (bits - DIRECTION_BITS)
            } else {
                value << (DIRECTION_BITS - bits)
            }
        };
        Some(Self {
            x: scale(x) as i32,
            y: scale(y) as i32,
        })
    }

    /// Product with a vector: its distance times [`Self::norm`] at most.
    fn dot(self, (x, y): (i64, i64)) -> i64 {
        i64::from(self.x) * x + i64::from(self.y) * y
    }

    /// An upper bound of the length, at most an eighth above it: (M + m/2)² ≥ M² + m² for m ≤ M.
    fn norm(self) -> i64 {
        let (x, y) = (self.x.unsigned_abs(), self.y.unsigned_abs());
        i64::from(x.max(y)) + i64::from(x.min(y).div_ceil(2))
    }
}

/// The half-plane, of those tried, whose border is farthest from the nodes of `corners` in the middle of `part`; none
/// where 0 is in their hull, or too near it for a direction's digits.
pub(super) fn find(corners: &[Expansion; 4], part: Part) -> Option<HalfPlane> {
    let t = part.middle();
    let middles = corners.map(|corner| (value(&corner.real, t), value(&corner.imaginary, t)));
    let (direction, middle) = best_direction(&middles)?;
    let bounds = corners
        .iter()
        .map(|corner| lower_bound(corner, direction, part));
    let lowest = bounds.min().unwrap_or(0).max(0);
    Some(HalfPlane {
        direction,
        distance: (lowest << DIRECTION_BITS) / direction.norm(),
        middle,
    })
}

/// The direction with the largest distance from 0 of its line before all points, with that distance. The nearest point
/// to 0 of their hull is one of them, or lies on a line between two.
fn best_direction(points: &[(i64, i64); 4]) -> Option<(Direction, i64)> {
    let mut best = None::<(Direction, i64)>;
    let mut try_one = |direction: Direction| {
        let dots = points.iter().map(|&point| direction.dot(point));
        let least = dots.min().unwrap_or(0);
        if least > 0 {
            let distance = least / direction.norm();
            if best.is_none_or(|(_, most)| distance > most) {
                best = Some((direction, distance));
            }
        }
    };
    for (index, &point) in points.iter().enumerate() {
        if let Some(direction) = Direction::of(point) {
            try_one(direction);
        }
        for &other in &points[index + 1..] {
            let along = (other.0 - point.0, other.1 - point.1);
            let Some(Direction { x, y }) = Direction::of((-along.1, along.0)) else {
                continue;
            };
            let across = Direction { x, y };
            if across.dot(point) > 0 {
                try_one(across);
            } else {
                try_one(Direction { x: -x, y: -y });
            }
        }
    }
    best
}

/// Value of a polynomial at `t`.
fn value(terms: &[i64; TERMS], t: i32) -> i64 {
    let sum = |sum: i64, &term: &i64| scaled(sum, t, T_BITS) + term;
    terms.iter().rev().fold(0, sum)
}

/// A lower bound of the projection on `direction` over the part, in steps of 2¹⁷ / |direction| units.
fn lower_bound(corner: &Expansion, direction: Direction, part: Part) -> i64 {
    let mut terms = [0; TERMS];
    for (term, (&x, &y)) in terms
        .iter_mut()
        .zip(corner.real.iter().zip(&corner.imaginary))
    {
        *term = direction.dot((x, y)) >> DIRECTION_BITS;
    }
    if part.depth > 0 {
        move_to(&mut terms, part.middle());
    }
    let mut bound = terms[0];
    for (power, term) in (1u32..).zip(&terms[1..]) {
        let shift = (power * part.depth).min(63);
        bound -= (term.abs() >> shift) + 1;
    }
    bound
}

/// Makes the polynomial in t one in t - `t0`, by repeated synthetic division.
fn move_to(terms: &mut [i64; TERMS], t0: i32) {
    for first in 0..TERMS - 1 {
        for index in (first..TERMS - 1).rev() {
            terms[index] += scaled(terms[index + 1], t0, T_BITS);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn parts_follow_one_another_without_a_gap() {
        let mut part = Part { depth: 5, place: 0 };
        let mut end = -1.0;
        loop {
            let (middle, half) = (
                f64::from(part.middle()) / 1_073_741_824.0,
                libm::exp2(-f64::from(part.depth)),
            );
            assert!((middle - half - end).abs() < 1e-12);
            end = middle + half;
            let Some(next) = part.next() else { break };
            // Halved here and there.
            part = if next.place % 3 == 1 {
                next.halved().unwrap_or(next)
            } else {
                next
            };
        }
        assert!((end - 1.0).abs() < 1e-12);
    }

    fn expansion() -> impl Strategy<Value = Expansion> {
        // Terms as they can be: below S x^m / m!.
        let terms = || {
            prop::array::uniform14(-1.0f64..1.0).prop_map(|shares| {
                let mut most = 3.0 * libm::exp2(41.0);
                let mut terms = [0; TERMS];
                for (power, (term, share)) in terms.iter_mut().zip(shares).enumerate() {
                    *term = (share * most) as i64;
                    most *= 1.227_2 / (power + 1) as f64;
                }
                terms
            })
        };
        (terms(), terms()).prop_map(|(real, imaginary)| Expansion { real, imaginary })
    }

    proptest! {
        #[test]
        fn a_bound_holds_on_its_whole_part(
            corners in prop::array::uniform4(expansion()), depth in 0u32..=MAX_DEPTH, place: u32, at in -1.0f64..=1.0,
        ) {
            let part = Part { depth, place: place & ((1 << depth) - 1) };
            if let Some(HalfPlane { direction, distance, .. }) = find(&corners, part) {
                let t = f64::from(part.middle()) / 1_073_741_824.0 + at * libm::exp2(-f64::from(depth));
                let length = libm::hypot(f64::from(direction.x), f64::from(direction.y));
                prop_assert!((131_072.0..=371_000.0).contains(&length));
                for corner in &corners {
                    let value = |terms: &[i64; TERMS]| terms.iter().rev().fold(0.0, |sum, &b| sum * t + b as f64);
                    let (x, y) = (value(&corner.real), value(&corner.imaginary));
                    let along = (x * f64::from(direction.x) + y * f64::from(direction.y)) / length;
                    prop_assert!(distance == 0 || along >= distance as f64 - 128.0);
                }
            }
        }

        /// The distance in the middle against that of the hull's points, sampled.
        #[test]
        fn the_best_direction_is_nearly_that_of_the_hull_s_nearest_point(
            points in prop::array::uniform4((-1i64 << 40..1 << 40, -1i64 << 40..1 << 40)),
        ) {
            let mut nearest = f64::INFINITY;
            for a in &points {
                for b in &points {
                    let (ax, ay, dx, dy) = (a.0 as f64, a.1 as f64, (b.0 - a.0) as f64, (b.1 - a.1) as f64);
                    let length = dx * dx + dy * dy;
                    let share = if length > 0.0 { (-(ax * dx + ay * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
                    nearest = nearest.min(libm::hypot(ax + share * dx, ay + share * dy));
                }
            }
            if let Some((_, distance)) = best_direction(&points) {
                prop_assert!(distance as f64 <= nearest * 1.000_01);
                prop_assert!(distance as f64 >= nearest * 0.88 - libm::exp2(26.0));
            }
        }
    }
}
