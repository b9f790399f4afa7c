//! The adaptive binary arithmetic coder of wavelet streams: registers of 10 bits, and a probability per context.

use super::set_partitioning::CONTEXTS;

/// Top of the range, and its half and quarters.
const TOP: u32 = 1024;
const HALF: u32 = TOP / 2;
const QUARTER: u32 = TOP / 4;

/// Symbols that a context has seen before the first one, half of them zeros.
const BEFORE: u32 = 16;

/// A coder with the bits that it has put out.
#[derive(Debug)]
pub struct Coder {
    bits: Vec<bool>,
    low: u32,
    high: u32,
    /// Bits that follow the next one, inverted.
    pending: usize,
    /// Zeros and all symbols of each context.
    seen: [(u32, u32); CONTEXTS],
}

impl Coder {
    /// A coder before its first symbol.
    pub fn new() -> Self {
        Self {
            bits: Vec::new(),
            low: 0,
            high: TOP,
            pending: 0,
            seen: [(BEFORE / 2, BEFORE); CONTEXTS],
        }
    }

    /// Codes one symbol of `context`.
    pub fn push(&mut self, context: usize, symbol: bool) {
        let (zeros, all) = &mut self.seen[context];
        let share = (f64::from(*zeros) / f64::from(*all) * f64::from(TOP)).round() as u32;
        let range = self.high - self.low;
        let split = (range * share / TOP).clamp(1, range - 1);
        *zeros += u32::from(!symbol);
        *all += 1;
        if symbol {
            self.low += split;
        } else {
            self.high = self.low + split;
        }
        self.widen();
    }

    /// Doubles the range until it is wider than a quarter, and puts out the bits that are certain.
    fn widen(&mut self) {
        loop {
            let below = if self.high <= HALF {
                self.put(false);
                0
            } else if self.low >= HALF {
                self.put(true);
                HALF
            } else if self.low >= QUARTER && self.high <= TOP - QUARTER {
                self.pending += 1;
                QUARTER
            } else {
                return;
            };
            self.low = 2 * (self.low - below);
            self.high = 2 * (self.high - below);
        }
    }

    fn put(&mut self, bit: bool) {
        self.bits.push(bit);
        self.bits
            .extend(std::iter::repeat_n(!bit, std::mem::take(&mut self.pending)));
    }

    /// Returns the bits, first bit highest in its byte. A reader takes zeros after the last one.
    pub fn finish(mut self) -> Vec<u8> {
        // The half lies within the range.
        self.bits.push(true);
        let bytes = self.bits.chunks(8).map(|bits| {
            let places = bits.iter().zip((0..8).rev());
            places.map(|(bit, place)| u8::from(*bit) << place).sum()
        });
        bytes.collect()
    }
}
