//! The measured response of an actuator.

use std::path::{Path, PathBuf};

use crate::support::bounded_file::{Limit, MIB};
use crate::support::csv_table::CsvTable;
use crate::support::error::{Error, Result};

/// A response: some frequencies with their levels.
const RESPONSE: Limit = Limit {
    of: "a response",
    bytes: 16 * MIB,
};

/// Least number of points of a response.
const FEWEST_POINTS: usize = 4;

/// Level of an actuator over frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    path: PathBuf,
    /// Frequency, Hz, ascending, and level, dB.
    points: Vec<(f64, f64)>,
}

impl Response {
    /// Reads a response: a CSV file with the columns `frequency_hz`, ascending, and `magnitude_db`; comments begin with
    /// `#`.
    ///
    /// # Errors
    /// A file that cannot be read, a missing column, a value that is no finite number, frequencies that do not ascend,
    /// or too few of them.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_csv(path, RESPONSE.read_text(path)?)
    }

    pub(super) fn from_csv(path: &Path, text: String) -> Result<Self> {
        let table = CsvTable::of(path, text);
        let header = table.header()?;
        let (frequency_name, magnitude_name) = ("frequency_hz", "magnitude_db");
        let needed =
            |name: &str| header.needed(name, "a response has frequency_hz and magnitude_db");
        let (frequency, magnitude) = (needed(frequency_name)?, needed(magnitude_name)?);
        let mut points: Vec<(f64, f64)> = Vec::new();
        let mut rows = table.rows_below_header()?;
        while let Some(row) = rows.next_row()? {
            let frequency_hz = row.finite(frequency, frequency_name)?;
            let level_db = row.finite(magnitude, magnitude_name)?;
            let before_hz = points.last().map_or(0.0, |point| point.0);
            if frequency_hz <= before_hz {
                let problem = format!(
                    "frequency_hz is {frequency_hz} after {before_hz}; frequencies must be above 0 and ascend"
                );
                return Err(row.error(problem));
            }
            points.push((frequency_hz, level_db));
        }
        if points.len() < FEWEST_POINTS {
            let problem = format!(
                "has the response at {} frequencies; at least {FEWEST_POINTS} are needed",
                points.len()
            );
            return Err(Error::file(path, problem));
        }
        Ok(Self {
            path: path.to_owned(),
            points,
        })
    }

    /// File that the response was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Frequency, Hz, ascending, and level, dB.
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// Level at `frequency_hz`, dB: linear over the logarithm of the frequency, constant beyond both ends.
    pub fn level_db(&self, frequency_hz: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 <= frequency_hz);
        match (after.checked_sub(1), self.points.get(after)) {
            (Some(before), Some(next)) => {
                let before = self.points[before];
                let share = (frequency_hz / before.0).ln() / (next.0 / before.0).ln();
                before.1 + (next.1 - before.1) * share
            }
            (None, Some(first)) => first.1,
            (_, None) => self.points[self.points.len() - 1].1,
        }
    }
}
