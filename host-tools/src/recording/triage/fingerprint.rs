//! Recognition of equal recordings.

/// Returns a 64-bit hash of all samples: equal for equal samples, and almost certainly different for others.
pub fn fingerprint(axes: &[Vec<f64>]) -> u64 {
    use std::hash::{DefaultHasher, Hasher};
    let mut hasher = DefaultHasher::new();
    for axis in axes {
        hasher.write_usize(axis.len());
        // Eight samples per step, so that hashing costs far less than reading.
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
