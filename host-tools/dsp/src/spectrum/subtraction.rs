//! Spectral subtraction: removes from a signal the power of a noise whose spectrum is known.

use super::power::PowerSpectrum;
use crate::fourier;

/// Least fraction of a bin's power that is kept. Below it, only the scatter of both estimates would remain.
const LEAST_SHARE: f64 = 0.01;

/// Bandwidth, in octaves, over which the remaining power is smoothed where the noise has most of the power. It is half
/// the width of the bands in which textures are distinguished.
const SMOOTHING_OCTAVES: f64 = 1.0 / 6.0;

/// Returns `signal` at `rate_hz` without a noise of the spectrum `noise`. `whole` is the spectrum of the signal itself,
/// with segments of the same length. The phases are those of the signal (Boll, IEEE Trans. ASSP 27, 1979, 113, for
/// powers).
///
/// P is the density of the signal at a bin's frequency, N that of the noise, and w = min(1, N / P) is the noise's
/// fraction of the power. A bin of density p becomes w R + (1 - w) max(1 - w, 0.01) p, which is P - N on average. R is
/// the mean of max(P - N, 0.01 P) over a sixth of an octave, weighted by w. So where the noise is weak, details come
/// from the signal. Where the noise is strong, details would be the noise's tones and the scatter of two estimates, so
/// the spectrum is smooth.
pub fn without_noise(signal: &[f64], whole: &PowerSpectrum, noise: &PowerSpectrum, rate_hz: f64) -> Vec<f64> {
    if signal.len() < 2 || noise.power_between(0.0, rate_hz) <= 0.0 {
        return signal.to_vec();
    }
    // The signal is continued at its end by its mirror image. Otherwise the jump from end to beginning would have
    // components at all frequencies and become a click where the noise is weaker. Two more images of its last samples
    // make a quick length.
    let length = fourier::quick_length(2 * signal.len());
    let last = &signal[signal.len() - (length / 2 - signal.len()).min(signal.len())..];
    let images = last.iter().rev().chain(last).chain(signal.iter().rev());
    let mut mirrored: Vec<f64> = signal.iter().chain(images).copied().collect();
    let length = mirrored.len();
    let mut spectrum = fourier::forward(&mut mirrored);
    let [shares, rest] = shares_and_rest(whole, noise);
    // Factor from the squared magnitude of a bin to its density.
    let to_density = 2.0 / (rate_hz * length as f64);
    // The first bin is the mean, which a spectrum of powers does not contain.
    for (bin, value) in spectrum.iter_mut().enumerate().skip(1) {
        let hz = bin as f64 * rate_hz / length as f64;
        let own = to_density * value.norm_sqr();
        if own > 0.0 {
            let share = shares.density_at(hz);
            let kept = (1.0 - share) * (1.0 - share).max(LEAST_SHARE);
            *value *= (kept + share * rest.density_at(hz) / own).sqrt();
        }
    }
    let mut cleaned = fourier::inverse(&mut spectrum, length);
    cleaned.truncate(signal.len());
    for sample in &mut cleaned {
        *sample /= length as f64;
    }
    cleaned
}

