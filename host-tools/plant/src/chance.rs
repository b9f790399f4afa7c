//! Random numbers that are the same for the same seed.

/// SplitMix64.
#[derive(Clone, Copy, Debug, Default)]
pub struct Chance(pub u64);

impl Chance {
    /// The next number.
    pub fn draw(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.draw() % bound
    }

    /// A number from 0 to below 1.
    pub fn fraction(&mut self) -> f64 {
        // The 53 upper bits are as many as a double holds.
        (self.draw() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number from -`most` to below `most`.
    pub fn within(&mut self, most: f64) -> f64 {
        most * (2.0 * self.fraction() - 1.0)
    }

    /// Returns `value`, multiplied or divided by a random factor of up to 1 + `share`, which is uniform in the
    /// logarithm.
    pub fn about(&mut self, value: f64, share: f64) -> f64 {
        value * self.within(share.ln_1p()).exp()
    }

    /// A number of the normal distribution (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        // 1 minus the fraction is never 0, whose logarithm is infinite.
        let radius = (-2.0 * (1.0 - self.fraction()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.fraction()).cos()
    }
}
