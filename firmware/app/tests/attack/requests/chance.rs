//! Chance of a schedule.

/// Chance by a generator of 64 bits (xorshift of Marsaglia).
pub struct Chance(u64);

impl Chance {
    /// Chance number `stream` of `seed`.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mixed = (seed ^ stream.wrapping_mul(0x9E37_79B9_7F4A_7C15)).wrapping_mul(0xD129_0DE5);
        let mut chance = Self(mixed | 1);
        for _ in 0..8 {
            chance.below(2);
        }
        chance
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 11) % bound as u64) as usize
    }
}
