//! The 64-bit FNV-1a hash (Fowler, Noll and Vo; IETF draft-eastlake-fnv). It is the same on every computer and in every
//! version, unlike the standard library's hashes. It detects accidental changes, but not attacks.

/// Factor by which the hash is multiplied for each byte.
const PRIME: u64 = 0x0100_0000_01b3;

/// The hash of the bytes so far.
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

    /// The hash of all bytes so far, with `bytes` after them.
    #[must_use]
    pub fn then(self, bytes: &[u8]) -> Self {
        Self(
            bytes
                .iter()
                .fold(self.0, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(PRIME)),
        )
    }

    /// Another hash of `bytes` after all bytes so far, in a sixth of the time: eight bytes at once. The shift brings
    /// bits down again, which a product only carries up.
    #[must_use]
    pub fn then_words(self, bytes: &[u8]) -> Self {
        let (words, rest) = bytes.as_chunks();
        let step = |hash: u64, word: &[u8; 8]| {
            let product = (hash ^ u64::from_le_bytes(*word)).wrapping_mul(PRIME);
            product ^ (product >> 32)
        };
        Self(words.iter().fold(self.0, step)).then(rest)
    }

    /// Value of the hash.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of the draft's appendix.
    #[test]
    fn the_hash_is_that_of_its_authors() {
        assert_eq!(Fnv::of(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(Fnv::of(b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(Fnv::of(b"foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn no_bit_of_any_byte_and_no_pair_of_them_leaves_the_hash_of_words_as_it_was() {
        let hash = |flips: &[usize]| {
            let mut bytes = *b"twenty-one bytes here";
            flips.iter().for_each(|bit| bytes[bit / 8] ^= 1 << (bit % 8));
            Fnv::default().then_words(&bytes).value()
        };
        for first in 0..8 * 21 {
            assert_ne!(hash(&[first]), hash(&[]));
            for second in 0..first {
                assert_ne!(hash(&[first, second]), hash(&[]), "{first} {second}");
            }
        }
    }
}
