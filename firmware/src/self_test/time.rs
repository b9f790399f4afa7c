//! Time since an instant, for the limits of waits.

use embassy_time::{Duration, Instant};

/// Time since `begin`: zero if the clock reads earlier than it did then, for which `Instant::elapsed` panics. On the
/// virtual stylus two readings in close succession did so.
pub fn since(begin: Instant) -> Duration {
    Instant::now().saturating_duration_since(begin)
}
