//! The unit of the proof's numbers.

/// Digits of a unit: one is 2^(`UNIT_BITS` - E) units, where E is the texture's exponent.
pub const UNIT_BITS: u32 = 41;

/// Bound on what evaluation may be off by, in units of 2^(E-41); see [`super`].
pub(crate) const EVALUATION_UNITS: i64 = 46_500;
