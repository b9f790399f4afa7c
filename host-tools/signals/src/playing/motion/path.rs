//! A motion as a function of time.

use std::path::Path;

use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::Motion;
use stylus_kernel::position::Position;
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction};
use stylus_support::number::{force_fault, position_fault, speed_fault};
use stylus_support::{Error, Result};

/// Largest number of rows of a motion: a day at 100 per second, in about 300 MB.
const MOST_ROWS: usize = 10_000_000;

/// Longest duration, s, at which the times of a motion are not doubted.
const LONGEST_S: f64 = 600.0;

/// Largest mean step between rows, s, of a motion that was sampled from a hand.
const LONGEST_STEP_S: f64 = 0.1;

/// Least number of rows for which the steps are judged, because a short table may be written by hand.
const FEWEST_ROWS: usize = 10;

/// Duration, s, and length of the path, m, above which a motion with large steps is doubted.
const LONG_S: f64 = 60.0;
const LONG_M: f64 = 5.0;

/// One moment of a motion that comes from a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionRow {
    /// Time, s, at least zero and above the time of the previous row.
    pub time_s: f64,
    /// Tangential speed, mm/s; the sign is the direction.
    pub speed_mm_s: f64,
    /// Normal force, N; at or below zero there is no contact.
    pub force_n: f64,
    /// Position on the path, mm. If the first row has none, the position is the integral of the speed.
    pub position_mm: Option<f64>,
    /// Contact with the surface. If the first row has none, contact follows from the force.
    pub contact: Option<bool>,
}

/// A speed and a force at every moment from 0 s on, optionally with position and contact.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPath {
    /// The rows, at least one, in ascending order of time.
    points: Vec<Point>,
    /// True if the rows give the position; otherwise it is the integral of the speed.
    tells_position: bool,
    /// True if the rows give contact; otherwise contact follows from the force.
    tells_contact: bool,
    /// Time of the first row by the clock of its file, s; zero if that is the motion's.
    clock_s: f64,
}

impl MotionPath {
    /// Returns a motion of constant speed, mm/s, and force, N, without end.
    pub fn constant(speed: MillimetresPerSecond, force: Newton) -> Result<Self> {
        Motion::new(speed, force)
            .map_err(|error| Error::Request(format!("{error}: give the speed in mm/s and the force in N")))?;
        let point = Point {
            time_s: 0.0,
            speed_mm_s: speed.0,
            force_n: force.0,
            position_mm: 0.0,
            contact: false,
        };
        Ok(Self {
            points: vec![point],
            tells_position: false,
            tells_contact: false,
            clock_s: 0.0,
        })
    }

    /// Returns a motion of `rows`, which have the same content as the rows of a table.
    ///
    /// # Errors
    /// There are no rows. Or, with the number of the row from 1: a value that no hand reaches or that is not a finite
    /// number; a time that is negative or does not rise; a position or contact that is missing although the first row
    /// has it, or vice versa; or more than ten million rows.
    pub fn from_rows(rows: impl IntoIterator<Item = MotionRow>) -> Result<Self> {
        let mut found: Option<Points> = None;
        for (index, row) in rows.into_iter().enumerate() {
            let tells = (row.position_mm.is_some(), row.contact.is_some());
            // The first row decides what all rows give.
            let points = found.get_or_insert_with(|| Points::new(tells.0, tells.1));
            let pushed = if tells == (points.tells_position, points.tells_contact) {
                checked(&row).and_then(|point| points.push(point))
            } else {
                Err("give position_mm, and contact, in every row or in none".to_owned())
            };
            pushed.map_err(|problem| Error::Request(format!("motion, row {}: {problem}", index + 1)))?;
        }
        let no_rows = || Error::Request("a motion needs at least one row".to_owned());
        Ok(Self::of(found.ok_or_else(no_rows)?))
    }

    pub(super) fn of(points: Points) -> Self {
        Self {
            tells_position: points.tells_position,
            tells_contact: points.tells_contact,
            clock_s: points.clock_s,
            points: points.rows,
        }
    }

    /// Returns the motion at `time_s`, linearly interpolated between rows. Before the first and after the last row, its
    /// values are held.
    ///
    /// A speed that changes its sign passes through zero, like the speed of a hand that reverses.
    pub fn at(&self, time_s: f64) -> Motion {
        let (speed, force) = self.values_at(time_s);
        Motion::new(speed, force).expect("values between finite ones are finite")
    }

