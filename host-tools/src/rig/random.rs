//! One random stream for each effect of each trial, so that none depends on what else is computed, or when.

use rand::SeedableRng;
use rand_pcg::Pcg64;

/// What a stream is for, folded into 64 bits (FNV-1a: Fowler, Noll, Vo).
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamKey(u64);

impl StreamKey {
    pub(super) fn new(seed: u64) -> Self {
        Self(0xCBF2_9CE4_8422_2325).bytes(&seed.to_le_bytes())
    }

    /// 0xFF ends a text, as it occurs in no UTF-8.
    pub(super) fn text(self, text: &str) -> Self {
        self.bytes(text.as_bytes()).bytes(&[0xFF])
    }

    pub(super) fn number(self, value: f64) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    pub(super) fn index(self, index: usize) -> Self {
        self.bytes(&(index as u64).to_le_bytes())
    }

    /// The stream of `effect`.
    pub(super) fn stream(self, effect: &str) -> Pcg64 {
        #[cfg(test)]
        drawn::note(effect);
        Pcg64::seed_from_u64(self.text(effect).0)
    }

    fn bytes(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3)
        }))
    }
}

/// Which streams the thread has begun, for tests of what a rig calls for.
#[cfg(test)]
pub(super) mod drawn {
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    thread_local! {
        static EFFECTS: RefCell<BTreeMap<String, usize>> = const { RefCell::new(BTreeMap::new()) };
    }

    pub(super) fn note(effect: &str) {
        EFFECTS.with_borrow_mut(|effects| *effects.entry(effect.to_owned()).or_default() += 1);
    }

    /// How many streams of each effect were begun since this was last asked.
    pub fn take() -> BTreeMap<String, usize> {
        EFFECTS.take()
    }
}
