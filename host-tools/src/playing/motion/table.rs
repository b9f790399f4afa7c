//! Tables of motions in CSV files.

use std::path::Path;

use csv::{StringRecord, Trim};

use super::point::Point;
use crate::support::bounded_file::{Limit, MIB};
use crate::support::error::{Error, Result};

/// A motion: some 40 bytes per row, so that a day at 100 rows per second fits.
const MOTION: Limit = Limit {
    of: "a motion",
    bytes: 512 * MIB,
};

/// A table of a motion, with at least one row.
pub(super) struct Table {
    /// The rows, in ascending order of time.
    pub points: Vec<Point>,
    /// True if the file gives the position; otherwise it is the integral of the speed.
    pub tells_position: bool,
    /// True if the file gives contact; otherwise it follows from the force.
    pub tells_contact: bool,
}

/// Reads a CSV file; see [`super::MotionPath::from_csv`].
pub(super) fn read(path: &Path) -> Result<Table> {
    let text = MOTION.read_text(path)?;
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
            "no rows: a motion needs at least one row below its header",
        ));
    }
    Ok(Table {
        points,
        tells_position: columns.position.is_some(),
        tells_contact: columns.contact.is_some(),
    })
}

/// Indices of a table's columns.
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
        // A value beyond single precision is parsed as infinite, and refused.
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

/// Returns the line, from 1, of the record that a reader finds at `position`. The reader's own line is that of the end
/// of the record before, because it skips comments and empty lines.
fn line_of_record(text: &str, position: &csv::Position) -> u64 {
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let skipped = rest
        .split('\n')
        .take_while(|line| line.trim_end_matches('\r').is_empty() || line.starts_with('#'));
    position.line() + skipped.count() as u64
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::MotionPath;
    use super::*;
    use proptest::prelude::*;

    pub fn path_of(text: &str) -> Result<MotionPath> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        MotionPath::from_csv(file.path())
    }

    /// The line that an error names.
    fn line_of(error: &Error) -> u64 {
        match error {
            Error::Line { line, .. } => *line,
            other => panic!("no line in: {other}"),
        }
    }

    #[test]
    fn column_order_other_columns_spaces_comments_and_line_ends_do_not_matter() {
        let plain = path_of("time_s,speed_mm_s,force_n\n0,100,0.5\n1,200,1\n").unwrap();
        for text in [
            "# by hand\nforce_n,who,time_s,speed_mm_s\n0.5,me,0,100\n# faster\n\n1,me,1,200\n",
            "\u{feff}time_s, speed_mm_s ,force_n\r\n0,1e2,.5\r\n\r\n1 , 200,1.0",
            "time_s,speed_mm_s,force_n,note\n0,100,0.5,\"a, b\nc\"\n1,200,1,\n",
        ] {
            assert_eq!(path_of(text).unwrap(), plain, "{text}");
        }
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
                let error = path_of(&text).unwrap_err();
                let lines: Vec<&str> = text.lines().collect();
                let line = lines.iter().rposition(|line| *line == row).unwrap() as u64 + 1;
                assert_eq!(line_of(&error), line, "{text}");
                assert!(error.to_string().contains(problem), "{error}");
            }
        }
    }

    #[test]
    fn a_time_before_the_beginning_is_refused() {
        let error = path_of("time_s,speed_mm_s,force_n\n-1,100,1\n").unwrap_err();
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
            let error = path_of(text).unwrap_err().to_string();
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
        fn any_text_gives_a_path_or_an_error(text in "(#|time_s|speed_mm_s|force_n|[,\n\r\" 0-9.eEa-]){0,60}") {
            if let Ok(path) = path_of(&text) {
                prop_assert!(path.duration_s().is_finite());
                path.at(0.5);
            }
        }
    }
}
