//! Motions over a grid of two by two nodes.

use model_format::{MillimetresPerSecond, Newton};
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use stylus_kernel::Motion;

/// Speeds of the grid, mm/s.
pub const SPEEDS_MM_S: [f32; 2] = [100.0, 200.0];
/// Forces of the grid, N.
pub const FORCES_N: [f32; 2] = [0.5, 1.0];

/// A motion over a grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Path {
    /// Rest on a point: mm/s and N.
    Still(f32, f32),
    /// Jumps between the corners of the grid, every this number of samples.
    Saw(u32),
    /// Jumps to random points on the grid and a little beyond it, at equal intervals.
    Random {
        /// Number of samples from one change of the motion to the next.
        every: u32,
        /// Seed of the motion, not of the noise.
        seed: u64,
    },
}

impl Path {
    /// Number of samples from one change of the motion to the next; `None` if it does not change.
    pub fn every(&self) -> Option<u32> {
        match *self {
            Self::Still(..) => None,
            Self::Saw(every) | Self::Random { every, .. } => Some(every),
        }
    }

    /// The motion that begins at this sample, if one does.
    pub fn change_at(&self, sample: usize) -> Option<Motion> {
        let every = self.every().map(|every| every as usize);
        every
            .map_or(sample == 0, |every| sample.is_multiple_of(every))
            .then(|| {
                let (speed_mm_s, force_n) = self.place(sample / every.unwrap_or(1));
                Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).expect("it is finite")
            })
    }

    /// Speed, mm/s, and force, N, in this interval of the path.
    fn place(&self, interval: usize) -> (f32, f32) {
        match *self {
            Self::Still(speed, force) => (speed, force),
            Self::Saw(_) => {
                // All four corners, each once after every other corner.
                const CORNERS: [usize; 12] = [0, 3, 1, 2, 0, 1, 3, 2, 3, 0, 2, 1];
                let corner = CORNERS[interval % CORNERS.len()];
                (SPEEDS_MM_S[corner / 2], FORCES_N[corner % 2])
            }
            Self::Random { seed, .. } => {
                // A generator for each interval, so that the place does not depend on those before it.
                let mut random = rand_pcg::Pcg64::seed_from_u64(seed ^ interval as u64);
                (
                    random.random_range(0.9 * SPEEDS_MM_S[0]..1.1 * SPEEDS_MM_S[1]),
                    random.random_range(0.9 * FORCES_N[0]..1.1 * FORCES_N[1]),
                )
            }
        }
    }
}