/// Returns the noise's fraction of the power of `whole`, 0 to 1, and the smoothed density of the remaining power, at
/// the frequencies of both spectra.
fn shares_and_rest(whole: &PowerSpectrum, noise: &PowerSpectrum) -> [PowerSpectrum; 2] {
    let densities = || whole.density.iter().zip(&noise.density);
    let share = |(all, taken): (&f64, &f64)| {
        if *all > 0.0 { (taken / all).min(1.0) } else { 0.0 }
    };
    let shares: Vec<f64> = densities().map(share).collect();
    let rest = whole
        .density
        .iter()
        .zip(&shares)
        .map(|(all, share)| all * (1.0 - share).max(LEAST_SHARE));
    // Cumulative sums, up to each bin, of the weights and of the weighted values.
    let mut sums = vec![(0.0, 0.0)];
    for (rest, share) in rest.zip(&shares) {
        let (weight, weighed) = sums[sums.len() - 1];
        sums.push((weight + share, weighed + share * rest));
    }
    let ratio = (SMOOTHING_OCTAVES / 2.0).exp2();
    let mean = |bin: usize| {
        let first = (bin as f64 / ratio).ceil() as usize;
        let end = ((bin as f64 * ratio) as usize + 1).min(shares.len());
        let (weight, weighed) = (sums[end].0 - sums[first].0, sums[end].1 - sums[first].1);
        // Without noise, only the round-off of the sums may remain.
        if weight > 0.0 { (weighed / weight).max(0.0) } else { 0.0 }
    };
    let smooth = (0..shares.len()).map(mean).collect();
    [shares, smooth].map(|density| whole.with_density(density))
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{RATE_HZ, scaled, sine};
    use super::*;
    use proptest::prelude::*;
    use test_helpers::noise;

    const SEGMENT: usize = 1000;

    fn spectrum(signal: &[f64]) -> PowerSpectrum {
        PowerSpectrum::of_blocks(&[signal], SEGMENT, RATE_HZ)
    }

    fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| a + b).collect()
    }

    fn decibels(ratio: f64) -> f64 {
        10.0 * ratio.log10()
    }

    /// White noise through y(n) = x(n) + `pole` y(n - 1).
    fn coloured(seed: u64, pole: f64) -> Vec<f64> {
        let mut before = 0.0;
        let step = |x: f64| {
            before = x + pole * before;
            before
        };
        noise(seed, 100_000).into_iter().map(step).collect()
    }

    proptest! {
        #[test]
        fn noise_of_no_power_changes_nothing(len in 0usize..3000, seed: u64) {
            let signal = noise(seed, len);
            let silence = spectrum(&vec![0.0; SEGMENT]);
            prop_assert_eq!(&without_noise(&signal, &spectrum(&signal), &silence, RATE_HZ), &signal);
        }

        #[test]
        fn whatever_is_taken_off_the_rest_is_finite_and_no_stronger(
            seed in 0u64..1000, level in -3.0..3.0f64, pole in -0.99..0.99f64,
        ) {
            let signal = coloured(seed, pole);
            let other = scaled(&noise(seed + 1, 20_000), 10f64.powf(level));
            let rest = without_noise(&signal, &spectrum(&signal), &spectrum(&other), RATE_HZ);
            let power = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>();
            prop_assert!(rest.iter().all(|x| x.is_finite()));
            prop_assert!(power(&rest) <= 1.01 * power(&signal));
            // At the highest frequencies, the smoothing window extends only to lower ones.
            prop_assert!(power(&rest) >= 0.5 * LEAST_SHARE * power(&signal));
        }
    }

    #[test]
    fn noise_as_strong_as_the_signal_or_three_times_leaves_the_signals_spectrum() {
        for (level, tolerance_db) in [(1.0, 0.3), (1.7, 0.8)] {
            let (own, taken) = (coloured(1, 0.5), coloured(2, 0.5));
            let heard = sum(&own, &scaled(&taken, level));
            let known = spectrum(&scaled(&coloured(3, 0.5), level));
            let rest = spectrum(&without_noise(&heard, &spectrum(&heard), &known, RATE_HZ));
            for low_hz in [50.0, 200.0, 800.0, 2000.0] {
                let band = |spectrum: &PowerSpectrum| spectrum.power_between(low_hz, 1.25 * low_hz);
                let off_db = decibels(band(&rest) / band(&spectrum(&own)));
                assert!(off_db.abs() < tolerance_db, "{level}, {low_hz} Hz: {off_db} dB");
            }
        }
    }

    /// Weak noise added to a strong signal whose beginning and end do not match.
    #[test]
    fn what_is_left_is_no_louder_at_the_ends_than_elsewhere() {
        let (strong, weak) = (sine(20_000, 120.3, 1.0), scaled(&noise(1, 20_000), 0.003));
        let known = spectrum(&scaled(&noise(2, 20_000), 0.003));
        let heard = sum(&strong, &weak);
        let rest = without_noise(&heard, &spectrum(&heard), &known, RATE_HZ);
        // Only the noise: the third difference removes the tone.
        let step = |signal: Vec<f64>| -> Vec<f64> { signal.windows(2).map(|pair| pair[1] - pair[0]).collect() };
        let fast = step(step(step(rest)));
        let power = crate::sums::mean_square;
        for end in [&fast[..100], &fast[fast.len() - 100..]] {
            let over_db = decibels(power(end) / power(&fast));
            assert!(over_db < 3.0, "{over_db} dB over the whole");
        }
    }

    /// A tone that is far stronger than the signal is reduced to the level of its neighbourhood.
    #[test]
    fn a_tone_of_the_noise_is_neither_left_as_a_line_nor_as_a_gap() {
        let (own, tone) = (noise(1, 100_000), sine(100_000, 733.3, 0.4));
        let heard = sum(&own, &tone);
        let known = spectrum(&sum(&scaled(&noise(2, 100_000), 0.01), &sine(100_000, 733.3, 0.4)));
        let rest = without_noise(&heard, &spectrum(&heard), &known, RATE_HZ);
        // The resolution is finer than that of the estimates, so that a remaining line would show.
        let fine = |signal: &[f64]| PowerSpectrum::of_blocks(&[signal], 10_000, RATE_HZ);
        let (before, after) = (fine(&own), fine(&rest));
        let line = |spectrum: &PowerSpectrum| spectrum.power_between(732.0, 735.0);
        let around = |spectrum: &PowerSpectrum| spectrum.power_between(715.0, 750.0);
        assert!(decibels(line(&fine(&heard)) / line(&before)) > 15.0);
        assert!(
            decibels(line(&after) / line(&before)).abs() < 6.0,
            "{}",
            line(&after) / line(&before)
        );
        assert!(decibels(around(&after) / around(&before)).abs() < 2.0);
    }
}
