//! One moment of a motion, and interpolation from one to the next.

/// What is known of one moment. All numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub time_s: f64,
    /// Of either sign: the direction along the surface.
    pub speed_mm_s: f32,
    pub force_n: f32,
    /// As the file tells it, or the integral of the speed.
    pub position_mm: f64,
    pub contact: bool,
}

impl Point {
    /// The path from here until `time_s`, at most that of `next`, mm: the integral of a speed that changes evenly.
    pub(super) fn path_mm(&self, next: &Self, time_s: f64) -> f64 {
        let (from, to) = (f64::from(self.speed_mm_s), f64::from(next.speed_mm_s));
        let elapsed_s = time_s - self.time_s;
        let reached = from + (to - from) * elapsed_s / (next.time_s - self.time_s);
        0.5 * (from + reached) * elapsed_s
    }
}

/// `from` at a fraction of 0, `to` at 1. In double precision no difference of two `f32` overflows.
pub(super) fn interpolate(from: f32, to: f32, fraction: f64) -> f32 {
    let (from, to) = (f64::from(from), f64::from(to));
    (from + (to - from) * fraction) as f32
}
