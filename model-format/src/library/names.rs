//! Names that were found so far, in an order of their own, so that a new one is compared with few.

use core::cmp::Ordering;

/// Up to `N` names, at most 256, with the index that each was given.
#[derive(Clone, Debug)]
pub(super) struct Names<'a, const N: usize> {
    known: [&'a [u8]; N],
    /// Indices of the names, ascending in the order of [`order`].
    sorted: [u8; N],
    len: usize,
}

impl<'a, const N: usize> Names<'a, N> {
    pub const fn new() -> Self {
        Self {
            known: [&[]; N],
            sorted: [0; N],
            len: 0,
        }
    }

    /// Forgets all names.
    pub const fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds `name`, which gets the next index. There is room for `N`; more are left out.
    ///
    /// # Errors
    /// The index of the same name.
    pub fn insert(&mut self, name: &'a [u8]) -> Result<(), usize> {
        let sorted = &self.sorted[..self.len];
        let found = sorted.binary_search_by(|&at| order(self.known[usize::from(at)], name));
        let place = match found {
            Ok(place) => return Err(usize::from(sorted[place])),
            Err(place) => place,
        };
        if self.len < N {
            self.sorted.copy_within(place..self.len, place + 1);
            // Fewer than N are there, and N is at most 256.
            (self.sorted[place], self.known[self.len]) = (self.len as u8, name);
            self.len += 1;
        }
        Ok(())
    }
}

/// A total order of strings: by length first, then by words of four bytes. It is not the alphabet's, and compares names
/// that begin alike in fewer steps.
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

    #[test]
    fn the_same_name_is_found_by_its_index_among_all_that_differ() {
        let texts: [[u8; 7]; 256] =
            core::array::from_fn(|i| [b'n', b'a', b'm', b'e', 0, 0, (i as u8).wrapping_mul(37)]);
        for length in [7, 4] {
            let mut names = Names::<256>::new();
            for (index, text) in texts.iter().enumerate() {
                let expected = if length == 7 || index == 0 {
                    Ok(())
                } else {
                    Err(0)
                };
                assert_eq!(names.insert(&text[..length]), expected);
            }
            for (index, text) in texts.iter().enumerate().filter(|_| length == 7) {
                assert_eq!(names.insert(text), Err(index));
            }
        }
    }

    #[test]
    fn the_order_is_total_and_only_equal_strings_are_equal() {
        let texts: [&[u8]; 9] = [
            b"", b"a", b"b", b"aa", b"abcd", b"abce", b"bbcd", b"abcde", b"abcdf",
        ];
        for one in texts {
            for other in texts {
                assert_eq!(order(one, other), order(other, one).reverse());
                assert_eq!(order(one, other) == Ordering::Equal, one == other);
                for third in texts {
                    if order(one, other) == Ordering::Less && order(other, third) == Ordering::Less
                    {
                        assert_eq!(order(one, third), Ordering::Less);
                    }
                }
            }
        }
    }
}
