//! The adaptive binary arithmetic coder of wavelet streams: registers of 10 bits, and a probability per context.

use super::set_partitioning::CONTEXTS;

/// Top of the range, and its half and quarter.
const TOP: u32 = 1024;
const HALF: u32 = TOP / 2;
const QUARTER: u32 = TOP / 4;

/// Counts of zeros, and of all symbols, with which each context starts.
const BEFORE: (u32, u32) = (8, 16);

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
        let (bits, seen) = (Vec::new(), [BEFORE; CONTEXTS]);
        Self {
            bits,
            low: 0,
            high: TOP,
            pending: 0,
            seen,
        }
    }
}

impl Coder {
    /// Encodes one symbol of `context`.
    pub fn push(&mut self, context: usize, symbol: bool) {
        let (zeros, all) = &mut self.seen[context];
        let share = (f64::from(*zeros) / f64::from(*all) * f64::from(TOP)).round() as u32;
        let range = self.high - self.low;
        // Both symbols keep a part of the range, otherwise an improbable one could not be written.
        let split = self.low + (range * share / TOP).clamp(1, range - 1);
        (self.low, self.high) = if symbol { (split, self.high) } else { (self.low, split) };
        *zeros += u32::from(!symbol);
        *all += 1;
        self.widen();
    }

    /// Doubles the range until it is wider than a quarter, and writes the bits that are certain.
    fn widen(&mut self) {
        loop {
            let below = if self.high <= HALF {
                self.put(false);
                0
            } else if self.low >= HALF {
                self.put(true);
                HALF
            } else if self.low >= QUARTER && self.high <= TOP - QUARTER {
                // The next bit is open, and the bit after it will be its inverse.
                self.pending += 1;
                QUARTER
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
