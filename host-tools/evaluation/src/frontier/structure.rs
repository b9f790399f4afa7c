//! The structures that are compared, and how each is stored and played.

use std::mem::size_of;

use model_format::{OutputSample, Texture, limits};
use stylus_costs::Structure;
use stylus_fit::texture::theta::{StoredTheta, bytes_per_node};
use stylus_hard_cases::Filter;
use stylus_kernel::Motion;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::rotation::Rotation;

use super::players::{NotHeld, filter_of};

/// Returns the bytes of flash for a node's coefficients. A lattice takes the smallest form of θ that `fit` stores, and
/// a direct form takes its own words.
pub(super) fn library_bytes_per_node(structure: Structure, order: usize) -> usize {
    let theta = match structure {
        Structure::DirectForm16 => return order * size_of::<i16>(),
        Structure::DirectForm32 => return order * size_of::<i32>(),
        Structure::NormalisedLattice32 if order > limits::MAX_FINE_STAGES => StoredTheta::Compact,
        Structure::NormalisedLattice32 => StoredTheta::Fine,
    };
    bytes_per_node(theta, order, order)
}

/// Bytes of RAM for the coefficients of two frames, one in use and one being computed, and for the state.
pub(super) fn ram_bytes(structure: Structure, order: usize) -> usize {
    const FRAMES: usize = 2;
    if structure.is_direct() {
        // The history is written twice so that it never wraps.
        return (FRAMES + 2) * order * size_of::<i32>();
    }
    FRAMES * order * size_of::<Rotation>() + (order + 1) * size_of::<i32>()
}

/// A texture that a structure plays, from rest. The same seed gives all structures the same noise.
pub struct Voice<'a> {
    texture: Texture<'a>,
    filter: Box<dyn Filter>,
    excitation: Excitation,
    /// Number of samples that are left of the level's ramp.
    left: u32,
    saturations: u32,
}

impl<'a> Voice<'a> {
    /// Creates a voice that plays `texture` with `structure`, at rest.
    pub fn new(structure: Structure, texture: Texture<'a>, seed: u64) -> Result<Self, NotHeld> {
        Ok(Self {
            texture,
            filter: filter_of(structure, &texture)?,
            excitation: Excitation::new(seed),
            left: 0,
            saturations: 0,
        })
    }

    /// Follows `motion` from now on. The level reaches that of `motion` after `samples` samples.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        self.filter.follow(&self.texture, motion, self.left, samples);
        self.left = samples;
    }

    /// Appends the next samples, m/s², to `signal`. Their conversion from fixed point is exact.
    pub fn play(&mut self, samples: usize, signal: &mut Vec<f64>) {
        const UNIT: f64 = (1u32 << OutputSample::FRACTION_BITS) as f64;
        for _ in 0..samples {
            self.left = self.left.saturating_sub(1);
            let excitation = self.excitation.next_sample();
            let (output, is_full) = self.filter.sample(excitation, self.left);
            self.saturations += u32::from(is_full);
            signal.push(f64::from(output.0) / UNIT);
        }
    }

    /// Returns the number of samples at full scale.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}