    /// Returns the signed speed and the force at `time_s`, interpolated like in [`MotionPath::at`]; both are finite.
    pub fn values_at(&self, time_s: f64) -> (MillimetresPerSecond, Newton) {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        let (speed_mm_s, force_n) = match (after.checked_sub(1), self.points.get(after)) {
            (Some(before), Some(next)) => {
                let before = &self.points[before];
                let fraction = (time_s - before.time_s) / (next.time_s - before.time_s);
                (
                    interpolate(before.speed_mm_s, next.speed_mm_s, fraction),
                    interpolate(before.force_n, next.force_n, fraction),
                )
            }
            (None, Some(point)) => (point.speed_mm_s, point.force_n),
            (_, None) => {
                let last = self.points.last().expect("a path has at least one point");
                (last.speed_mm_s, last.force_n)
            }
        };
        (MillimetresPerSecond(speed_mm_s), Newton(force_n))
    }

    /// Returns the position on the path at `time_s`, in mm.
    ///
    /// A position given by the rows is interpolated linearly between rows, and held at both ends. If the rows give
    /// none, the position is the integral of the speed of [`MotionPath::values_at`], from 0 mm at 0 s.
    pub fn position_mm_at(&self, time_s: f64) -> f64 {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        let first = &self.points[0];
        let Some(before) = after.checked_sub(1).map(|before| &self.points[before]) else {
            return if self.tells_position {
                first.position_mm
            } else {
                // From 0 s to the first row, its speed is held.
                f64::from(first.speed_mm_s) * time_s
            };
        };
        match self.points.get(after) {
            Some(next) if self.tells_position => {
                let fraction = (time_s - before.time_s) / (next.time_s - before.time_s);
                before.position_mm + (next.position_mm - before.position_mm) * fraction
            }
            Some(next) => before.position_mm + before.path_mm(next, time_s),
            None if self.tells_position => before.position_mm,
            None => before.position_mm + f64::from(before.speed_mm_s) * (time_s - before.time_s),
        }
    }

    /// Returns the contact of the last row up to `time_s`, or of the first row before it; `None` if the rows do not
    /// give contact.
    pub fn contact_at(&self, time_s: f64) -> Option<bool> {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        self.tells_contact.then(|| self.points[after.saturating_sub(1)].contact)
    }

    /// Returns the time of the last row of the motion that was read from `file`, in s.
    ///
    /// # Errors
    /// The motion is one row at 0 s, which has no end.
    pub fn end_s(&self, file: &Path) -> Result<f64> {
        let end_s = self.duration_s();
        if end_s > 0.0 {
            return Ok(end_s);
        }
        let problem = "holds one row, at 0 s: a motion that does not change has no end; give --seconds, or a last row";
        Err(Error::file(file, problem))
    }

    /// Returns true if at some moment the speed is not zero and the force is above zero, so that a texture is audible.
    pub fn sounds(&self) -> bool {
        let moves = |point: &Point| point.speed_mm_s != 0.0;
        let presses = |point: &Point| point.force_n > 0.0;
        let any = |row: &[Point]| row.iter().any(moves) && row.iter().any(presses);
        // Before the first row, its values are held. A motion of one row has no pair.
        any(&self.points[..1]) || self.points.windows(2).any(any)
    }

    /// Returns the largest magnitude of the speed, mm/s, and the largest force, N.
    pub fn largest(&self) -> (f64, f64) {
        self.points
            .iter()
            .fold((0.0, 0.0), |(speed, force): (f64, f64), point| {
                let own = (f64::from(point.speed_mm_s).abs(), f64::from(point.force_n));
                (speed.max(own.0), force.max(own.1))
            })
    }

    /// Returns what was taken about the times, and a doubt, with the remedy, if they are unlikely to be those of a hand
    /// in seconds. This is so if the motion lasts longer than ten minutes, or if its rows are far apart and it either
    /// lasts longer than a minute or has a path of more than 5 m.
    pub fn doubt_of_times(&self) -> Option<String> {
        let duration_s = self.duration_s();
        let steps = self.points.windows(2);
        let path_m = 1e-3 * steps.map(|pair| pair[0].distance_mm(&pair[1])).sum::<f64>();
        let rows = self.points.len();
        // A motion of one row has no step.
        let step_s = (duration_s - self.points[0].time_s) / (rows.max(2) - 1) as f64;
        let is_sparse = rows >= FEWEST_ROWS && step_s > LONGEST_STEP_S;
        let is_far = duration_s > LONG_S || path_m > LONG_M;
        let is_long = duration_s > LONGEST_S || (is_sparse && is_far);
        [
            (self.clock_s > 0.0).then(|| {
                let clock_s = self.clock_s;
                format!("the motion begins at {clock_s} s of its clock, and is taken to begin at 0 s")
            }),
            is_long.then(|| {
                format!(
                    "the motion takes {duration_s:.0} s in steps of {step_s:.2} s and leads over {path_m:.1} m: time_s \
                     is in seconds; divide milliseconds by 1000"
                )
            }),
        ]
        .into_iter()
        .flatten()
        .reduce(|one, other| format!("{one}; {other}"))
    }

