//! Random streams: one per effect and trial, so that no stream depends on the others or on the order of computation.

use rand::SeedableRng;
use rand_pcg::Pcg64;

/// The purpose of a stream, hashed to 64 bits (FNV-1a: Fowler, Noll, Vo).
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamKey(u64);

impl StreamKey {
    pub(super) fn new(seed: u64) -> Self {
        Self(0xCBF2_9CE4_8422_2325).bytes(&seed.to_le_bytes())
    }

    /// Adds a text. The byte 0xFF ends it, because UTF-8 never contains that byte.
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

/// Counts of the streams that the thread has begun, for tests of the effects that a rig draws for.
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

    /// Returns the number of streams per effect since the last call, and clears it.
    pub fn take() -> BTreeMap<String, usize> {
        EFFECTS.take()
    }
}
