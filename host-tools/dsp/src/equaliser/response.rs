//! The measured response of an actuator.

/// Least number of points of a response.
const FEWEST_POINTS: usize = 4;

/// Level of an actuator over frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Frequency, Hz, ascending, and level, dB.
    points: Vec<(f64, f64)>,
}

impl Response {
    /// Creates the response through these points: frequency, Hz, above zero and ascending, and level, dB.
    ///
    /// # Errors
    /// A value is not finite, or a frequency is not above zero and the previous one; the error has the index of the
    /// first such point. Or there are fewer than four points.
    pub fn new(points: Vec<(f64, f64)>) -> Result<Self, ResponseFault> {
        let mut before_hz = 0.0;
        for (index, &(hz, level_db)) in points.iter().enumerate() {
            // The comparison is false for a NaN.
            if !(hz > before_hz && hz.is_finite() && level_db.is_finite()) {
                return Err(ResponseFault::Point { index, hz, before_hz });
            }
            before_hz = hz;
        }
        if points.len() < FEWEST_POINTS {
            return Err(ResponseFault::TooFew(points.len()));
        }
        Ok(Self { points })
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

/// Reason why points are not a response, or why no equaliser can be designed for a response.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ResponseFault {
    /// A frequency does not ascend, or a value is not finite.
    #[error("frequency_hz is {hz} after {before_hz}; frequencies must be above 0 and ascend")]
    Point {
        /// Index of the point.
        index: usize,
        /// Frequency of the point, Hz.
        hz: f64,
        /// Frequency of the previous point, Hz; 0 for the first point.
        before_hz: f64,
    },
    /// The format does not allow this limit on the gain.
    #[error("the limit on the gain is {max_gain_db} dB; it must be 0 to {most_db:.1}")]
    Gain {
        /// The requested limit, dB.
        max_gain_db: f64,
        /// Largest limit that the format allows, dB.
        most_db: f64,
    },
    /// The response covers too little of the band.
    #[error("has {low_hz} to {high_hz} Hz of the band; at least a factor of 1.5 is needed")]
    Band {
        /// Lower edge of the part of the band that the response covers, Hz.
        low_hz: f64,
        /// Upper edge of the part of the band that the response covers, Hz.
        high_hz: f64,
    },
    /// There are too few points; the field is their number.
    #[error("has the response at {0} frequencies; at least {FEWEST_POINTS} are needed")]
    TooFew(usize),
}