    /// Returns the time of the last row, in s; zero for a constant motion.
    pub fn duration_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.time_s)
    }
}

/// Returns the point of `row`.
///
/// # Errors
/// What is wrong with a value, in words.
fn checked(row: &MotionRow) -> std::result::Result<Point, String> {
    let position_mm = row.position_mm.unwrap_or(0.0);
    let faults = [
        ("speed_mm_s", speed_fault(row.speed_mm_s)),
        ("force_n", force_fault(row.force_n)),
        ("position_mm", position_fault(position_mm)),
    ];
    for (name, fault) in faults {
        if let Some(fault) = fault {
            return Err(format!("{name} is {fault}"));
        }
    }
    Ok(Point {
        time_s: row.time_s,
        speed_mm_s: row.speed_mm_s as f32,
        force_n: row.force_n as f32,
        // Single precision, like the values of a table.
        position_mm: f64::from(position_mm as f32),
        contact: row.contact.unwrap_or(false),
    })
}

/// The rows of a motion so far.
pub(super) struct Points {
    /// The rows, in ascending order of time.
    pub rows: Vec<Point>,
    /// True if the rows give the position; otherwise it is the integral of the speed.
    pub tells_position: bool,
    /// True if the rows give contact; otherwise it follows from the force.
    pub tells_contact: bool,
    /// Time of the first row by the clock of its file, s; zero if that is the motion's.
    pub clock_s: f64,
}

impl Points {
    /// Creates an empty list of rows.
    pub fn new(tells_position: bool, tells_contact: bool) -> Self {
        Self {
            rows: Vec::new(),
            tells_position,
            tells_contact,
            clock_s: 0.0,
        }
    }

    /// Adds a row. If the rows give no position, its position is the integral of the speed.
    ///
    /// # Errors
    /// In words: the time is negative, not finite, or not above the last time; or there are too many rows.
    pub fn push(&mut self, mut point: Point) -> std::result::Result<(), String> {
        let time_s = point.time_s;
        if !time_s.is_finite() || time_s < 0.0 {
            return Err(format!("time_s is {time_s}: a motion begins at 0 s or later"));
        }
        if let Some(before) = self.rows.last()
            && time_s <= before.time_s
        {
            return Err(format!(
                "time_s is {time_s} after {}: times must rise from row to row",
                before.time_s
            ));
        }
        if self.rows.len() == MOST_ROWS {
            return Err(format!(
                "more than {MOST_ROWS} rows: give fewer per second, or a shorter motion"
            ));
        }
        if !self.tells_position {
            point.position_mm = self.rows.last().map_or(f64::from(point.speed_mm_s) * time_s, |before| {
                before.position_mm + before.path_mm(&point, time_s)
            });
        }
        self.rows.push(point);
        Ok(())
    }
}

/// A motion at one moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub time_s: f64,
    /// Tangential speed, mm/s; the sign is the direction along the surface.
    pub speed_mm_s: f32,
    pub force_n: f32,
    /// Position given by the row, or the integral of the speed, mm.
    pub position_mm: f64,
    pub contact: bool,
}

impl Point {
    /// Returns the distance from here to `next`, regardless of direction, in mm, computed from the mean of both speeds.
    fn distance_mm(&self, next: &Self) -> f64 {
        let speeds = f64::from(self.speed_mm_s).abs() + f64::from(next.speed_mm_s).abs();
        0.5 * speeds * (next.time_s - self.time_s)
    }

    /// Returns the signed path from here until `time_s`, which is at most the time of `next`, in mm: the integral of a
    /// linear speed.
    pub(super) fn path_mm(&self, next: &Self, time_s: f64) -> f64 {
        let (from, to) = (f64::from(self.speed_mm_s), f64::from(next.speed_mm_s));
        let elapsed_s = time_s - self.time_s;
        let reached = from + (to - from) * elapsed_s / (next.time_s - self.time_s);
        0.5 * (from + reached) * elapsed_s
    }
}

/// Interpolates between `from`, at a fraction of 0, and `to`, at 1. Double precision can represent the difference of
/// two `f32` values accurately enough.
pub(super) fn interpolate(from: f32, to: f32, fraction: f64) -> f32 {
    let (from, to) = (f64::from(from), f64::from(to));
    (from + (to - from) * fraction) as f32
}

