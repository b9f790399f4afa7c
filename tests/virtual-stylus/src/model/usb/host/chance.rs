//! Random breaks of packets.

/// Random numbers from a seed (SplitMix64).
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance {
    pub(super) state: u64,
    pub(super) per_million: u64,
}

impl Chance {
    pub(super) fn breaks(&mut self) -> bool {
        if self.per_million == 0 {
            return false;
        }
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed ^ mixed >> 31) % 1_000_000 < self.per_million
    }
}
