//! Set partitioning in hierarchical trees (Said and Pearlman, IEEE Trans. Circuits Syst. Video Technol. 6, 1996, 243),
//! of one dimension: the children of coefficient i are 2i and 2i + 1.

use std::collections::VecDeque;

/// Number of contexts: that of a stream's head, and those of the bits below.
pub const CONTEXTS: usize = 7;
/// Context of a stream's head.
pub const HEAD: usize = 0;
const SIGN: usize = 1;
const SINGLE: usize = 2;
const BELOW: usize = 3;
const CHILD: usize = 4;
const FAR_BELOW: usize = 5;
const REFINEMENT: usize = 6;

/// Coefficients that are coded one by one from the start; the second half of them are roots of trees.
const FIRST: usize = 8;

/// A set of coefficients below a root, all small so far.
#[derive(Clone, Copy)]
enum Set {
    /// All below the root.
    Below(usize),
    /// All below the root's children.
    FarBelow(usize),
}

/// Codes `coefficients`, at least eight and a power of two in number, from bit `highest` of their magnitudes to bit 0.
/// `put` takes each bit after its context.
pub fn code(coefficients: &[i32], highest: u32, mut put: impl FnMut(usize, bool)) {
    let count = coefficients.len();
    let magnitude = |i: usize| coefficients[i].unsigned_abs();
    let mut below = vec![0; count];
    for root in (1..count / 2).rev() {
        let children = [2 * root, 2 * root + 1];
        let largest = children.map(|child| magnitude(child).max(below[child]));
        below[root] = largest[0].max(largest[1]);
    }
    let mut small: Vec<usize> = (0..FIRST).collect();
    let mut large = Vec::new();
    let mut sets: Vec<Set> = (FIRST / 2..FIRST).map(Set::Below).collect();
    for bit in (0..=highest).rev() {
        let threshold = 1 << bit;
        let before = large.len();
        small.retain(|&i| {
            let is_small = !put_single(coefficients[i], threshold, SINGLE, &mut put);
            if !is_small {
                large.push(i);
            }
            is_small
        });
        let mut queue = VecDeque::from(std::mem::take(&mut sets));
        while let Some(set) = queue.pop_front() {
            let (largest, context) = match set {
                Set::Below(root) => (below[root], BELOW),
                Set::FarBelow(root) => (below[2 * root].max(below[2 * root + 1]), FAR_BELOW),
            };
            put(context, largest >= threshold);
            match set {
                _ if largest < threshold => sets.push(set),
                Set::Below(root) => {
                    for child in [2 * root, 2 * root + 1] {
                        let is_large = put_single(coefficients[child], threshold, CHILD, &mut put);
                        if is_large { &mut large } else { &mut small }.push(child);
                    }
                    if 4 * root + 3 < count {
                        queue.push_back(Set::FarBelow(root));
                    }
                }
                Set::FarBelow(root) => {
                    queue.extend([2 * root, 2 * root + 1].map(Set::Below));
                }
            }
        }
        for &i in &large[..before] {
            put(REFINEMENT, magnitude(i) & threshold != 0);
        }
    }
}

/// Puts whether a coefficient reaches `threshold`, with its sign if it does, and returns that.
fn put_single(
    coefficient: i32,
    threshold: u32,
    context: usize,
    put: &mut impl FnMut(usize, bool),
) -> bool {
    let is_large = coefficient.unsigned_abs() >= threshold;
    put(context, is_large);
    if is_large {
        put(SIGN, coefficient >= 0);
    }
    is_large
}
