//! Position of the tool along its path, exact over kilometres, and its movement from block to block.
//!
//! A position has 64 bits in steps of 2⁻³² mm, so that the phase of the finest line is exact to 10⁻⁵ of a turn within
//! 50 m of the origin, and is the same forwards and backwards anywhere. It wraps after 4295 km.
//!
//! The position is given for the **last sample of a block**, see [`Track`]. A caller that does not know the future must
//! predict it from the speed, because a position that is late by a block makes a surface lag behind the hand.

/// A position along the path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Position(pub(crate) i64);

impl Position {
    /// Binary digits after the point of a position in mm.
    pub const FRACTION_BITS: u32 = 32;

    /// The path's origin.
    pub const ORIGIN: Self = Self(0);

    /// The position `mm` from the origin. Beyond 2147 km it is the last one that exists; NaN is the origin.
    pub fn from_mm(mm: f32) -> Self {
        // A power of two scales a float exactly.
        Self((mm * (1u64 << Self::FRACTION_BITS) as f32) as i64)
    }

    /// Like [`Position::from_mm`], with the digits that a long path needs.
    pub fn from_exact_mm(mm: f64) -> Self {
        Self((mm * (1u64 << Self::FRACTION_BITS) as f64) as i64)
    }

    /// Distance from the origin in steps of 2⁻³² mm.
    pub const fn steps(self) -> i64 {
        self.0
    }

    /// The position `steps` farther.
    #[must_use]
    pub const fn ahead(self, steps: i64) -> Self {
        Self(self.0.wrapping_add(steps))
    }

    /// Steps from `from` to this position, the short way around.
    pub const fn since(self, from: Self) -> i64 {
        self.0.wrapping_sub(from.0)
    }
}

/// Distance at `speed_mm_s` in `samples` samples, in steps of a [`Position`]. Speeds are limited to 1 km/s.
pub fn distance_steps(speed_mm_s: f32, samples: u32, sample_rate_hz: u32) -> i64 {
    /// Binary digits after the point of the speed. A speed has 24 digits, and is at most 2²⁰ mm/s.
    const SPEED_BITS: u32 = 20;
    const FASTEST_MM_S: f32 = 1.0e6;
    let speed = speed_mm_s.clamp(-FASTEST_MM_S, FASTEST_MM_S);
    let speed = (speed * (1u32 << SPEED_BITS) as f32) as i64;
    // Only more than 2000 samples at the fastest speed exceed 64 bits; saturated, they keep their direction.
    let distance = speed.saturating_mul(i64::from(samples));
    let distance = distance.saturating_mul(1 << (Position::FRACTION_BITS - SPEED_BITS));
    distance / i64::from(sample_rate_hz.max(1))
}

/// Movement of the tool in a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Passage {
    /// Position at the last sample of the previous block that was played.
    pub from: Position,
    /// Position at the block's last sample.
    pub to: Position,
    /// True if the speed does not explain the distance: the position given for the hand was elsewhere.
    pub jumps: bool,
}

/// Follower of the position, which is either given or the integral of the speed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Track {
    passage: Option<Passage>,
    samples: u32,
}

impl Track {
    /// A track that has not begun.
    pub const fn new() -> Self {
        Self {
            passage: None,
            samples: 0,
        }
    }

    /// Returns the movement in the next block, of `samples` samples, at `speed_mm_s`: to the position `told`, or else
    /// ahead by the speed. `left` is the number of samples of the previous block that are not played.
    ///
    /// A hand that accelerates moves up to twice the distance of its speed at the block's beginning, plus
    /// [`SLACK_STEPS`]. More than that is a jump.
    pub fn advance(
        &mut self,
        told: Option<Position>,
        speed_mm_s: f32,
        samples: u32,
        left: u32,
        sample_rate_hz: u32,
    ) -> Passage {
        let expected = distance_steps(speed_mm_s, samples, sample_rate_hz);
        let from = match self.passage {
            Some(before) => before.with_left(left, self.samples),
            // As if the tool had come at its speed, so that a line that is too fast is silent from the beginning.
            None => told.map_or(Position::ORIGIN, |told| told.ahead(-expected)),
        };
        let to = told.unwrap_or(from.ahead(expected));
        let explained = (2 * expected.unsigned_abs()).saturating_add(SLACK_STEPS);
        let passage = Passage {
            from,
            to,
            jumps: to.since(from).unsigned_abs() > explained,
        };
        (self.passage, self.samples) = (Some(passage), samples);
        passage
    }
}

/// Distance in a block that is allowed beyond twice the speed: 0.5 mm, because a speed from a host may lag.
pub const SLACK_STEPS: u64 = (1 << Position::FRACTION_BITS) / 2;

impl Passage {
    /// The position when `left` of `samples` samples remain.
    fn with_left(self, left: u32, samples: u32) -> Position {
        // Divided first, because a jump of kilometres times `left` would exceed 64 bits.
        let share = self.to.since(self.from) / i64::from(samples.max(1));
        self.to.ahead(share.wrapping_mul(-i64::from(left)))
    }
}
