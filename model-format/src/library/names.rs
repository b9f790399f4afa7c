//! The names that were read so far, in sorted order, so that a new name is compared with only a few of them.

use core::cmp::Ordering;

use crate::wire::Reader;

/// Offsets of up to `N` names, where `N` is at most 256, in bytes that hold each name as a string. Names have indices
/// in the order in which they were added.
#[derive(Clone, Debug)]
pub(super) struct Names<const N: usize> {
    offsets: [u32; N],
    /// Indices of the names, ascending in the order of [`order`].
    sorted: [u8; N],
    len: usize,
}

impl<const N: usize> Names<N> {
    pub const fn new() -> Self {
        Self {
            offsets: [0; N],
            sorted: [0; N],
            len: 0,
        }
    }

    /// Forgets all names.
    pub const fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds the name at `offset` of `bytes` and gives it the next index. After `N` names, further names are not stored.
    ///
    /// # Errors
    /// The index of an equal name that was added before.
    pub fn insert(&mut self, bytes: &[u8], offset: u32) -> Result<(), usize> {
        let name_at = |offset: u32| {
            let rest = bytes.get(offset as usize..).unwrap_or_default();
            Reader(rest).string().unwrap_or_default()
        };
        let name = name_at(offset);
        let compare = |&at: &u8| order(name_at(self.offsets[usize::from(at)]), name);
        let sorted = &self.sorted[..self.len];
        // Comparisons with up to 255 names would exceed the bound on the work per texture.
        let place = match sorted.binary_search_by(compare) {
            Ok(place) => return Err(usize::from(sorted[place])),
            Err(place) => place,
        };
        if self.len < N {
            self.sorted.copy_within(place..self.len, place + 1);
            // `len` is below N here, and N is at most 256, so that `len` fits in a byte.
            (self.sorted[place], self.offsets[self.len]) = (self.len as u8, offset);
            self.len += 1;
        }
        Ok(())
    }
}

/// A total order of strings: by length first, then by words of four bytes. It is not alphabetical. It compares names
/// that begin alike in fewer steps than an alphabetical order.
fn order(one: &[u8], other: &[u8]) -> Ordering {
    one.len().cmp(&other.len()).then_with(|| {
        let (words, rest) = one.as_chunks::<4>();
        let (other_words, other_rest) = other.as_chunks::<4>();
        for (&word, &other) in words.iter().zip(other_words) {
            let by_word = u32::from_le_bytes(word).cmp(&u32::from_le_bytes(other));
            if by_word != Ordering::Equal {
                return by_word;
            }
        }
        rest.cmp(other_rest)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places the first `length` bytes of each text as a string, one every 8 bytes.
    fn strings(texts: &[[u8; 7]; 256], length: usize) -> [u8; 8 * 256] {
        let mut bytes = [0; 8 * 256];
        for (string, text) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(texts) {
            string[0] = length as u8;
            string[1..].copy_from_slice(text);
        }
        bytes
    }

    #[test]
    fn the_same_name_is_found_by_its_index_among_all_that_differ() {
        let texts: [[u8; 7]; 256] =
            core::array::from_fn(|i| [b'n', b'a', b'm', b'e', 0, 0, (i as u8).wrapping_mul(37)]);
        for length in [7, 4] {
            let bytes = strings(&texts, length);
            let mut names = Names::<256>::new();
            for index in 0..256 {
                let expected = if length == 7 || index == 0 { Ok(()) } else { Err(0) };
                assert_eq!(names.insert(&bytes, 8 * index), expected);
            }
            for index in (0..256).filter(|_| length == 7) {
                assert_eq!(names.insert(&bytes, 8 * index), Err(index as usize));
            }
        }
    }

    #[test]
    fn the_order_is_total_and_only_equal_strings_are_equal() {
        let texts: [&[u8]; 9] = [b"", b"a", b"b", b"aa", b"abcd", b"abce", b"bbcd", b"abcde", b"abcdf"];
        for one in texts {
            for other in texts {
                assert_eq!(order(one, other), order(other, one).reverse());
                assert_eq!(order(one, other) == Ordering::Equal, one == other);
                for third in texts {
                    if order(one, other) == Ordering::Less && order(other, third) == Ordering::Less {
                        assert_eq!(order(one, third), Ordering::Less);
                    }
                }
            }
        }
    }
}
