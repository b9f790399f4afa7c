//! Time since an instant, for the limits of waits.

use embassy_time::{Duration, Instant};

/// Time since `begin`: zero if the clock reads earlier than it did then, for which `Instant::elapsed` panics. A clock
/// that began half a turn ahead did so, see `boot/time.rs`. One whose interrupt is masked for longer than half a turn,
/// as while a sector of the settings is erased, may do so again.
pub fn since(begin: Instant) -> Duration {
    Instant::now().saturating_duration_since(begin)
}
