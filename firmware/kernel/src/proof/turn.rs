//! The turn of a value around 0, from half-planes that it passes through.

use super::half_plane::Direction;

/// Quarter turns of the direction so far, counted from the positive real axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    last: Option<Direction>,
    quarters: i32,
}

impl Turn {
    /// A turn that has not begun.
    pub const START: Self = Self {
        last: None,
        quarters: 0,
    };

    /// Adds the half-plane of the next interval, which shares a value with the last one. The first holds a value that
    /// is real.
    ///
    /// Returns false if that first value is negative.
    pub fn add(&mut self, direction: Direction) -> bool {
        match self.last.replace(direction) {
            // Less than a quarter turn from a positive number, on either side.
            None if direction.x > 0 => self.quarters = -i32::from(direction.y < 0),
            None => return false,
            Some(last) => self.quarters += quarters_between(last, direction),
        }
        true
    }

    /// Returns whether the value, if it ends on the real axis, has made `half_turns` half-turns: the last direction is
    /// within a quarter turn of there.
    pub fn is(&self, half_turns: usize) -> bool {
        let end = 2 * half_turns as i32;
        self.last.is_some() && (end - 1..=end).contains(&self.quarters)
    }
}

/// Number of multiples of a quarter turn that are passed from one direction to another, less than half a turn away.
fn quarters_between(from: Direction, to: Direction) -> i32 {
    match (quadrant(to) - quadrant(from)).rem_euclid(4) {
        0 => 0,
        1 => 1,
        3 => -1,
        // Two, to the side on which the other direction lies.
        _ => {
            let cross = i64::from(from.x) * i64::from(to.y) - i64::from(from.y) * i64::from(to.x);
            if cross > 0 { 2 } else { -2 }
        }
    }
}

/// Angle in whole quarter turns, rounded down.
fn quadrant(Direction { x, y }: Direction) -> i32 {
    match (x > 0, y > 0) {
        _ if x > 0 && y >= 0 => 0,
        (false, true) => 1,
        _ if x < 0 => 2,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(angle: f64) -> Direction {
        Direction {
            x: (libm::cos(angle) * 200_000.0) as i32,
            y: (libm::sin(angle) * 200_000.0) as i32,
        }
    }

    proptest! {
        #[test]
        fn half_turns_are_counted_over_any_steps_below_half_a_turn(
            steps in prop::collection::vec(-3.1f64..3.1, 0..60), begin in -1.5f64..1.5, end in -1.5f64..1.5,
        ) {
            let mut turn = Turn::START;
            let mut angle = begin;
            prop_assert!(turn.add(at(angle)));
            for step in steps {
                angle += step;
                turn.add(at(angle));
            }
            // On to the real axis, near which the last direction is.
            let half_turns = (angle / core::f64::consts::PI).round();
            let target = half_turns * core::f64::consts::PI + end;
            turn.add(at(target));
            for other in -3..=3 {
                let guess = half_turns as i64 + other;
                if let Ok(guess) = usize::try_from(guess) {
                    prop_assert_eq!(turn.is(guess), other == 0);
                }
            }
        }

        #[test]
        fn quadrants_are_rounded_down(x in -3i32..=3, y in -3i32..=3) {
            prop_assume!((x, y) != (0, 0));
            let angle = libm::atan2(f64::from(y), f64::from(x)).rem_euclid(core::f64::consts::TAU);
            let expected = libm::floor(angle / core::f64::consts::FRAC_PI_2 + 1e-9) as i32 % 4;
            prop_assert_eq!(quadrant(Direction { x, y }), expected);
        }
    }

    #[test]
    fn a_negative_first_value_is_told() {
        assert!(!Turn::START.clone().add(at(3.0)));
        assert!(!Turn::START.is(0));
    }
}