/// A hand that follows a motion, with position and contact in addition to speed and force.
///
/// If the motion does not give contact, it follows from the force, with the threshold [`ContactThreshold::LEAST`]. A
/// stylus derives its own threshold from the noise of its converter, which the forces of a file do not have.
#[derive(Clone, Debug)]
pub struct Hand<'a> {
    motion: &'a MotionPath,
    detector: ContactDetector,
}

impl<'a> Hand<'a> {
    /// Creates a hand on `motion`, without contact so far.
    pub fn new(motion: &'a MotionPath) -> Self {
        Self {
            motion,
            detector: ContactDetector::new(),
        }
    }

    /// Returns the interaction at `time_s`. Times must ascend from call to call, because contact is detected from the
    /// history of the force if the motion does not give it.
    pub fn at(&mut self, time_s: f64) -> Interaction {
        let motion = self.motion.at(time_s);
        // The detector sees every update, because it decides from the history of the force.
        let touches = self.detector.touches(motion, ContactThreshold::LEAST);
        let contact = self.motion.contact_at(time_s).unwrap_or(touches);
        // The integral of a long motion may exceed single precision, and an infinite position is refused.
        let farthest = f64::from(f32::MAX);
        let position_mm = self.motion.position_mm_at(time_s).clamp(-farthest, farthest);
        Interaction::new(motion, position_mm as f32, contact).expect("a position within finite bounds is finite")
    }

    /// Returns the interaction of [`Hand::at`] for the block that is computed at `time_s` and whose last sample is
    /// `block_s` later. Lines that are tied to position also receive the position at that sample, because the motion is
    /// known in advance.
    pub fn for_block(&mut self, time_s: f64, block_s: f64) -> Interaction {
        let end_mm = self.motion.position_mm_at(time_s + block_s);
        let position = Position::from_exact_mm(end_mm);
        self.at(time_s).reaching(Some(position))
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::path_of as read;
    use super::*;
    use test_helpers::{holds, near};

    fn motion(speed_mm_s: f32, force_n: f32) -> Motion {
        Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).unwrap()
    }

    #[test]
    fn rows_are_interpolated_and_held_at_both_ends() {
        let path = read("time_s,speed_mm_s,force_n\n1,100,0.5\n2,200,1\n4,0,0\n").unwrap();
        assert_eq!(path.at(0.0), motion(100.0, 0.5));
        assert_eq!(path.at(1.0), motion(100.0, 0.5));
        assert_eq!(path.at(1.25), motion(125.0, 0.625));
        assert_eq!(path.at(2.0), motion(200.0, 1.0));
        assert_eq!(path.at(3.0), motion(100.0, 0.5));
        assert_eq!(path.at(1e9), motion(0.0, 0.0));
        near(path.duration_s(), 4.0, f64::EPSILON);
    }

    #[test]
    fn rows_of_a_program_are_those_of_a_table() {
        let row = |time_s, speed_mm_s, force_n, position_mm, contact| MotionRow {
            time_s,
            speed_mm_s,
            force_n,
            position_mm,
            contact,
        };
        let rows = [row(0.5, 100.0, 0.5, None, None), row(2.0, -20.1, 1.3, None, None)];
        let table = read("time_s,speed_mm_s,force_n\n0.5,100,0.5\n2,-20.1,1.3\n").unwrap();
        assert_eq!(MotionPath::from_rows(rows).unwrap(), table);
        let rows = [
            row(0.0, 100.0, 0.5, Some(7.3), Some(true)),
            row(2.0, 20.0, 1.0, Some(-1.0), Some(false)),
        ];
        let table = "time_s,speed_mm_s,force_n,position_mm,contact\n0,100,0.5,7.3,1\n2,20,1,-1,0\n";
        assert_eq!(MotionPath::from_rows(rows).unwrap(), read(table).unwrap());
        let refused = [
            (vec![], "at least one row"),
            (vec![row(-1.0, 1.0, 1.0, None, None)], "row 1: time_s"),
            (vec![row(f64::NAN, 1.0, 1.0, None, None)], "row 1: time_s"),
            (vec![row(0.0, f64::NAN, 1.0, None, None)], "speed_mm_s"),
            (vec![row(0.0, 1.0, 1e4, None, None)], "force_n"),
            (vec![row(0.0, 1.0, 1.0, Some(1e39), None)], "position_mm"),
            (vec![rows[0], row(0.0, 1.0, 1.0, None, None)], "row 2"),
            (vec![rows[0], rows[0]], "times must rise"),
        ];
        for (rows, word) in refused {
            holds(&MotionPath::from_rows(rows).unwrap_err(), &[word]);
        }
    }

