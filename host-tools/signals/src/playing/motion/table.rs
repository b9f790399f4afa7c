//! Tables of motions in CSV files.

use std::path::Path;

use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, Header, Row};
use stylus_support::number::{force_fault, position_fault, speed_fault};
use stylus_support::{Error, Result};

use super::path::{MotionPath, Point, Points};
use crate::recording::{TimeColumn, TimeUnit};

impl MotionPath {
    /// Reads a CSV file with the columns `time_s`, or another unit's such as `time_ms`, `speed_mm_s` and `force_n`, and
    /// optionally `position_mm` and `contact`; see [the module](super).
    ///
    /// Times rise from row to row. A motion that begins ten seconds after zero or later has a clock of its own, and
    /// begins at zero.
    ///
    /// # Errors
    /// The file cannot be read or has no rows, or a column is missing. Or, with the line: a row does not have as many
    /// fields as the header, a value is not a finite number or no hand reaches it, a contact is neither 0 nor 1, a time
    /// is negative or does not rise, or there are more than ten million rows.
    pub fn from_csv(path: &Path) -> Result<Self> {
        read(path).map(Self::of)
    }
}

/// Least time of a first row, s, that is one of another clock than the motion's.
const LATE_S: f64 = 10.0;

fn read(path: &Path) -> Result<Points> {
    let table = CsvTable::read(path, Format::Motion)?;
    let columns = Columns::of(&table.header()?)?;
    let mut points = Points::new(columns.position.is_some(), columns.contact.is_some());
    let mut rows = table.rows_below_header()?;
    while let Some(row) = rows.next_row()? {
        let mut point = columns.point(&row)?;
        if points.rows.is_empty() && point.time_s >= LATE_S {
            points.clock_s = point.time_s;
        }
        point.time_s -= points.clock_s;
        points.push(point).map_err(|problem| row.error(problem))?;
    }
    if points.rows.is_empty() {
        return Err(Error::file(
            path,
            "no rows: a motion needs at least one row below its header",
        ));
    }
    Ok(points)
}

/// Indices of a table's columns.
struct Columns {
    time: usize,
    /// Unit of the times.
    unit: TimeUnit,
    speed: usize,
    force: usize,
    position: Option<usize>,
    contact: Option<usize>,
}

impl Columns {
    fn of(header: &Header<'_>) -> Result<Self> {
        let needed = |name: &str| header.needed(name, "a motion has time_s, speed_mm_s and force_n");
        let named = header.names().enumerate();
        let mut named =
            named.filter_map(|(index, name)| TimeColumn::named(index, name)?.unit.map(|unit| (index, unit)));
        let (time, unit) = named
            .next()
            .filter(|_| matches!(header.column("time_s"), Ok(None)))
            .map_or_else(|| needed("time_s").map(|index| (index, TimeUnit::S)), Ok)?;
        Ok(Self {
            time,
            unit,
            speed: needed("speed_mm_s")?,
            force: needed("force_n")?,
            position: header.column("position_mm")?,
            contact: header.column("contact")?,
        })
    }

    fn point(&self, row: &Row<'_, '_>) -> Result<Point> {
        let within = |index: usize, name: &str, fault: fn(f64) -> Option<String>| {
            let value = row.finite(index, name)?;
            fault(value).map_or(Ok(value as f32), |fault| {
                Err(row.error(format!("{name} is '{}': {fault}", row.text(index))))
            })
        };
        let time_s = row.finite(self.time, "time_s")? / self.unit.per_second();
        Ok(Point {
            time_s,
            speed_mm_s: within(self.speed, "speed_mm_s", speed_fault)?,
            force_n: within(self.force, "force_n", force_fault)?,
            position_mm: match self.position {
                Some(index) => within(index, "position_mm", position_fault)?.into(),
                None => 0.0,
            },
            contact: match self.contact.map(|index| row.text(index)) {
                None | Some("0") => false,
                Some("1") => true,
                Some(other) => {
                    return Err(row.error(format!("contact is '{other}': it must be 0 or 1")));
                }
            },
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::MotionPath;
    use super::*;
    use proptest::prelude::*;
    use test_helpers::holds;

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
    fn times_may_have_another_unit_and_begin_by_another_clock() {
        let plain = path_of("time_s,speed_mm_s,force_n\n0,100,0.5\n1,200,1\n").unwrap();
        assert_eq!(plain.doubt_of_times(), None);
        let in_ms = path_of("time_ms,speed_mm_s,force_n\n0,100,0.5\n1000,200,1\n").unwrap();
        assert_eq!(in_ms, plain);
        for begin in ["100", "1700000000"] {
            let text = format!(
                "time_s,speed_mm_s,force_n\n{begin}.25,100,0.5\n{}1.25,200,1\n",
                &begin[..begin.len() - 1]
            );
            let late = path_of(&text).unwrap();
            assert_eq!((late.duration_s(), late.position_mm_at(1.0)), (1.0, 150.0));
            holds(&late.doubt_of_times().unwrap(), &[begin, "begin at 0"]);
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
            ("2,20000,1", "speed_mm_s is '20000': a speed of"),
            ("2,100,250", "force_n is '250': a force of"),
            ("1,100,1", "times must rise"),
            ("0.5,100,1", "times must rise"),
            ("2,100", "2 fields where the first line has 3"),
            ("2,100,1,5", "4 fields where the first line has 3"),
        ] {
            for (end, above) in [
                ("\n", ""),
                ("\r\n", ""),
                ("\n", "# a\n\n# b\n"),
                ("\r\n", "\r\n# a\r\n"),
            ] {
                let text = format!("# head{end}time_s,speed_mm_s,force_n{end}1,100,1{end}{above}{row}{end}3,0,0{end}");
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
            ("0,100,1\n1,200,1\n", "no column 'time_s' in the header '0,100,1'"),
            ("time_s,speed_mm_s\n0,100\n", "no column 'force_n'"),
            (
                "time_s,speed_mm_s,force_n,time_s\n0,1,1,0\n",
                "more than one column 'time_s'",
            ),
            ("time_s,speed_mm_s,force_n\n", "no rows"),
            ("", "no column 'time_s'"),
        ] {
            holds(&path_of(text).unwrap_err(), &[problem]);
        }
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
