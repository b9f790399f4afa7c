//! Discrete Fourier transforms of real signals, and of bands of their spectra.

use std::cell::RefCell;

use realfft::RealFftPlanner;
pub use realfft::num_complex::Complex;
use rustfft::FftPlanner;

/// Plans and scratch memory that the transforms of a thread share. Plans are made once, because a grid has hundreds of
/// recordings of equal length.
struct Plans {
    of_reals: RealFftPlanner<f64>,
    of_complex: FftPlanner<f64>,
    scratch: Vec<Complex<f64>>,
}

thread_local! {
    static PLANS: RefCell<Plans> = RefCell::new(Plans {
        of_reals: RealFftPlanner::new(),
        of_complex: FftPlanner::new(),
        scratch: Vec::new(),
    });
}

/// Returns the first `length` values of `scratch`, which is enlarged if necessary.
fn first(scratch: &mut Vec<Complex<f64>>, length: usize) -> &mut [Complex<f64>] {
    if scratch.len() < length {
        scratch.resize(length, Complex::default());
    }
    &mut scratch[..length]
}

/// Returns the bins of a signal of at least one sample, from 0 Hz to half the sample rate, without scaling. The
/// contents of `signal` are destroyed.
pub fn forward(signal: &mut [f64]) -> Vec<Complex<f64>> {
    PLANS.with_borrow_mut(|plans| {
        let plan = plans.of_reals.plan_fft_forward(signal.len());
        let mut spectrum = plan.make_output_vec();
        let scratch = first(&mut plans.scratch, plan.get_scratch_len());
        plan.process_with_scratch(signal, &mut spectrum, scratch)
            .expect("lengths come from the plan");
        spectrum
    })
}

/// Returns the signal of `length` samples that has these bins, multiplied by `length`. The contents of `spectrum` are
/// destroyed.
///
/// The imaginary part of the bin at 0 Hz is ignored, and for an even length that of the bin at half the sample rate. In
/// the spectrum of a real signal, these parts are only round-off.
pub fn inverse(spectrum: &mut [Complex<f64>], length: usize) -> Vec<f64> {
    spectrum[0].im = 0.0;
    if length.is_multiple_of(2) {
        spectrum[length / 2].im = 0.0;
    }
    PLANS.with_borrow_mut(|plans| {
        let plan = plans.of_reals.plan_fft_inverse(length);
        let mut signal = plan.make_output_vec();
        let scratch = first(&mut plans.scratch, plan.get_scratch_len());
        plan.process_with_scratch(spectrum, &mut signal, scratch)
            .expect("lengths come from the plan, and ends are real");
        signal
    })
}

/// Replaces the bins of a complex signal, with those of negative frequencies last, by the signal multiplied by the
/// number of bins.
pub fn inverse_complex(bins: &mut [Complex<f64>]) {
    PLANS.with_borrow_mut(|plans| {
        let plan = plans.of_complex.plan_fft_inverse(bins.len());
        let scratch = first(&mut plans.scratch, plan.get_inplace_scratch_len());
        plan.process_with_scratch(bins, scratch);
    });
}

/// Returns the `length` lags of the autocorrelation whose power spectrum is `power`, multiplied by `length`.
pub fn of_power(power: &[f64], length: usize) -> Vec<f64> {
    let mut spectrum: Vec<_> = power.iter().map(|&p| Complex::new(p, 0.0)).collect();
    inverse(&mut spectrum, length)
}

/// Returns an even length of at least `least` whose transform is fast: it has no prime factors other than 2, 3 and 5,
/// and few of 5.
pub fn quick_length(least: usize) -> usize {
    let least = least.max(2);
    // Measured: each factor of 5 costs a twelfth, each of 3 a hundredth, and each of 2 below six of them a sixteenth of
    // the time for a power of two.
    let candidate = |threes: i32, fives: i32| {
        let odd = 3usize.pow(threes as u32) * 5usize.pow(fives as u32);
        // A real transform of even length is computed as a complex transform of half the length.
        let twos = least.div_ceil(odd).next_power_of_two().ilog2().max(1);
        let slowness = 1.0 + f64::from(fives) / 12.0 + f64::from(threes) / 100.0 + f64::from(6 - twos.min(6)) / 16.0;
        let length = odd << twos;
        (length as f64 * slowness, length)
    };
    let candidates = (0..=5).flat_map(|threes| (0..=2).map(move |fives| candidate(threes, fives)));
    let quickest = candidates.min_by(|a, b| a.0.total_cmp(&b.0));
    quickest.expect("there are candidates").1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_gives_a_signal_back_times_its_length_whatever_its_ends_have_beside_the_real_part() {
        for length in [1, 2, 7, 1000] {
            let signal = test_helpers::noise(3, length);
            let mut bins = forward(&mut signal.clone());
            assert_eq!(bins.len(), length / 2 + 1);
            let mirrored = (1..length.div_ceil(2)).rev().map(|bin| bins[bin].conj());
            let mut all: Vec<_> = bins.iter().copied().chain(mirrored).collect();
            inverse_complex(&mut all);
            bins[0].im = 1.0;
            let back = inverse(&mut bins, length);
            for ((back, as_complex), x) in back.iter().zip(all).zip(&signal) {
                test_helpers::near(back / length as f64, *x, 1e-12);
                test_helpers::near(as_complex.re / length as f64, *x, 1e-12);
                test_helpers::near(as_complex.im, 0.0, 1e-9);
            }
        }
    }

    #[test]
    fn quick_lengths_have_no_factor_above_five_and_are_at_most_a_third_longer_than_the_signal() {
        for least in 130..60_000 {
            let length = quick_length(least);
            let is_quick = test_helpers::largest_factor(length) <= 5;
            assert!(
                is_quick && length >= least && 3 * length <= 4 * least,
                "{least}: {length}"
            );
        }
    }
}