    #[test]
    fn a_hand_that_turns_round_comes_to_rest_between() {
        let path = read("time_s,speed_mm_s,force_n\n0,-100,1\n1,100,1\n").unwrap();
        assert_eq!(path.at(0.0), motion(100.0, 1.0));
        assert_eq!(path.at(0.5), motion(0.0, 1.0));
    }

    #[test]
    fn times_in_milliseconds_are_doubted_and_those_of_a_hand_are_not() {
        let motion = |rows: usize, step: f64, speed: f64| {
            let row = |index: usize| format!("{},{speed},1\n", index as f64 * step);
            let rows: String = (0..rows).map(row).collect();
            read(&format!("time_s,speed_mm_s,force_n\n{rows}")).unwrap()
        };
        for (rows, step, speed) in [(100, 10.0, 100.0), (100, 1.0, 20.0), (55, 1.0, 200.0), (2, 700.0, 0.0)] {
            let doubt = motion(rows, step, speed).doubt_of_times();
            holds(
                &doubt.unwrap(),
                &["time_s is in seconds", "divide milliseconds by 1000"],
            );
        }
        // A minute and a half of rubbing, rows written by hand, a constant motion, and half a second at 1 kHz.
        for (rows, step, speed) in [
            (9_000, 0.01, 100.0),
            (6, 20.0, 100.0),
            (2, 300.0, 100.0),
            (500, 1e-3, 300.0),
        ] {
            assert_eq!(motion(rows, step, speed).doubt_of_times(), None);
        }
        let constant = MotionPath::constant(MillimetresPerSecond(80.0), Newton(0.6)).unwrap();
        assert_eq!(constant.doubt_of_times(), None);
    }

    #[test]
    fn a_constant_motion_lasts() {
        let path = MotionPath::constant(MillimetresPerSecond(-80.0), Newton(0.6)).unwrap();
        for time_s in [0.0, 1.0, 1e6] {
            assert_eq!(path.at(time_s), motion(80.0, 0.6));
        }
        assert!(path.duration_s().abs() < f64::EPSILON);
        assert!(MotionPath::constant(MillimetresPerSecond(f32::NAN), Newton(0.6)).is_err());
        assert!(MotionPath::constant(MillimetresPerSecond(1.0), Newton(f32::INFINITY)).is_err());
    }

    #[test]
    fn the_path_is_the_integral_of_the_speed_unless_the_file_tells_it() {
        let path = read("time_s,speed_mm_s,force_n\n1,100,1\n2,200,1\n4,-200,1\n").unwrap();
        for (time_s, position_mm) in [
            (0.0, 0.0),
            (0.5, 50.0),
            (1.0, 100.0),
            (1.5, 162.5),
            (2.0, 250.0),
            (3.0, 350.0),
            (4.0, 250.0),
            (5.0, 50.0),
        ] {
            near(path.position_mm_at(time_s), position_mm, 1e-9);
        }
        let told = read("time_s,position_mm,speed_mm_s,force_n\n1,-5,0,1\n3,7,0,1\n").unwrap();
        for (time_s, position_mm) in [(0.0, -5.0), (1.0, -5.0), (2.0, 1.0), (9.0, 7.0)] {
            near(told.position_mm_at(time_s), position_mm, 1e-9);
        }
        let constant = MotionPath::constant(MillimetresPerSecond(-80.0), Newton(0.6)).unwrap();
        assert!((constant.position_mm_at(2.0) + 160.0).abs() < 1e-9);
    }

    #[test]
    fn contact_is_what_the_last_row_told_and_nothing_else() {
        let path = read("time_s,contact,speed_mm_s,force_n\n1,0,9,1\n2,1,9,0\n3,0,9,1\n").unwrap();
        let told: Vec<Option<bool>> = [0.5, 1.5, 2.0, 2.9, 3.0, 9.0]
            .map(|time_s| path.contact_at(time_s))
            .into();
        let expected = [false, false, true, true, false, false].map(Some);
        assert_eq!(told, expected);
        let without = read("time_s,speed_mm_s,force_n\n1,9,1\n").unwrap();
        assert_eq!(without.contact_at(1.0), None);
        let error = read("time_s,contact,speed_mm_s,force_n\n1,yes,9,1\n").unwrap_err();
        assert!(error.to_string().contains("contact is 'yes'"), "{error}");
    }
}
