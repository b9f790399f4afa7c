//! One moment of a motion, and interpolation from one moment to the next.

/// A motion at one moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub time_s: f64,
    /// Signed: the sign is the direction along the surface.
    pub speed_mm_s: f32,
    pub force_n: f32,
    /// Position of the file, or the integral of the speed.
    pub position_mm: f64,
    pub contact: bool,
}

impl Point {
    /// Returns the path from here until `time_s`, at most the time of `next`, in mm: the integral of a linear speed.
    pub(super) fn path_mm(&self, next: &Self, time_s: f64) -> f64 {
        let (from, to) = (f64::from(self.speed_mm_s), f64::from(next.speed_mm_s));
        let elapsed_s = time_s - self.time_s;
        let reached = from + (to - from) * elapsed_s / (next.time_s - self.time_s);
        0.5 * (from + reached) * elapsed_s
    }
}

/// Interpolates from `from`, at a fraction of 0, to `to`, at 1. Double precision holds every difference of two `f32`.
pub(super) fn interpolate(from: f32, to: f32, fraction: f64) -> f32 {
    let (from, to) = (f64::from(from), f64::from(to));
    (from + (to - from) * fraction) as f32
}
