//! Set partitioning in hierarchical trees (Said and Pearlman, IEEE Trans. Circuits Syst. Video Technol. 6, 1996, 243),
//! in one dimension: the children of coefficient i are 2i and 2i + 1.

use std::collections::VecDeque;

/// Number of contexts: one for the head of a stream, and those for its other bits.
pub const CONTEXTS: usize = 7;
/// Context of a stream's head.
pub const HEAD: usize = 0;
const SIGN: usize = 1;
const SINGLE: usize = 2;
const BELOW: usize = 3;
const CHILD: usize = 4;
const FAR_BELOW: usize = 5;
const REFINEMENT: usize = 6;

/// Number of coefficients that are coded one by one from the start. The second half of them are the roots of trees.
const FIRST: usize = 8;

/// Encodes `coefficients`, from bit `highest` of their magnitudes to bit 0. Their number is a power of two and at least
/// eight. `put` receives the context and then the bit.
pub fn code(coefficients: &[i32], highest: u32, mut put: impl FnMut(usize, bool)) {
    let count = coefficients.len();
    let magnitude = |i: usize| coefficients[i].unsigned_abs();
    // Largest magnitude below each root in its tree.
    let mut below = vec![0; count];
    // From the leaves up, because each root needs the values of its children.
    for root in (1..count / 2).rev() {
        let largest = [2 * root, 2 * root + 1].map(|child| magnitude(child).max(below[child]));
        below[root] = largest[0].max(largest[1]);
    }
    let (mut small, mut large): (Vec<_>, Vec<_>) = ((0..FIRST).collect(), Vec::new());
    // Roots of sets in which all coefficients are below the threshold so far. A set is everything below a root, or
    // everything below the root's children.
    let mut sets: Vec<_> = (FIRST / 2..FIRST).map(|root| (root, BELOW)).collect();
    for threshold in (0..=highest).rev().map(|bit| 1 << bit) {
        let put_single = |i: usize, context, put: &mut dyn FnMut(usize, bool)| {
            let is_large = magnitude(i) >= threshold;
            put(context, is_large);
            if is_large {
                put(SIGN, coefficients[i] >= 0);
            }
            is_large
        };
        let before = large.len();
        for i in std::mem::take(&mut small) {
            let is_large = put_single(i, SINGLE, &mut put);
            if is_large { &mut large } else { &mut small }.push(i);
        }
        // Sets that are divided in this pass are examined in the same pass, as the standard's decoder expects.
        let mut queue = VecDeque::from(std::mem::take(&mut sets));
        while let Some((root, kind)) = queue.pop_front() {
            let children = [2 * root, 2 * root + 1];
            let largest = match kind {
                BELOW => below[root],
                _ => below[children[0]].max(below[children[1]]),
            };
            put(kind, largest >= threshold);
            if largest < threshold {
                sets.push((root, kind));
            } else if kind == FAR_BELOW {
                queue.extend(children.map(|child| (child, BELOW)));
            } else {
                for child in children {
                    let is_large = put_single(child, CHILD, &mut put);
                    if is_large { &mut large } else { &mut small }.push(child);
                }
                // Otherwise the children are the finest details, which have no children.
                if 4 * root + 3 < count {
                    queue.push_back((root, FAR_BELOW));
                }
            }
        }
        // A coefficient that became large in this pass has already shown this bit.
        for &i in &large[..before] {
            put(REFINEMENT, magnitude(i) & threshold != 0);
        }
    }
}
