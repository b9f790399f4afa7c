//! Wavelet streams of MPEG haptics, in three stages.
//!
//! - The wavelet transform of a block, with the 9-tap and 7-tap filters of Cohen, Daubechies and Feauveau, computed by
//!   the lifting steps of Daubechies and Sweldens (J. Fourier Anal. Appl. 4, 1998, 247).
//! - Set partitioning in hierarchical trees (Said and Pearlman, IEEE Trans. Circuits Syst. Video Technol. 6, 1996,
//!   243), in one dimension: the children of coefficient i are 2i and 2i + 1.
//! - The adaptive binary arithmetic coder: registers of 10 bits, and a probability per context.

use std::collections::VecDeque;
use std::f64::consts::SQRT_2;

/// Coefficients of the lifting steps in pairs: from the even samples to their odd neighbours, and from the odd samples
/// to their even neighbours.
const LIFTING_STEPS: [(f64, f64); 2] = [
    (-1.586_134_342_059_924, -0.052_980_118_572_961),
    (0.882_911_075_530_934, 0.443_506_852_043_971),
];

/// Gain of the lifting steps for a constant signal.
const GAIN: f64 = 1.230_174_104_914_001;

/// Number of means that are not divided any further.
const MEANS: usize = 4;

/// Transforms a block, whose length is a power of two, in place. The result consists of the means of the coarsest
/// level, followed by the details from the coarsest to the finest level. A block is mirrored at its ends.
///
/// Means have a gain of √2 per level. A detail is the negative difference between a sample and its neighbours, as in
/// the standard.
pub fn transform(block: &mut [f64]) {
    let mut length = block.len();
    while length > MEANS {
        split(&mut block[..length]);
        length /= 2;
    }
}

/// Computes one level: means to the first half of `samples`, details to the second half.
fn split(samples: &mut [f64]) {
    let half = samples.len() / 2;
    let mut means: Vec<f64> = samples.iter().copied().step_by(2).collect();
    let mut details: Vec<f64> = samples.iter().copied().skip(1).step_by(2).collect();
    for (to_details, to_means) in LIFTING_STEPS {
        for n in 0..half {
            // The mirror image of a block shows the same neighbour beyond its end.
            details[n] += to_details * (means[n] + means[(n + 1).min(half - 1)]);
        }
        for n in 0..half {
            means[n] += to_means * (details[n.saturating_sub(1)] + details[n]);
        }
    }
    for n in 0..half {
        samples[n] = means[n] * (SQRT_2 / GAIN);
        samples[half + n] = details[n] * (-GAIN / SQRT_2);
    }
}

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
const SINGLE_AT_START: usize = 8;

/// Encodes `coefficients` by set partitioning, from bit `highest` of their magnitudes to bit 0. Their number is a power
/// of two and at least eight. `put` receives the context and then the bit.
pub fn partition(coefficients: &[i32], highest: u32, mut put: impl FnMut(usize, bool)) {
    let count = coefficients.len();
    let magnitude = |i: usize| coefficients[i].unsigned_abs();
    // Largest magnitude below each root in its tree.
    let mut below = vec![0; count];
    // From the leaves up, because each root needs the values of its children.
    for root in (1..count / 2).rev() {
        let largest = [2 * root, 2 * root + 1].map(|child| magnitude(child).max(below[child]));
        below[root] = largest[0].max(largest[1]);
    }
    let (mut small, mut large): (Vec<_>, Vec<_>) = ((0..SINGLE_AT_START).collect(), Vec::new());
    // Roots of sets in which all coefficients are below the threshold so far. A set is everything below a root, or
    // everything below the root's children.
    let mut sets: Vec<_> = (SINGLE_AT_START / 2..SINGLE_AT_START)
        .map(|root| (root, BELOW))
        .collect();
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

/// Top of the coder's range, and its half and quarter.
const RANGE_TOP: u32 = 1024;
const RANGE_HALF: u32 = RANGE_TOP / 2;
const RANGE_QUARTER: u32 = RANGE_TOP / 4;

/// Counts of zeros, and of all symbols, with which each context starts.
const START_COUNTS: (u32, u32) = (8, 16);

/// A coder with the bits that it has written.
pub struct Coder {
    bits: Vec<bool>,
    low: u32,
    high: u32,
    /// Number of inverted copies of the next bit that will follow it.
    pending: usize,
    /// Counts of zeros and of all symbols in each context.
    seen: [(u32, u32); CONTEXTS],
}

impl Default for Coder {
    fn default() -> Self {
        let (bits, seen) = (Vec::new(), [START_COUNTS; CONTEXTS]);
        Self {
            bits,
            low: 0,
            high: RANGE_TOP,
            pending: 0,
            seen,
        }
    }
}

impl Coder {
    /// Encodes one symbol of `context`.
    pub fn push(&mut self, context: usize, symbol: bool) {
        let (zeros, all) = &mut self.seen[context];
        let share = (f64::from(*zeros) / f64::from(*all) * f64::from(RANGE_TOP)).round() as u32;
        let range = self.high - self.low;
        // Both symbols keep a part of the range, otherwise an improbable one could not be written.
        let split = self.low + (range * share / RANGE_TOP).clamp(1, range - 1);
        (self.low, self.high) = if symbol { (split, self.high) } else { (self.low, split) };
        *zeros += u32::from(!symbol);
        *all += 1;
        self.widen();
    }

    /// Doubles the range until it is wider than a quarter, and writes the bits that are certain.
    fn widen(&mut self) {
        loop {
            let below = if self.high <= RANGE_HALF {
                self.put(false);
                0
            } else if self.low >= RANGE_HALF {
                self.put(true);
                RANGE_HALF
            } else if self.low >= RANGE_QUARTER && self.high <= RANGE_TOP - RANGE_QUARTER {
                // The next bit is open, and the bit after it will be its inverse.
                self.pending += 1;
                RANGE_QUARTER
            } else {
                return;
            };
            (self.low, self.high) = (2 * (self.low - below), 2 * (self.high - below));
        }
    }

    fn put(&mut self, bit: bool) {
        self.bits.push(bit);
        let inverted = std::iter::repeat_n(!bit, std::mem::take(&mut self.pending));
        self.bits.extend(inverted);
    }

    /// Returns the bits, with the first bit as the highest of its byte. A reader must assume zeros after the last bit.
    pub fn finish(mut self) -> Vec<u8> {
        // One half lies within the range. Inverted copies of its bit would be zeros, which need not be written.
        self.bits.push(true);
        let push = |byte, &bit: &bool| byte >> 1 | u8::from(bit) << 7;
        self.bits
            .chunks(8)
            .map(|bits| bits.iter().rev().fold(0, push))
            .collect()
    }
}
