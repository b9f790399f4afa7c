//! What a hand does over time, for a rendering: from a CSV file, or constant.
//!
//! ```text
//! # Comments begin with a number sign.
//! time_s,speed_mm_s,force_n
//! 0.0,0,0.5
//! 1.5,120,0.8
//! ```
//! Columns may stand in any order, and others beside them do not matter. A column `position_mm` tells the place on the path
//! instead of the integral of the speed from 0 mm on; a column `contact`, 0 or 1, tells whether the tool touches instead of
//! the force.

use std::path::Path;

use csv::{StringRecord, Trim};
use model_format::{MillimetresPerSecond, Newton};
use stylus_kernel::Motion;

use crate::support::error::{Error, Result};

/// A speed and a force at every moment from 0 s on.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPath {
    /// At least one, in ascending order of time.
    points: Vec<Point>,
    /// Whether the file told the place; else it is the integral of the speed.
    tells_position: bool,
    /// Whether the file told contact; else it follows from the force.
    tells_contact: bool,
}

/// What is known of one moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    time_s: f64,
    /// Of either sign: the direction along the surface.
    speed_mm_s: f32,
    force_n: f32,
    /// As the file tells it, or the integral of the speed.
    position_mm: f64,
    contact: bool,
}

impl MotionPath {
    /// The same speed, mm/s, and force, N, for ever.
    ///
    /// # Errors
    /// A speed or force that is not finite.
    pub fn constant(speed: MillimetresPerSecond, force: Newton) -> Result<Self> {
        Motion::new(speed, force).map_err(|error| {
            Error::Request(format!(
                "{error}: give the speed in mm/s and the force in N"
            ))
        })?;
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
        })
    }

    /// Reads a CSV file with the columns `time_s`, `speed_mm_s` and `force_n`, and `position_mm` and `contact` if there are
    /// such; see the module's beginning.
    ///
    /// Times begin at zero or later and rise from row to row.
    ///
    /// # Errors
    /// That the file cannot be read, a column that is missing, a file without rows, and, with its line, a row that is
    /// not of the header's length, a value that is not a finite number, and a time that does not rise.
    pub fn from_csv(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(Trim::All)
            .from_reader(text.as_bytes());
        let header = reader
            .headers()
            .map_err(|error| Error::file(path, error.to_string()))?;
        let columns = Columns::of(header, path)?;
        let mut points: Vec<Point> = Vec::new();
        let mut record = StringRecord::new();
        loop {
            let begin = reader.position().clone();
            let here = |problem: String| Error::line(path, line_of_record(&text, &begin), problem);
            match reader.read_record(&mut record) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => return Err(here(row_problem(&error))),
            }
            let mut point = columns.point(&record).map_err(here)?;
            if let Some(before) = points.last()
                && point.time_s <= before.time_s
            {
                let problem = format!(
                    "time_s is {} after {}: times must rise from row to row",
                    point.time_s, before.time_s
                );
                return Err(here(problem));
            }
            if columns.position.is_none() {
                point.position_mm = points
                    .last()
                    .map_or(f64::from(point.speed_mm_s) * point.time_s, |before| {
                        before.position_mm + before.path_mm(&point, point.time_s)
                    });
            }
            points.push(point);
        }
        if points.is_empty() {
            return Err(Error::file(
                path,
                "no rows: a motion needs at least one below its header",
            ));
        }
        Ok(Self {
            points,
            tells_position: columns.position.is_some(),
            tells_contact: columns.contact.is_some(),
        })
    }

    /// The motion at `time_s`, interpolated linearly between rows; before the first it is the first's, after the last the
    /// last's.
    ///
    /// A speed that changes its sign passes through rest, as a hand does that turns round.
    pub fn at(&self, time_s: f64) -> Motion {
        let (speed, force) = self.values_at(time_s);
        Motion::new(speed, force).expect("what lies between finite values is finite")
    }

    /// Speed, of either sign, and force at `time_s`, as [`MotionPath::at`] interpolates them; both finite.
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

    /// The place on the path at `time_s`, mm: what the file tells, linear between rows and held at both ends, or the integral
    /// of the speed as [`MotionPath::values_at`] interpolates it, from 0 mm at 0 s.
    pub fn position_mm_at(&self, time_s: f64) -> f64 {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        let first = &self.points[0];
        let Some(before) = after.checked_sub(1).map(|before| &self.points[before]) else {
            return if self.tells_position {
                first.position_mm
            } else {
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

    /// Whether the tool touches at `time_s`, if the file tells: what the last row up to then says.
    pub fn contact_at(&self, time_s: f64) -> Option<bool> {
        let after = self.points.partition_point(|point| point.time_s <= time_s);
        self.tells_contact
            .then(|| self.points[after.saturating_sub(1)].contact)
    }

    /// When the last row is, s; zero for a constant motion.
    pub fn duration_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.time_s)
    }
}

