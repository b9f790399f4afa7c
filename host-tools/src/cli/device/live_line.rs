//! Levels in the line that shows a command's progress.

use host_tools::link::capture::Level;

/// Samples that a live level is the mean of: 0.1 s.
pub const LIVE_SAMPLES: usize = 500;

/// A level in a few words.
pub fn live(level: &Level) -> String {
    format!("{:7.3} m/s² {:5.1} mm/s", level.rms_m_s2, level.speed_mm_s)
}
