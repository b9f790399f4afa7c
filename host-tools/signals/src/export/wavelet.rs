//! The wavelet transform of a block, with the 9-tap and 7-tap filters of Cohen, Daubechies and Feauveau, computed by
//! the lifting steps of Daubechies and Sweldens (J. Fourier Anal. Appl. 4, 1998, 247).

use std::f64::consts::SQRT_2;

/// Coefficients of the lifting steps in pairs: from the even samples to their odd neighbours, and from the odd samples
/// to their even neighbours.
const STEPS: [(f64, f64); 2] = [
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
    for (to_details, to_means) in STEPS {
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
