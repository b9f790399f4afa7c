//! Motions: from arrays, from tables, and constant.

use std::path::PathBuf;

use host_tools::playing::motion::{MotionPath, MotionRow};
use model_format::{MillimetresPerSecond, Newton};
use pyo3::prelude::*;

use crate::convert::numbers;
use crate::error::{raised, refused, warn};

/// The numbers of the argument `name`: one per row, or one for all of them.
fn rows(name: &str, values: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<f64>> {
    // A number first: as an array it would have no dimension, and be refused.
    if let Ok(value) = values.extract() {
        return Ok(vec![value; count]);
    }
    let values = numbers(name, values)?;
    if values.len() == count {
        return Ok(values);
    }
    Err(refused(format!(
        "{name} has {} values and time_s {count}: give as many, or one",
        values.len()
    )))
}

/// Speed and force of a hand over time, linear between rows.
///
/// `time_s` rises from 0 s or later; `speed_mm_s` (its sign is the direction) and `force_n` (at or below zero there is
/// no contact) are one number or one per row. `position_mm` is the integral of the speed if it is not given, and
/// `contact` follows from the force. Values that no hand has are refused.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Motion {
    path: MotionPath,
    /// The file that it comes from.
    file: Option<PathBuf>,
}

#[pymethods]
impl Motion {
    #[new]
    #[pyo3(signature = (time_s, speed_mm_s, force_n, *, position_mm = None, contact = None))]
    fn new(
        time_s: &Bound<'_, PyAny>,
        speed_mm_s: &Bound<'_, PyAny>,
        force_n: &Bound<'_, PyAny>,
        position_mm: Option<&Bound<'_, PyAny>>,
        contact: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let times = numbers("time_s", time_s)?;
        let count = times.len();
        let speeds = rows("speed_mm_s", speed_mm_s, count)?;
        let forces = rows("force_n", force_n, count)?;
        let of = |name, values: Option<&Bound<'_, PyAny>>| values.map(|values| rows(name, values, count)).transpose();
        let positions = of("position_mm", position_mm)?;
        let contacts = of("contact", contact)?;
        let rows = (0..count).map(|row| MotionRow {
            time_s: times[row],
            speed_mm_s: speeds[row],
            force_n: forces[row],
            position_mm: positions.as_ref().map(|values| values[row]),
            contact: contacts.as_ref().map(|values| values[row] != 0.0),
        });
        Ok(Self {
            path: MotionPath::from_rows(rows).map_err(raised)?,
            file: None,
        })
    }

    /// Reads a CSV file with the columns time_s, speed_mm_s, force_n, and optionally position_mm and contact.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        Ok(Self {
            path: MotionPath::from_csv(&path).map_err(raised)?,
            file: Some(path),
        })
    }

    /// A motion of constant speed, mm/s, and force, N, without end.
    #[staticmethod]
    fn constant(speed_mm_s: f64, force_n: f64) -> PyResult<Self> {
        Ok(Self {
            path: constant(speed_mm_s, force_n)?,
            file: None,
        })
    }

    /// Time of the last row, s; 0 for a constant motion.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.path.duration_s()
    }

    /// Speed, mm/s, and force, N, at `time_s`.
    fn at(&self, time_s: f64) -> (f32, f32) {
        let (speed, force) = self.path.values_at(time_s);
        (speed.0, force.0)
    }

    fn __repr__(&self) -> String {
        match &self.file {
            Some(file) => format!("Motion.read({:?})", file.display().to_string()),
            None => format!("Motion({} s)", self.path.duration_s()),
        }
    }
}

fn constant(speed_mm_s: f64, force_n: f64) -> PyResult<MotionPath> {
    let row = MotionRow {
        time_s: 0.0,
        speed_mm_s,
        force_n,
        position_mm: None,
        contact: None,
    };
    // For its checks: a constant motion is only asked to be finite.
    MotionPath::from_rows([row]).map_err(raised)?;
    let (speed, force) = (MillimetresPerSecond(speed_mm_s as f32), Newton(force_n as f32));
    MotionPath::constant(speed, force).map_err(raised)
}

/// A motion, or the path of a table of one.
#[derive(FromPyObject)]
pub enum MotionLike<'py> {
    /// A motion.
    Motion(Bound<'py, Motion>),
    /// A file.
    Path(PathBuf),
}

/// The arguments about a motion and its duration.
pub struct Asked<'py> {
    /// Constant speed, mm/s.
    pub speed_mm_s: Option<f64>,
    /// Constant force, N.
    pub force_n: Option<f64>,
    /// A motion instead.
    pub motion: Option<MotionLike<'py>>,
    /// Duration, s.
    pub seconds: Option<f64>,
}

/// A motion and its duration, s, if it has an end.
pub struct Along {
    /// The motion.
    pub path: MotionPath,
    /// Duration of the motion, s; none if it has no end.
    pub seconds: Option<f64>,
}

impl Asked<'_> {
    /// Returns the requested motion; `None` if no motion was given.
    ///
    /// # Errors
    /// A motion that cannot be used; a motion together with a speed or a force; a speed without a force, or the
    /// reverse; a duration that is not positive.
    pub fn along(self) -> PyResult<Option<Along>> {
        if let Some(seconds) = self.seconds {
            crate::convert::positive("seconds", seconds)?;
        }
        match (self.motion, self.speed_mm_s, self.force_n) {
            (None, None, None) => Ok(None),
            (None, Some(speed_mm_s), Some(force_n)) => Ok(Some(Along {
                path: constant(speed_mm_s, force_n)?,
                seconds: self.seconds,
            })),
            (Some(motion), None, None) => {
                let (path, file) = match motion {
                    MotionLike::Motion(motion) => {
                        let motion = motion.get();
                        (motion.path.clone(), motion.file.clone())
                    }
                    MotionLike::Path(file) => {
                        let path = MotionPath::from_csv(&file).map_err(raised)?;
                        (path, Some(file))
                    }
                };
                let own = match file {
                    _ if self.seconds.is_some() => self.seconds,
                    Some(file) => Some(path.end_s(&file).map_err(raised)?),
                    // A constant motion has one row, at 0 s, and no end.
                    None => Some(path.duration_s()).filter(|&end_s| end_s > 0.0),
                };
                Ok(Some(Along { path, seconds: own }))
            }
            _ => Err(refused(
                "give speed_mm_s and force_n together, or motion in their place",
            )),
        }
    }
}

/// Warns of a motion along which a texture is never heard, or whose times are hardly those of a hand.
pub fn warn_of_motion(py: Python<'_>, motion: &MotionPath) -> PyResult<()> {
    if !motion.sounds() {
        warn(
            py,
            "the motion never has a speed and a force above zero together, so that nothing is heard: a force at or \
             below zero is no contact",
        )?;
    }
    motion.doubt_of_times().map_or(Ok(()), |doubt| warn(py, &doubt))
}
