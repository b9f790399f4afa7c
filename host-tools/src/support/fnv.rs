//! The 64-bit FNV-1a hash (Fowler, Noll and Vo; IETF draft-eastlake-fnv): the same on every computer and in every
//! version, which the standard library's hashes are not. It tells accidents, not attacks.

/// Multiplier of each byte.
const PRIME: u64 = 0x0100_0000_01b3;

/// A hash of the bytes so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fnv(u64);

impl Default for Fnv {
    /// The hash of no bytes.
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    /// The hash of `bytes`.
    pub fn of(bytes: &[u8]) -> u64 {
        Self::default().then(bytes).value()
    }

    /// The hash of what was hashed, with `bytes` after it.
    #[must_use]
    pub fn then(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |hash, &byte| {
            (hash ^ u64::from(byte)).wrapping_mul(PRIME)
        }))
    }

    /// The hashes of what each of `hashes` was of, with the bytes of its own of `pieces` after it.
    ///
    /// A hash waits for its own multiplication in every byte. Several side by side fill that time with each other.
    #[must_use]
    pub fn then_each<const N: usize>(hashes: [Self; N], pieces: [&[u8]; N]) -> [Self; N] {
        let common = pieces.iter().map(|piece| piece.len()).min().unwrap_or(0);
        let heads = pieces.map(|piece| &piece[..common]);
        let mut values = hashes.map(Self::value);
        for at in 0..common {
            for (value, head) in values.iter_mut().zip(heads) {
                *value = (*value ^ u64::from(head[at])).wrapping_mul(PRIME);
            }
        }
        std::array::from_fn(|lane| Self(values[lane]).then(&pieces[lane][common..]))
    }

    /// Its value.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn hashes_side_by_side_are_those_one_after_the_other(
            pieces in prop::array::uniform4(prop::collection::vec(any::<u8>(), 0..200)),
        ) {
            let begun = [Fnv::default().then(b"a"), Fnv::default(), Fnv::default().then(b"bc"), Fnv::default()];
            let each = Fnv::then_each(begun, pieces.each_ref().map(Vec::as_slice));
            for ((each, begun), piece) in each.into_iter().zip(begun).zip(&pieces) {
                prop_assert_eq!(each, begun.then(piece));
            }
        }
    }
}
