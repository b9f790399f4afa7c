//! Motions that several tests of this crate use, over the grid of [`test_helpers::library`].

use model_format::{MillimetresPerSecond, Newton};

use crate::playing::motion::MotionPath;

pub fn constant(speed_mm_s: f32, force_n: f32) -> MotionPath {
    MotionPath::constant(MillimetresPerSecond(speed_mm_s), Newton(force_n)).unwrap()
}

/// A motion across the whole grid and down to rest.
pub fn sweep() -> MotionPath {
    let file = tempfile::NamedTempFile::new().unwrap();
    let rows = "time_s,speed_mm_s,force_n\n0,0,0.2\n0.2,120,1.1\n0.3,60,0.4\n0.4,0,0\n";
    std::fs::write(file.path(), rows).unwrap();
    MotionPath::from_csv(file.path()).unwrap()
}