impl Point {
    /// The path from here until `time_s`, at most that of `next`, mm: the integral of a speed that changes evenly.
    fn path_mm(&self, next: &Self, time_s: f64) -> f64 {
        let (from, to) = (f64::from(self.speed_mm_s), f64::from(next.speed_mm_s));
        let elapsed_s = time_s - self.time_s;
        let reached = from + (to - from) * elapsed_s / (next.time_s - self.time_s);
        0.5 * (from + reached) * elapsed_s
    }
}

/// `from` at a fraction of 0, `to` at 1. In double precision no difference of two `f32` overflows.
fn interpolate(from: f32, to: f32, fraction: f64) -> f32 {
    let (from, to) = (f64::from(from), f64::from(to));
    (from + (to - from) * fraction) as f32
}

/// Where the columns are.
struct Columns {
    time: usize,
    speed: usize,
    force: usize,
    position: Option<usize>,
    contact: Option<usize>,
}

impl Columns {
    fn of(header: &StringRecord, path: &Path) -> Result<Self> {
        let optional = |name: &str| {
            let mut found = (0..header.len()).filter(|&index| &header[index] == name);
            match (found.next(), found.next()) {
                (index, None) => Ok(index),
                (_, Some(_)) => Err(Error::file(path, format!("more than one column '{name}'"))),
            }
        };
        let column = |name: &str| {
            optional(name)?.ok_or_else(|| {
                let names: Vec<&str> = header.iter().collect();
                let problem = format!(
                    "no column '{name}' in the header '{}': a motion has time_s, speed_mm_s and force_n",
                    names.join(",")
                );
                Error::file(path, problem)
            })
        };
        Ok(Self {
            time: column("time_s")?,
            speed: column("speed_mm_s")?,
            force: column("force_n")?,
            position: optional("position_mm")?,
            contact: optional("contact")?,
        })
    }

    fn point(&self, record: &StringRecord) -> std::result::Result<Point, String> {
        // What does not fit a single-precision number is not a motion; reading as one makes it infinite, and refused.
        let single = |index: usize, name: &str| {
            let value: Option<f32> = record[index].parse().ok();
            value
                .filter(|value| value.is_finite())
                .ok_or_else(|| not_a_number(name, &record[index]))
        };
        let time_s: Option<f64> = record[self.time].parse().ok();
        let time_s = time_s
            .filter(|time_s| time_s.is_finite())
            .ok_or_else(|| not_a_number("time_s", &record[self.time]))?;
        if time_s < 0.0 {
            return Err(format!(
                "time_s is {time_s}: a motion begins at 0 s or later"
            ));
        }
        Ok(Point {
            time_s,
            speed_mm_s: single(self.speed, "speed_mm_s")?,
            force_n: single(self.force, "force_n")?,
            position_mm: match self.position {
                Some(index) => single(index, "position_mm")?.into(),
                None => 0.0,
            },
            contact: match self.contact.map(|index| &record[index]) {
                None | Some("0") => false,
                Some("1") => true,
                Some(other) => {
                    return Err(format!("contact is '{other}': it must be 0 or 1"));
                }
            },
        })
    }
}

fn not_a_number(name: &str, text: &str) -> String {
    format!("{name} is '{text}', which is not a finite number")
}

fn row_problem(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("{len} values where the header has {expected_len} columns"),
        _ => error.to_string(),
    }
}

