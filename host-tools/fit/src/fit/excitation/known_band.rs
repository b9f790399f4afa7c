//! What a recording does not hold of the residual: nothing but round-off is above half of a rate below the models', and
//! nothing but ringing and leakage below the cut of the filter against a hand's motion. The model is filled in there,
//! and so is the residual, with Gaussian noise at the level of the rest, as in a texture without parts. Whitening would
//! make the little that is left as loud as the rest, and it comes in bursts.

use std::ops::Range;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use stylus_dsp::fourier::{self, Complex};

use model_format::SAMPLE_RATE_HZ;

/// Samples at both ends in which the conversion's filter rings: 20 ms.
pub(super) const ENDS: usize = 100;

/// Returns `residual` with Gaussian noise outside of the band `known_hz`. The noise is the same for each call.
pub(super) fn filled(residual: &[f64], known_hz: &Range<f64>) -> Vec<f64> {
    // Continued by its beginning, because a transform of the samples' number alone may be slow.
    let length = fourier::quick_length(residual.len());
    let mut circle: Vec<f64> = residual.iter().copied().cycle().take(length).collect();
    let mut spectrum = fourier::forward(&mut circle);
    let bin = |hz: f64| (hz / f64::from(SAMPLE_RATE_HZ) * length as f64) as usize;
    let end = bin(known_hz.end).clamp(1, spectrum.len());
    let first = bin(known_hz.start).min(end - 1);
    let (below, known) = spectrum.split_at_mut(first);
    let (known, above) = known.split_at_mut(end - first);
    let power = known.iter().map(Complex::norm_sqr).sum::<f64>() / known.len() as f64;
    let mut generator = Pcg64::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    for bin in above.iter_mut().chain(below.iter_mut().skip(1)) {
        // A bin's power is shared by its real and its imaginary part.
        *bin = Complex::new(normal(), normal()) * (power / 2.0).sqrt();
    }
    let mut signal = fourier::inverse(&mut spectrum, length);
    signal.truncate(residual.len());
    signal.iter_mut().for_each(|x| *x /= length as f64);
    signal
}
