//! The rotations of a lattice as the lanes of a wavefront read them.

use model_format::limits::MAX_ORDER;
use stylus_kernel::rotation::Rotation;

/// Most samples in a pass.
pub const MAX_SAMPLES: usize = 16;

/// Stages that are there above the last and below the first, so that lanes which have yet to begin, or are done, read
/// zeros: a sample is two stages behind the one before.
const MARGIN: usize = 2 * MAX_SAMPLES;

/// Entries of all planes, rounded up to whole ones with as many lanes as are read at once.
const ENTRIES: usize = (MAX_ORDER + 2 * MARGIN + 2 * MAX_SAMPLES).next_multiple_of(64);

/// Rotations in planes, each of every `SPACING`-th stage: neighbouring entries are for neighbouring lanes.
///
/// An entry is cos θ in its lower half and sin θ in its upper one. Stages that are not there rotate nothing: both are
/// zero, and so is all that comes of them.
pub struct SpacedRotations<const SPACING: usize> {
    entries: [u64; ENTRIES],
}

impl<const SPACING: usize> SpacedRotations<SPACING> {
    /// Entries of a plane.
    const PLANE: usize = ENTRIES / SPACING;

    /// `rotations` in planes; at most [`MAX_ORDER`].
    pub fn new(rotations: &[Rotation]) -> Self {
        let mut entries = [0; ENTRIES];
        for (place, rotation) in (MARGIN..).zip(rotations) {
            debug_assert_eq!(rotation.neg_sin, -rotation.sin);
            let (cos, sin) = (rotation.cos.cast_unsigned(), rotation.sin.cast_unsigned());
            entries[Self::index(place)] = u64::from(cos) | u64::from(sin) << 32;
        }
        Self { entries }
    }

    /// The entries of `stage` and of every `SPACING`-th one above it, `COUNT` in all. Stages count from the first, and
    /// may be as far outside as [`MARGIN`].
    #[inline(always)]
    pub fn at_stage<const COUNT: usize>(&self, stage: isize) -> [u64; COUNT] {
        let place = stage.wrapping_add_unsigned(MARGIN).cast_unsigned();
        let entries = self.entries[Self::index(place)..].first_chunk();
        *entries.expect("no lane is farther outside than the margin")
    }

    #[inline(always)]
    fn index(place: usize) -> usize {
        place % SPACING * Self::PLANE + place / SPACING
    }
}