/// The line, from 1, of the record that a reader finds from `position` on: it counts from the end of the record before,
/// and skips comments and empty lines.
fn line_of_record(text: &str, position: &csv::Position) -> u64 {
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let skipped = rest
        .split('\n')
        .take_while(|line| line.trim_end_matches('\r').is_empty() || line.starts_with('#'));
    position.line() + skipped.count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<MotionPath> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        MotionPath::from_csv(file.path())
    }

    fn motion(speed_mm_s: f32, force_n: f32) -> Motion {
        Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).unwrap()
    }

    /// The line that an error names.
    fn line_of(error: &Error) -> u64 {
        match error {
            Error::Line { line, .. } => *line,
            other => panic!("no line in: {other}"),
        }
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
        assert!((path.duration_s() - 4.0).abs() < f64::EPSILON);
    }

    #[test]
    fn a_hand_that_turns_round_comes_to_rest_between() {
        let path = read("time_s,speed_mm_s,force_n\n0,-100,1\n1,100,1\n").unwrap();
        assert_eq!(path.at(0.0), motion(100.0, 1.0));
        assert_eq!(path.at(0.5), motion(0.0, 1.0));
    }

    #[test]
    fn column_order_other_columns_spaces_comments_and_line_ends_do_not_matter() {
        let plain = read("time_s,speed_mm_s,force_n\n0,100,0.5\n1,200,1\n").unwrap();
        for text in [
            "# by hand\nforce_n,who,time_s,speed_mm_s\n0.5,me,0,100\n# faster\n\n1,me,1,200\n",
            "\u{feff}time_s, speed_mm_s ,force_n\r\n0,1e2,.5\r\n\r\n1 , 200,1.0",
            "time_s,speed_mm_s,force_n,note\n0,100,0.5,\"a, b\nc\"\n1,200,1,\n",
        ] {
            assert_eq!(read(text).unwrap(), plain, "{text}");
        }
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
    fn what_is_wrong_with_a_row_is_said_with_its_line() {
        for (row, problem) in [
            ("2,fast,1", "speed_mm_s is 'fast'"),
            ("2,100,", "force_n is ''"),
            ("NaN,100,1", "time_s is 'NaN'"),
            ("2,inf,1", "speed_mm_s is 'inf'"),
            ("2,100,1e40", "force_n is '1e40'"),
            ("1,100,1", "times must rise"),
            ("0.5,100,1", "times must rise"),
            ("2,100", "2 values where the header has 3"),
            ("2,100,1,5", "4 values where the header has 3"),
        ] {
            for (end, above) in [
                ("\n", ""),
                ("\r\n", ""),
                ("\n", "# a\n\n# b\n"),
                ("\r\n", "\r\n# a\r\n"),
            ] {
                let text = format!(
                    "# head{end}time_s,speed_mm_s,force_n{end}1,100,1{end}{above}{row}{end}3,0,0{end}"
                );
                let error = read(&text).unwrap_err();
                let lines: Vec<&str> = text.lines().collect();
                let line = lines.iter().rposition(|line| *line == row).unwrap() as u64 + 1;
                assert_eq!(line_of(&error), line, "{text}");
                assert!(error.to_string().contains(problem), "{error}");
            }
        }
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
            assert!(
                (path.position_mm_at(time_s) - position_mm).abs() < 1e-9,
                "{time_s} s: {}",
                path.position_mm_at(time_s)
            );
        }
        let told = read("time_s,position_mm,speed_mm_s,force_n\n1,-5,0,1\n3,7,0,1\n").unwrap();
        for (time_s, position_mm) in [(0.0, -5.0), (1.0, -5.0), (2.0, 1.0), (9.0, 7.0)] {
            assert!((told.position_mm_at(time_s) - position_mm).abs() < 1e-9);
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

    #[test]
    fn a_time_before_the_beginning_is_refused() {
        let error = read("time_s,speed_mm_s,force_n\n-1,100,1\n").unwrap_err();
        assert_eq!(line_of(&error), 2);
        assert!(error.to_string().contains("begins at 0 s"), "{error}");
    }

    #[test]
    fn a_header_that_does_not_name_the_columns_is_refused() {
        for (text, problem) in [
            (
                "0,100,1\n1,200,1\n",
                "no column 'time_s' in the header '0,100,1'",
            ),
            ("time_s,speed_mm_s\n0,100\n", "no column 'force_n'"),
            (
                "time_s,speed_mm_s,force_n,time_s\n0,1,1,0\n",
                "more than one column 'time_s'",
            ),
            ("time_s,speed_mm_s,force_n\n", "no rows"),
            ("", "no column 'time_s'"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = MotionPath::from_csv(Path::new("no/such/motion.csv")).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("no/such/motion.csv: cannot read"),
            "{error}"
        );
    }

    proptest! {
        #[test]
        fn motion_stays_between_its_rows(
            rows in prop::collection::vec((0.001..10.0f64, -1e30..1e30f32, 0.0..1e30f32), 1..20),
            moment in -1.0..100.0f64,
        ) {
            let mut time_s = 0.0;
            let points = rows.iter().map(|&(step, speed_mm_s, force_n)| {
                time_s += step;
                Point { time_s, speed_mm_s, force_n, position_mm: 0.0, contact: false }
            });
            let path = MotionPath { points: points.collect(), tells_position: false, tells_contact: false };
            let before = path.points.iter().rev().find(|point| point.time_s <= moment);
            let after = path.points.iter().find(|point| point.time_s > moment);
            let ends = [before.or(after).unwrap(), after.or(before).unwrap()];
            let lowest = ends[0].force_n.min(ends[1].force_n);
            let highest = ends[0].force_n.max(ends[1].force_n);
            // A motion does not tell its parts, but two of them compare.
            let fraction = if ends[0] == ends[1] { 0.0 } else {
                (moment - ends[0].time_s) / (ends[1].time_s - ends[0].time_s)
            };
            let force = interpolate(ends[0].force_n, ends[1].force_n, fraction);
            let speed = interpolate(ends[0].speed_mm_s, ends[1].speed_mm_s, fraction);
            prop_assert!((lowest..=highest).contains(&force));
            prop_assert_eq!(path.at(moment), motion(speed, force));
        }

        #[test]
        fn any_text_gives_a_path_or_an_error(text in "(#|time_s|speed_mm_s|force_n|[,\n\r\" 0-9.eEa-]){0,60}") {
            if let Ok(path) = read(&text) {
                prop_assert!(path.duration_s().is_finite());
                path.at(0.5);
            }
        }
    }
}
