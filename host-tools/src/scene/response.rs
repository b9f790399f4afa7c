//! The file of an actuator's measured response.

use std::path::Path;

use crate::dsp::equaliser::{Response, ResponseFault};
use crate::support::bounded_file::{Limit, MIB};
use crate::support::csv_table::CsvTable;
use crate::support::error::{Error, Result};

/// A response: some frequencies with their levels.
const RESPONSE: Limit = Limit {
    of: "a response",
    bytes: 16 * MIB,
};

/// Reads a response: a CSV file with the columns `frequency_hz`, ascending, and `magnitude_db`; comments begin with
/// `#`.
///
/// # Errors
/// A file that cannot be read, a missing column, a value that is no finite number, frequencies that do not ascend, or
/// too few of them.
pub fn read_response(path: &Path) -> Result<Response> {
    from_csv(path, RESPONSE.read_text(path)?)
}

fn from_csv(path: &Path, text: String) -> Result<Response> {
    let table = CsvTable::of(path, text);
    let header = table.header()?;
    let (frequency_name, magnitude_name) = ("frequency_hz", "magnitude_db");
    let needed = |name: &str| header.needed(name, "a response has frequency_hz and magnitude_db");
    let (frequency, magnitude) = (needed(frequency_name)?, needed(magnitude_name)?);
    let mut points: Vec<(f64, f64)> = Vec::new();
    let mut rows = table.rows_below_header()?;
    while let Some(row) = rows.next_row()? {
        let frequency_hz = row.finite(frequency, frequency_name)?;
        let level_db = row.finite(magnitude, magnitude_name)?;
        let before_hz = points.last().map_or(0.0, |point| point.0);
        if frequency_hz <= before_hz {
            let (index, hz) = (points.len(), frequency_hz);
            let fault = ResponseFault::Point {
                index,
                hz,
                before_hz,
            };
            return Err(row.error(fault.to_string()));
        }
        points.push((frequency_hz, level_db));
    }
    Response::new(points).map_err(|fault| Error::file(path, fault.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::holds;

    #[test]
    fn what_is_wrong_with_a_response_is_said_with_its_line() {
        let read = |text: &str| {
            from_csv(Path::new("coil.csv"), text.to_owned())
                .unwrap_err()
                .to_string()
        };
        let head = "frequency_hz,magnitude_db\n10,0\n20,0\n";
        for (text, expected) in [
            ("hz,db\n", "no column 'frequency_hz'"),
            ("frequency_hz,magnitude_db\n", "at 0 frequencies"),
            (
                &format!("{head}20,1\n"),
                "coil.csv, line 4: frequency_hz is 20 after 20",
            ),
            (
                &format!("{head}30,loud\n"),
                "coil.csv, line 4: magnitude_db is 'loud'",
            ),
            (
                &format!("{head}NaN,1\n"),
                "coil.csv, line 4: frequency_hz is 'NaN'",
            ),
        ] {
            holds(&read(text), &[expected]);
        }
    }
}
