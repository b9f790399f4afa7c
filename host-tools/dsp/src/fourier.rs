//! Discrete Fourier transforms of real signals.

use std::cell::RefCell;

use realfft::RealFftPlanner;
pub use realfft::num_complex::Complex;

thread_local! {
    /// Plans are made once per thread, because a grid has hundreds of recordings of equal length.
    static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
}

/// Returns the bins of a signal of at least one sample, from 0 Hz to half the sample rate, without scaling. The signal
/// is left in disorder.
pub fn forward(signal: &mut [f64]) -> Vec<Complex<f64>> {
    let plan = PLANNER.with_borrow_mut(|planner| planner.plan_fft_forward(signal.len()));
    let mut spectrum = plan.make_output_vec();
    let outcome = plan.process(signal, &mut spectrum);
    outcome.expect("lengths come from the plan");
    spectrum
}

/// Returns the signal of `length` samples that has these bins, times `length`. The bins are left in disorder.
///
/// The bin of 0 Hz, and that of half the rate of an even length, count as real, as those of real signals are: what
/// they have beside that is round-off.
pub fn inverse(spectrum: &mut [Complex<f64>], length: usize) -> Vec<f64> {
    spectrum[0].im = 0.0;
    if length.is_multiple_of(2) {
        spectrum[length / 2].im = 0.0;
    }
    let plan = PLANNER.with_borrow_mut(|planner| planner.plan_fft_inverse(length));
    let mut signal = plan.make_output_vec();
    let outcome = plan.process(spectrum, &mut signal);
    outcome.expect("lengths come from the plan, and ends are real");
    signal
}

/// Returns `length` lags whose power spectrum this is, times `length`.
pub fn of_power(power: &[f64], length: usize) -> Vec<f64> {
    let mut spectrum: Vec<_> = power.iter().map(|&p| Complex::new(p, 0.0)).collect();
    inverse(&mut spectrum, length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_gives_a_signal_back_times_its_length_whatever_its_ends_have_beside_the_real_part()
     {
        for length in [1, 2, 7, 1000] {
            let signal = test_helpers::noise(3, length);
            let mut bins = forward(&mut signal.clone());
            assert_eq!(bins.len(), length / 2 + 1);
            bins[0].im = 1.0;
            for (back, x) in inverse(&mut bins, length).iter().zip(&signal) {
                test_helpers::near(back / length as f64, *x, 1e-12);
            }
        }
    }
}
