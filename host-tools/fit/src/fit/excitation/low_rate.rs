//! The residual of a recording at a rate below the models'.
//!
//! Such a recording holds nothing above half its own rate except round-off of the conversion. That band is replaced by
//! Gaussian noise at the level of the band below, as in a texture without parts.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use model_format::SAMPLE_RATE_HZ;

use crate::dsp::fourier::{self, Complex};

/// Samples at both ends in which the conversion's filter rings: 20 ms.
pub(super) const ENDS: usize = 100;

/// Returns `residual` with Gaussian noise above `carried_hz`. The noise is the same for each call.
pub(super) fn filled(residual: &[f64], carried_hz: f64) -> Vec<f64> {
    let length = residual.len();
    let mut spectrum = fourier::forward(&mut residual.to_vec());
    let first = (carried_hz / f64::from(SAMPLE_RATE_HZ) * length as f64) as usize;
    let first = first.clamp(1, spectrum.len());
    let (known, empty) = spectrum.split_at_mut(first);
    let power = known.iter().map(Complex::norm_sqr).sum::<f64>() / known.len() as f64;
    let mut generator = Pcg64::seed_from_u64(1);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    for bin in empty {
        // A bin's power is shared by its real and its imaginary part.
        *bin = Complex::new(normal(), normal()) * (power / 2.0).sqrt();
    }
    let mut signal = fourier::inverse(&mut spectrum, length);
    signal.iter_mut().for_each(|x| *x /= length as f64);
    signal
}
