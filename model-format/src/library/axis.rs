//! An axis of a grid.

/// Ascending values of a grid's axis, finite and not negative, in the axis's unit.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a>(pub(super) &'a [u8]);

impl Axis<'_> {
    pub(super) const VALUE_BYTES: usize = 4;

    /// Number of values, at least one.
    #[expect(clippy::len_without_is_empty, reason = "an axis is never empty")]
    pub fn len(&self) -> usize {
        self.0.len() / Self::VALUE_BYTES
    }

    /// Value `index`, which must be below [`Axis::len`].
    pub fn value(&self, index: usize) -> f32 {
        f32::from_le_bytes(self.0.as_chunks().0[index])
    }

    /// All values, ascending.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        self.0.as_chunks().0.iter().copied().map(f32::from_le_bytes)
    }
}
