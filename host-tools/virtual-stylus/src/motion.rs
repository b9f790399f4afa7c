//! The motion of the tool over the surface, as the encoder's wheel sees it.

use serde::Deserialize;

use crate::{Error, Result};

const NANOS_PER_SECOND: f64 = 1e9;

/// A speed at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    at_ns: u64,
    /// Counts per second.
    speed: f64,
    /// Position of the wheel relative to the first knot, counts.
    position: f64,
}

/// The tool's speed over time, in counts of the encoder per second. It is linear between instants, and constant before
/// the first and after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    knots: Vec<Knot>,
}

/// A change of the encoder's count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Instant of the change, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// The count after the change.
    pub count: i64,
}

impl Motion {
    /// No motion.
    pub fn rest() -> Self {
        Self::steady(0.0, 1.0)
    }

    /// Moves at a constant `speed` in mm/s forever, with `mm_per_count`.
    pub fn steady(speed: f64, mm_per_count: f64) -> Self {
        Self {
            knots: vec![Knot {
                at_ns: 0,
                speed: speed / mm_per_count,
                position: 0.0,
            }],
        }
    }

    /// Moves at these `speeds`, in mm/s at instants in nanoseconds, with `mm_per_count`.
    ///
    /// # Errors
    /// There are no speeds, an instant is not after the previous instant, or a number is not finite.
    pub fn linear(speeds: &[(u64, f64)], mm_per_count: f64) -> Result<Self> {
        let ordered = speeds.windows(2).all(|pair| pair[0].0 < pair[1].0);
        let finite = speeds.iter().all(|(_, speed)| (speed / mm_per_count).is_finite());
        if speeds.is_empty() || !ordered || !finite {
            return Err(Error::Motion(
                "needs at least one speed, finite, at instants that rise".to_owned(),
            ));
        }
        let mut knots: Vec<Knot> = Vec::with_capacity(speeds.len());
        for &(at_ns, speed) in speeds {
            let speed = speed / mm_per_count;
            // The speed is linear between knots, so the mean of both is exact.
            let position = knots.last().map_or(0.0, |last| {
                last.position + f64::midpoint(last.speed, speed) * seconds(at_ns - last.at_ns)
            });
            knots.push(Knot { at_ns, speed, position });
        }
        Ok(Self { knots })
    }

    /// Position of the wheel at `at_ns`, in counts from its position at the first knot.
    pub fn position(&self, at_ns: u64) -> f64 {
        let (knot, acceleration, _) = self.segment(at_ns);
        let elapsed = (at_ns as f64 - knot.at_ns as f64) / NANOS_PER_SECOND;
        knot.position + knot.speed * elapsed + acceleration / 2.0 * elapsed * elapsed
    }

    /// The first edge after `after_ns`; `None` if the wheel never reaches another. The encoder's present `count` is the
    /// position plus `offset`, rounded down.
    pub fn next_edge(&self, after_ns: u64, count: i64, offset: f64) -> Option<Edge> {
        let mut from_ns = after_ns;
        loop {
            let (knot, acceleration, until_ns) = self.segment(from_ns);
            let elapsed = seconds(from_ns.saturating_sub(knot.at_ns));
            let speed = knot.speed + acceleration * elapsed;
            let position = self.position(from_ns) + offset;
            let up = reach((count + 1) as f64 - position, speed, acceleration);
            let down = reach(position - count as f64, -speed, -acceleration);
            let first = match (up, down) {
                (Some(up), Some(down)) if down < up => Some((down, count - 1)),
                (Some(up), _) => Some((up, count + 1)),
                (None, Some(down)) => Some((down, count - 1)),
                (None, None) => None,
            };
            if let Some((after, count)) = first {
                let at_ns = from_ns as f64 + (after * NANOS_PER_SECOND).ceil();
                if until_ns.is_none_or(|until| at_ns <= until as f64) {
                    // Rounding may give the present instant again, at which the caller asks for the next edge.
                    let at_ns = (at_ns as u64).max(after_ns + 1);
                    return Some(Edge { at_ns, count });
                }
            }
            from_ns = until_ns?;
        }
    }

    /// The knot from which the motion at `at_ns` is computed, the acceleration after the knot, and the end of the
    /// segment.
    fn segment(&self, at_ns: u64) -> (Knot, f64, Option<u64>) {
        let next = self.knots.partition_point(|knot| knot.at_ns <= at_ns);
        let Some(last) = next.checked_sub(1) else {
            return (self.knots[0], 0.0, Some(self.knots[0].at_ns));
        };
        let knot = self.knots[last];
        self.knots.get(next).map_or((knot, 0.0, None), |after| {
            let acceleration = (after.speed - knot.speed) / seconds(after.at_ns - knot.at_ns);
            (knot, acceleration, Some(after.at_ns))
        })
    }
}

fn seconds(nanos: u64) -> f64 {
    nanos as f64 / NANOS_PER_SECOND
}

/// The first non-negative time, s, at which a point with `speed` and `acceleration` passes `distance` while it moves
/// forward.
fn reach(distance: f64, speed: f64, acceleration: f64) -> Option<f64> {
    let forward = |after: f64| speed + acceleration * after > 0.0;
    // Edges are at whole nanoseconds, so the point may be a little beyond the place already.
    if distance <= 0.0 && (forward(0.0) || (speed == 0.0 && acceleration > 0.0)) {
        return Some(0.0);
    }
    let half = acceleration / 2.0;
    let roots = if half == 0.0 {
        [distance / speed, f64::NAN]
    } else {
        let root = (speed * speed + 4.0 * half * distance).sqrt();
        // This form of the solution does not subtract two nearly equal numbers.
        let sum = -0.5 * (speed + if speed < 0.0 { -root } else { root });
        [sum / half, -distance / sum]
    };
    roots
        .into_iter()
        .filter(|&after| after.is_finite() && after >= 0.0 && forward(after))
        .reduce(f64::min)
}

/// A line of a motion file, in the format that the product reads.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct MotionLine {
    /// Seconds.
    pub time_s: f64,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, newtons.
    pub force_n: f64,
}

/// Reads a motion file: `time_s,speed_mm_s,force_n`. Lines that start with `#` are skipped.
pub fn read_csv(path: &std::path::Path) -> Result<Vec<MotionLine>> {
    let told = |error: csv::Error| Error::Motion(format!("{}: {error}", path.display()));
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(told)?;
    reader
        .deserialize()
        .collect::<std::result::Result<_, _>>()
        .map_err(told)
}
