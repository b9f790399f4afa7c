//! Recordings of a free hand: accelerations with the speed and force at each sample.
//!
//! Values that no hand and no sensor can produce (10⁵ N) are outliers. The first is reported with its line, and
//! no stretch in motion includes a block with an outlier. A file in which more than a tenth of the samples have an
//! outlier is refused, because its columns or units are then likely to be wrong.

mod moving;
mod positions;
mod read;

pub use moving::{LEAST_FORCE_N, LEAST_SPEED_MM_S, jumps_s, moving};
pub use read::{Freehand, is_simulated, read};
