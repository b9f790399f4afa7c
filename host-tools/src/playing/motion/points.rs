//! The rows of a motion, checked one after the other.

use super::point::Point;

/// The rows of a motion so far.
pub(super) struct Points {
    /// The rows, in ascending order of time.
    pub rows: Vec<Point>,
    /// True if the rows give the position; otherwise it is the integral of the speed.
    pub tells_position: bool,
    /// True if the rows give contact; otherwise it follows from the force.
    pub tells_contact: bool,
}

impl Points {
    /// No rows yet.
    pub fn new(tells_position: bool, tells_contact: bool) -> Self {
        Self {
            rows: Vec::new(),
            tells_position,
            tells_contact,
        }
    }

    /// Adds a row, with the integral of the speed as its position if rows give none.
    ///
    /// # Errors
    /// A time that is negative, not a number, or not above the last one, in words.
    pub fn push(&mut self, mut point: Point) -> Result<(), String> {
        let time_s = point.time_s;
        if !time_s.is_finite() || time_s < 0.0 {
            return Err(format!(
                "time_s is {time_s}: a motion begins at 0 s or later"
            ));
        }
        if let Some(before) = self.rows.last()
            && time_s <= before.time_s
        {
            return Err(format!(
                "time_s is {time_s} after {}: times must rise from row to row",
                before.time_s
            ));
        }
        if !self.tells_position {
            point.position_mm = self
                .rows
                .last()
                .map_or(f64::from(point.speed_mm_s) * time_s, |before| {
                    before.position_mm + before.path_mm(&point, time_s)
                });
        }
        self.rows.push(point);
        Ok(())
    }
}

/// Returns the problem of a position, in mm, beyond single precision, in words.
pub(super) fn position_fault(position_mm: f64) -> Option<String> {
    let is_finite = (position_mm as f32).is_finite();
    (!is_finite).then(|| "no path is as long: give it in mm".to_owned())
}
