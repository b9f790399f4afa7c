//! The fingerprint of a recording, by which `fit` finds copies among the trials of a set.
//!
//! Invariant: a fingerprint is compared within one run and never stored, because Rust may change its hash function.

/// Returns a 64-bit hash of the samples of one to three axes, m/s² at 5 kHz, after cut and scale.
///
/// Samples with equal bits give equal hashes; 0.0 and -0.0 differ. Other samples almost certainly give another hash.
pub fn fingerprint(axes: &[Vec<f64>]) -> u64 {
    use std::hash::{DefaultHasher, Hasher};
    let mut hasher = DefaultHasher::new();
    for axis in axes {
        hasher.write_usize(axis.len());
        // Eight independent lanes, because the processor can then overlap their multiplications.
        let mut mixed = [0u64; 8];
        for chunk in axis.chunks(8) {
            for (mix, sample) in mixed.iter_mut().zip(chunk) {
                *mix = (mix.rotate_left(5) ^ sample.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            }
        }
        mixed.into_iter().for_each(|mix| hasher.write_u64(mix));
    }
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::noise;
    use super::*;

    #[test]
    fn fingerprints_tell_samples_apart_and_not_copies() {
        let (a, b) = (vec![noise(1)], vec![noise(2)]);
        assert_eq!(fingerprint(&a), fingerprint(&a.clone()));
        assert_ne!(fingerprint(&a), fingerprint(&b));
        let mut close = a.clone();
        close[0][9999] += 1e-12;
        assert_ne!(fingerprint(&a), fingerprint(&close));
    }
}
