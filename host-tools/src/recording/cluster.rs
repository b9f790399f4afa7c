//! The layout of the Cluster Haptic Texture Dataset (`documents/dataset_details.md` of its repository): one file per
//! sensor and stroke, each with its own times. The files themselves were not met here: the layout is as its authors
//! describe it, its flaws as its users report them.

use std::path::{Path, PathBuf};

use super::pattern::{Named, Pattern};
use crate::support::csv_table::{CsvTable, TABLE};
use crate::support::error::{Error, Result};

/// Names of the files of accelerations; the number after the texture is the direction, degrees.
const ACCELERATION: &str = "accel/{*}/{texture}_{*}_{speed}_{force*0.001}_{take}.csv";

/// Folder of the accelerations.
pub const ACCELERATIONS: &str = "accel";

/// Folder of the sensors.
const SENSORS: &str = "sensor_data";

/// Acceleration of a sample of 1: the files are in g.
pub const SCALE_M_S2: f64 = 9.80665;

/// Largest share by which a measured value may depart from the one in the file's name. Beyond, the name counts: forces
/// of this set are reported to be off by up to 1.16 N.
const BELIEVED: f64 = 0.35;

/// Share of a stroke at each end in which the machine speeds up and slows down.
const ENDS: f64 = 0.25;

/// Values that files beside the accelerations measured, by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// Strokes whose speed or force was measured.
    pub measured: (usize, usize),
    /// Strokes whose measured speed or force departs too far from the one in their name.
    pub disbelieved: (usize, usize),
}

/// The folder of the sensors in `folder`, or itself.
pub fn sensors(folder: &Path) -> PathBuf {
    let inner = folder.join(SENSORS);
    if inner.is_dir() {
        inner
    } else {
        folder.to_owned()
    }
}

/// The pattern of the files of accelerations below [`sensors`].
pub fn pattern() -> Pattern {
    ACCELERATION.parse().expect("it is one")
}

/// Gives the stroke its measured speed and force, where files of `folder` have them and they are near to its name's.
///
/// # Errors
/// A file of positions or forces that cannot be read.
pub fn measure(folder: &Path, stroke: &mut Named, measures: &mut Measures) -> Result<()> {
    let beside = |sensor: &str| {
        let below = stroke.file.strip_prefix(ACCELERATIONS).ok()?;
        let path = folder.join(sensor).join(below);
        path.is_file().then_some(path)
    };
    let (position, force) = (beside("position"), beside("force"));
    if let Some(path) = position {
        let [times, x, y] = columns(&path, ["time", "X", "Y"])?;
        let found = mean_speed(&times, &x, &y);
        believe(
            &mut stroke.speed_mm_s,
            found,
            &mut measures.measured.0,
            &mut measures.disbelieved.0,
        );
    }
    if let Some(path) = force {
        let [forces] = columns(&path, ["force"])?;
        let middle = middle(forces.len());
        let forces = &forces[middle];
        let mean = forces.iter().sum::<f64>() / forces.len() as f64;
        let found = mean.is_finite().then_some(mean.abs());
        believe(
            &mut stroke.force_n,
            found,
            &mut measures.measured.1,
            &mut measures.disbelieved.1,
        );
    }
    Ok(())
}

fn believe(
    named: &mut Option<f64>,
    found: Option<f64>,
    measured: &mut usize,
    disbelieved: &mut usize,
) {
    let (Some(found), Some(name)) = (found, *named) else {
        return;
    };
    if (found / name - 1.0).abs() <= BELIEVED {
        // Four digits are more than any sensor of a rig tells.
        *named = format!("{found:.3e}").parse().ok();
        *measured += 1;
    } else {
        *disbelieved += 1;
    }
}

/// Indices without the ends of `count`.
fn middle(count: usize) -> std::ops::Range<usize> {
    let end = (ENDS * count as f64) as usize;
    end..count - end
}

/// Mean speed between the ends of a straight stroke, mm/s.
fn mean_speed(times: &[f64], x: &[f64], y: &[f64]) -> Option<f64> {
    let middle = middle(times.len());
    let (first, last) = (middle.start, middle.end.checked_sub(1)?);
    let seconds = times.get(last)? - times.get(first)?;
    let speed = (x[last] - x[first]).hypot(y[last] - y[first]) / seconds;
    (seconds > 0.0 && speed.is_finite()).then_some(speed)
}

/// The columns of these `names` of the file.
fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Result<[Vec<f64>; N]> {
    let table = CsvTable::read(path, TABLE)?;
    let header = table.header()?;
    let mut at = [0; N];
    for (at, name) in at.iter_mut().zip(names) {
        *at = header.needed(name, &names.join(", "))?;
    }
    let mut rows = table.rows_below_header()?;
    let mut columns = [const { Vec::new() }; N];
    while let Some(row) = rows.next_row()? {
        for (column, &at) in columns.iter_mut().zip(&at) {
            column.push(row.number(at)?);
        }
    }
    if columns[0].is_empty() {
        return Err(Error::file(path, "has no samples"));
    }
    Ok(columns)
}
