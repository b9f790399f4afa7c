//! Spectra of accelerations and the distances between them: the paper's cost (equation 6), power and error in
//! third-octave bands, and the log-spectral distance. "The paper" is Romano, Yoshioka and Kuchenbecker, ICRA 2010.
//!
//! Signals are real, evenly sampled at `rate_hz` and finite. Where a spectrum describes a random signal (bands,
//! log-spectral distance) it is Welch's estimate; where the paper asks for the DFT of one whole recording (the cost) it
//! is that.

use std::f64::consts::{PI, TAU};

use crate::dsp::with_planner;

/// Full width of the Hann kernel that smooths amplitudes, Hz, where nothing else is asked for. The paper does not give
/// the width of its own.
pub const DEFAULT_SMOOTHING_WIDTH_HZ: f64 = 20.0;

/// Smallest change of amplitude that is felt, dB: the lower of 2.2 to 2.5 dB (Israr 2006). Errors below it do not matter.
pub const AMPLITUDE_JND_DB: f64 = 2.2;

/// Third-octave bands from 20 Hz to 1 kHz: what skin feels and a stylus can play.
pub const BAND_COUNT: usize = 18;

/// Nominal centre frequencies of the bands, Hz, as IEC 61260-1 labels them.
pub const BAND_LABELS_HZ: [&str; BAND_COUNT] = [
    "20", "25", "31.5", "40", "50", "63", "80", "100", "125", "160", "200", "250", "315", "400",
    "500", "630", "800", "1000",
];

/// Duration of a segment of Welch's estimate, s: it resolves the lowest band, 4.6 Hz wide.
const SEGMENT_S: f64 = 1.0;

/// A third octave in base ten (IEC 61260-1), as a difference of decimal logarithms of frequency.
const THIRD_OCTAVE: f64 = 0.1;

/// How many windows of the log-spectral distance begin within a third octave.
const WINDOWS_PER_THIRD_OCTAVE: f64 = 10.0;

/// One-sided DFT amplitude |X(k)|, k = 0 ... ⌊N/2⌋, of a signal of any length N, in the signal's unit and not scaled.
///
/// Bin k stands at k · `rate_hz` / N. Nothing comes of nothing: an empty signal has no bins.
pub fn dft_amplitude(signal: &[f64]) -> Vec<f64> {
    if signal.is_empty() {
        return Vec::new();
    }
    let transform = with_planner(|planner| planner.plan_fft_forward(signal.len()));
    let mut input = signal.to_vec();
    let mut output = transform.make_output_vec();
    transform
        .process(&mut input, &mut output)
        .expect("both buffers have the lengths that the plan asks for");
    output.iter().map(|bin| bin.norm()).collect()
}

/// S{a}: [`dft_amplitude`] convolved with a Hann kernel whose full width, zero to zero, is `width_hz`.
///
/// At 0 Hz and at half the rate the kernel is cut off and what is left of it weighs one again, so that a flat spectrum
/// stays flat. A width of at most two bins is no smoothing. The work grows with N² · `width_hz` / `rate_hz`.
pub fn smoothed_amplitude(signal: &[f64], rate_hz: f64, width_hz: f64) -> Vec<f64> {
    smooth(
        &dft_amplitude(signal),
        rate_hz / signal.len() as f64,
        width_hz,
    )
}

/// Convolves values that are `step_hz` apart with a Hann kernel of full width `width_hz`, renormalised at both ends.
fn smooth(values: &[f64], step_hz: f64, width_hz: f64) -> Vec<f64> {
    let tail = hann_tail(width_hz / step_hz, values.len());
    // tail_sums[n] is the sum of the first n weights.
    let tail_sums: Vec<f64> = std::iter::once(0.0)
        .chain(tail.iter().scan(0.0, |sum, weight| {
            *sum += weight;
            Some(*sum)
        }))
        .collect();
    let mean_around = |centre: usize| {
        let (before, after) = (&values[..centre], &values[centre + 1..]);
        let left = before.iter().rev().zip(&tail);
        let right = after.iter().zip(&tail);
        let sum: f64 = left
            .chain(right)
            .map(|(value, weight)| value * weight)
            .sum();
        let weights =
            tail_sums[before.len().min(tail.len())] + tail_sums[after.len().min(tail.len())];
        (values[centre] + sum) / (1.0 + weights)
    };
    (0..values.len()).map(mean_around).collect()
}

/// Weights of a Hann kernel of full width `width` steps at 1, 2, ... steps from its centre, which weighs one; no more
/// than `most` of them.
fn hann_tail(width: f64, most: usize) -> Vec<f64> {
    (1..=most)
        .map(|offset| offset as f64)
        .take_while(|offset| offset < &(width / 2.0))
        .map(|offset| 0.5 + 0.5 * (TAU * offset / width).cos())
        .collect()
}

/// The paper's cost, equation (6): C = RMS(S{a} - S{a_g}) / RMS(S{a}), over all frequencies from 0 to half the rate.
///
/// S is [`smoothed_amplitude`]. The longer signal is cut at its end to the length of the shorter, since amplitudes of
/// different lengths do not compare. Two independent excerpts of one noise do not come to zero: see
/// [`expected_cost_of_noise`].
///
/// `None` when there is nothing to compare with: the recorded signal is empty or silent, or a value is not finite.
pub fn spectral_cost(
    recorded: &[f64],
    synthesised: &[f64],
    rate_hz: f64,
    width_hz: f64,
) -> Option<f64> {
    let len = recorded.len().min(synthesised.len());
    let reference = smoothed_amplitude(&recorded[..len], rate_hz, width_hz);
    let other = smoothed_amplitude(&synthesised[..len], rate_hz, width_hz);
    let difference: f64 = reference
        .iter()
        .zip(&other)
        .map(|(a, b)| (a - b).powi(2))
        .sum();
    let energy: f64 = reference.iter().map(|a| a * a).sum();
    Some((difference / energy).sqrt()).filter(|cost| cost.is_finite())
}

/// What [`spectral_cost`] comes to, about, between two independent excerpts, of `len` samples each, of one Gaussian
/// noise whose spectrum is broad: what a perfect model scores, since it does not copy the recording.
///
/// Amplitudes of Gaussian noise are Rayleigh distributed, with a variance of 4/π - 1 times their squared mean;
/// smoothing with weights w divides it by (Σw)²/Σw², and the difference of two has twice as much.
pub fn expected_cost_of_noise(len: usize, rate_hz: f64, width_hz: f64) -> f64 {
    let tail = hann_tail(width_hz * len as f64 / rate_hz, len / 2);
    let sum = 1.0 + 2.0 * tail.iter().sum::<f64>();
    let squares = 1.0 + 2.0 * tail.iter().map(|weight| weight * weight).sum::<f64>();
    let variance = (4.0 / PI - 1.0) * squares / (sum * sum);
    (2.0 * variance / (1.0 + variance)).sqrt()
}

/// A power spectral density: the power of a signal by frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct PowerSpectrum {
    /// (signal's unit)²/Hz, one-sided. Value k stands for the frequencies nearer to k · `step_hz` than to another.
    density: Vec<f64>,
    step_hz: f64,
    nyquist_hz: f64,
}

impl PowerSpectrum {
    /// Welch's estimate: the mean periodogram of Hann-windowed segments of 1 s, or of the whole signal where that is
    /// shorter. Segments overlap by half, or by a little more where that lets them end with the signal.
    ///
    /// Scaled by the window's energy, so that the density integrates to the power of a stationary signal. A signal of
    /// fewer than two samples has no power here, since a window of one sample is zero.
    pub fn welch(signal: &[f64], rate_hz: f64) -> Self {
        let segment = ((SEGMENT_S * rate_hz).round() as usize).clamp(1, signal.len().max(1));
        let window: Vec<f64> = (0..segment)
            .map(|n| 0.5 - 0.5 * (TAU * n as f64 / segment as f64).cos())
            .collect();
        let window_energy: f64 = window.iter().map(|weight| weight * weight).sum();
        let spare = signal.len().saturating_sub(segment);
        let hops = (2 * spare).div_ceil(segment);
        let mut density = vec![0.0; segment / 2 + 1];
        if segment > 1 {
            let scale = 2.0 / (rate_hz * window_energy * (hops + 1) as f64);
            for hop in 0..=hops {
                let begin = (spare * hop).checked_div(hops).unwrap_or(0);
                let windowed: Vec<f64> = signal[begin..]
                    .iter()
                    .zip(&window)
                    .map(|(value, weight)| value * weight)
                    .collect();
                for (sum, amplitude) in density.iter_mut().zip(dft_amplitude(&windowed)) {
                    *sum += scale * amplitude * amplitude;
                }
            }
        }
        Self {
            density,
            step_hz: rate_hz / segment as f64,
            nyquist_hz: rate_hz / 2.0,
        }
    }

    /// Power between two frequencies, (signal's unit)²: the integral of the density, with fractional bins at both ends.
    ///
    /// The bins at 0 Hz and at half the rate reach to those frequencies only, and nothing is beyond them.
    pub fn power_between(&self, low_hz: f64, high_hz: f64) -> f64 {
        let (low, high) = (low_hz.max(0.0), high_hz.min(self.nyquist_hz));
        if low >= high {
            return 0.0;
        }
        let first = (low / self.step_hz).round() as usize;
        let mut power = 0.0;
        for (index, density) in self.density.iter().enumerate().skip(first) {
            let (begin, end) = (
                (index as f64 - 0.5) * self.step_hz,
                (index as f64 + 0.5) * self.step_hz,
            );
            if begin >= high {
                break;
            }
            power += density * (end.min(high) - begin.max(low)).max(0.0);
        }
        power
    }
}

/// Exact centre frequency of band `band` of [`BAND_LABELS_HZ`], Hz: 1000 · 10^(k/10), k = -17 ... 0, base ten of
/// IEC 61260-1.
pub fn band_centre_hz(band: usize) -> f64 {
    frequency_on_band_scale_hz(band as f64)
}

/// Lower and upper edge of band `band`, Hz: its exact centre · 10^(∓1/20). One band ends where the next begins.
pub fn band_edges_hz(band: usize) -> (f64, f64) {
    // Halves are exact, so that an edge is the same number from both sides.
    let band = band as f64;
    (
        frequency_on_band_scale_hz(band - 0.5),
        frequency_on_band_scale_hz(band + 0.5),
    )
}

fn frequency_on_band_scale_hz(band: f64) -> f64 {
    1000.0 * 10f64.powf((band - (BAND_COUNT - 1) as f64) * THIRD_OCTAVE)
}

/// Power in each third-octave band, (signal's unit)², from [`PowerSpectrum::welch`].
///
/// A signal shorter than 1 s is resolved less finely than the lowest bands are wide, and shares power among them.
/// There is no power above half the rate.
pub fn band_powers(signal: &[f64], rate_hz: f64) -> [f64; BAND_COUNT] {
    let spectrum = PowerSpectrum::welch(signal, rate_hz);
    std::array::from_fn(|band| {
        let (low, high) = band_edges_hz(band);
        spectrum.power_between(low, high)
    })
}

/// Level of the synthesised signal over that of the recorded one in each third-octave band, dB.
///
/// `None` for a band in which one of them has no power at all, so that there is no ratio.
pub fn band_errors_db(
    recorded: &[f64],
    synthesised: &[f64],
    rate_hz: f64,
) -> [Option<f64>; BAND_COUNT] {
    let (reference, other) = (
        band_powers(recorded, rate_hz),
        band_powers(synthesised, rate_hz),
    );
    std::array::from_fn(|band| level_db(other[band] / reference[band]))
}

/// A ratio of powers in dB, if it has a level.
fn level_db(ratio: f64) -> Option<f64> {
    Some(10.0 * ratio.log10()).filter(|level| level.is_finite())
}

/// Log-spectral distance, dB: the RMS, over the logarithm of frequency from `low_hz` to `high_hz`, of the difference of
/// two power spectra in dB, each smoothed by a sliding third-octave window.
///
/// The spectra are [`PowerSpectrum::welch`], so that signals of different lengths compare. Windows lie wholly within
/// the range and are a tenth of a third octave apart; a range narrower than a third octave is one window. A third
/// octave is about the smallest change of frequency that skin tells apart (Weber fraction 0.18 to 0.25, Israr 2006),
/// and it averages the scatter of single bins, which would else hide how near two takes of one surface are. A
/// difference of level counts like any other; to compare shapes only, bring both to the same power first.
///
/// `None` when the range is empty, or one of the signals has no power in some window.
pub fn log_spectral_distance_db(
    a: &[f64],
    b: &[f64],
    rate_hz: f64,
    low_hz: f64,
    high_hz: f64,
) -> Option<f64> {
    let (a, b) = (
        PowerSpectrum::welch(a, rate_hz),
        PowerSpectrum::welch(b, rate_hz),
    );
    let mut squares = Vec::new();
    for (low, high) in third_octave_windows(low_hz, high_hz) {
        let difference = level_db(a.power_between(low, high) / b.power_between(low, high))?;
        squares.push(difference * difference);
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    Some(mean.sqrt()).filter(|distance| distance.is_finite())
}

/// Windows a third octave wide, a tenth of that apart, from edge to edge of a range of frequencies, Hz.
fn third_octave_windows(low_hz: f64, high_hz: f64) -> Vec<(f64, f64)> {
    if !(low_hz > 0.0 && low_hz < high_hz) {
        return Vec::new();
    }
    let room = (high_hz / low_hz).log10() - THIRD_OCTAVE;
    if room <= 0.0 {
        return vec![(low_hz, high_hz)];
    }
    let steps = (room / THIRD_OCTAVE * WINDOWS_PER_THIRD_OCTAVE).ceil();
    let width = 10f64.powf(THIRD_OCTAVE);
    (0..=steps as u32)
        .map(|step| {
            let low = low_hz * 10f64.powf(room * f64::from(step) / steps);
            (low, low * width)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const RATE_HZ: f64 = 5000.0;

    fn noise(len: usize, seed: u64) -> Vec<f64> {
        let generator = rand_pcg::Pcg64::seed_from_u64(seed);
        StandardNormal.sample_iter(generator).take(len).collect()
    }

    fn scaled(signal: &[f64], factor: f64) -> Vec<f64> {
        signal.iter().map(|value| factor * value).collect()
    }

    fn sine(len: usize, frequency_hz: f64, amplitude: f64) -> Vec<f64> {
        let sample = |n: usize| amplitude * (TAU * frequency_hz * n as f64 / RATE_HZ).sin();
        (0..len).map(sample).collect()
    }

    fn close(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance * a.abs().max(b.abs())
    }

    proptest! {
        #[test]
        fn a_dft_keeps_the_energy_at_any_length(len in 1usize..600, seed: u64) {
            let signal = noise(len, seed);
            let amplitude = dft_amplitude(&signal);
            prop_assert_eq!(amplitude.len(), len / 2 + 1);
            // Every bin but those at 0 Hz and at half the rate stands for itself and its mirror image.
            let mirrored = |bin: usize| if bin == 0 || 2 * bin == len { 1.0 } else { 2.0 };
            let energy: f64 = amplitude.iter().enumerate().map(|(bin, x)| mirrored(bin) * x * x).sum();
            let expected: f64 = signal.iter().map(|x| x * x).sum();
            prop_assert!(close(energy / len as f64, expected, 1e-12));
        }

        #[test]
        fn the_welch_density_of_one_segment_keeps_the_windowed_energy(len in 2usize..600, seed: u64) {
            let signal = noise(len, seed);
            let hann = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / len as f64).cos();
            let (mut energy, mut window_energy) = (0.0, 0.0);
            for (n, x) in signal.iter().enumerate() {
                energy += (hann(n) * x).powi(2);
                window_energy += hann(n).powi(2);
            }
            let power = PowerSpectrum::welch(&signal, RATE_HZ).power_between(0.0, RATE_HZ / 2.0);
            prop_assert!(close(power, energy / window_energy, 1e-12));
        }

        #[test]
        fn power_is_the_sum_over_any_division_of_the_frequencies(
            len in 100usize..600, seed: u64, mut cuts in prop::collection::vec(0.0..2500.0f64, 1..20),
        ) {
            let spectrum = PowerSpectrum::welch(&noise(len, seed), RATE_HZ);
            cuts.extend([0.0, 2500.0]);
            cuts.sort_by(f64::total_cmp);
            let sum: f64 = cuts.windows(2).map(|cut| spectrum.power_between(cut[0], cut[1])).sum();
            prop_assert!(close(sum, spectrum.power_between(-1.0, 1e9), 1e-12));
        }

        #[test]
        fn a_scaled_copy_costs_what_it_is_scaled_by(
            len in 2usize..600, seed: u64, change in -3.0..3.0f64, width_hz in 0.0..200.0f64,
        ) {
            let signal = noise(len, seed);
            let cost = spectral_cost(&signal, &scaled(&signal, 1.0 + change), RATE_HZ, width_hz).unwrap();
            prop_assert!((cost - change.abs().min((2.0 + change).abs())).abs() < 1e-9);
        }

        #[test]
        fn the_cost_does_not_depend_on_the_common_scale(seed: u64, exponent in -100i32..100) {
            let (a, b) = (noise(500, seed), noise(700, !seed));
            let scale = 10f64.powi(exponent);
            let cost = spectral_cost(&a, &b, RATE_HZ, 50.0).unwrap();
            let other = spectral_cost(&scaled(&a, scale), &scaled(&b, scale), RATE_HZ, 50.0).unwrap();
            prop_assert!(close(cost, other, 1e-9));
        }

        #[test]
        fn smoothing_leaves_a_flat_spectrum_flat(
            len in 1usize..600, width_hz in 0.0..10_000.0f64, level in 1e-3..1e3f64,
        ) {
            // An impulse has the same amplitude everywhere.
            let mut signal = vec![0.0; len];
            signal[len / 3] = level;
            for amplitude in smoothed_amplitude(&signal, RATE_HZ, width_hz) {
                prop_assert!(close(amplitude, level, 1e-12));
            }
        }

        #[test]
        fn smoothing_stays_between_the_extremes(seed: u64, width_hz in 0.0..10_000.0f64) {
            let amplitude = dft_amplitude(&noise(301, seed));
            let (low, high) = amplitude.iter().fold((f64::MAX, 0.0f64), |(low, high), &x| (low.min(x), high.max(x)));
            for smoothed in smooth(&amplitude, RATE_HZ / 301.0, width_hz) {
                prop_assert!(smoothed > low * (1.0 - 1e-12) && smoothed < high * (1.0 + 1e-12));
            }
        }
    }

    #[test]
    fn smoothing_spreads_a_line_over_the_width_asked_for() {
        let mut line = vec![0.0; 1001];
        line[500] = 1.0;
        let smoothed = smooth(&line, 0.5, 20.0);
        assert!(smoothed[500 - 19] > 0.0 && smoothed[500 + 19] > 0.0);
        assert!(smoothed[500 - 20] <= 0.0 && smoothed[500 + 20] <= 0.0);
        // Hann falls to half a quarter of its width from the centre.
        assert!(close(smoothed[500 + 10], smoothed[500] / 2.0, 1e-12));
        assert!(close(smoothed.iter().sum(), 1.0, 1e-12));
        assert_eq!(smooth(&line, 0.5, 0.0), line);
        assert!(
            smooth(&line, 0.5, f64::INFINITY)
                .iter()
                .all(|x| close(*x, 1.0 / 1001.0, 1e-12))
        );
    }

    #[test]
    fn a_signal_costs_nothing_against_itself_and_one_against_silence() {
        let signal = noise(1000, 1);
        assert_eq!(spectral_cost(&signal, &signal, RATE_HZ, 20.0), Some(0.0));
        assert_eq!(
            spectral_cost(&signal, &[0.0; 1000], RATE_HZ, 20.0),
            Some(1.0)
        );
    }

    #[test]
    fn a_cost_that_does_not_exist_is_none() {
        let signal = noise(1000, 1);
        assert_eq!(spectral_cost(&[0.0; 1000], &signal, RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&[], &signal, RATE_HZ, 20.0), None);
        assert_eq!(spectral_cost(&signal, &[], RATE_HZ, 20.0), None);
        assert_eq!(
            spectral_cost(&[f64::NAN; 1000], &signal, RATE_HZ, 20.0),
            None
        );
        assert_eq!(
            spectral_cost(&signal, &[f64::INFINITY; 1000], RATE_HZ, 20.0),
            None
        );
    }

    #[test]
    fn independent_noises_cost_what_statistics_expect() {
        for (width_hz, seed) in [(0.0, 1), (5.0, 2), (20.0, 3), (100.0, 4)] {
            let mut mean = 0.0;
            for pair in 0..20 {
                let (a, b) = (
                    noise(10_000, 100 * seed + pair),
                    noise(10_000, 100 * seed + 50 + pair),
                );
                mean += spectral_cost(&a, &b, RATE_HZ, width_hz).unwrap() / 20.0;
            }
            let expected = expected_cost_of_noise(10_000, RATE_HZ, width_hz);
            assert!(
                close(mean, expected, 0.05),
                "{width_hz} Hz: {mean}, expected {expected}"
            );
        }
    }

    #[test]
    fn bands_are_contiguous_and_carry_the_standards_labels() {
        for (band, label) in BAND_LABELS_HZ.iter().enumerate() {
            let nominal: f64 = label.parse().unwrap();
            assert!(close(nominal, band_centre_hz(band), 0.02), "{label}");
            let (low, high) = band_edges_hz(band);
            assert!(close(low * high, band_centre_hz(band).powi(2), 1e-12));
            assert!(close(high / low, 10f64.powf(0.1), 1e-12));
            if band + 1 < BAND_COUNT {
                assert_eq!(high.to_bits(), band_edges_hz(band + 1).0.to_bits());
            }
        }
        assert!(close(band_centre_hz(BAND_COUNT - 1), 1000.0, 1e-15));
    }

    #[test]
    fn a_sine_has_its_power_in_its_own_band() {
        for band in 0..BAND_COUNT {
            let powers = band_powers(&sine(10_000, band_centre_hz(band), 3.0), RATE_HZ);
            assert!(
                close(powers[band], 4.5, 0.01),
                "{} Hz: {}",
                BAND_LABELS_HZ[band],
                powers[band]
            );
            for (other, power) in powers.iter().enumerate() {
                assert!(
                    other == band || *power < 0.01 * 4.5,
                    "{band} leaks into {other}: {power}"
                );
            }
        }
    }

    #[test]
    fn white_noise_has_power_in_proportion_to_a_bands_width() {
        let powers = band_powers(&scaled(&noise(500_000, 5), 2.0), RATE_HZ);
        for (band, power) in powers.iter().enumerate() {
            let (low, high) = band_edges_hz(band);
            let expected = 4.0 * (high - low) / (RATE_HZ / 2.0);
            // An estimate over T seconds of B hertz has a relative standard deviation of √(1/BT); T = 100 s.
            let deviation = (1.0 / ((high - low) * 100.0)).sqrt();
            assert!(
                close(*power, expected, 5.0 * deviation),
                "{band}: {power}, expected {expected}"
            );
        }
        let all: f64 = powers.iter().sum();
        let (low, high) = (band_edges_hz(0).0, band_edges_hz(BAND_COUNT - 1).1);
        assert!(close(all, 4.0 * (high - low) / (RATE_HZ / 2.0), 0.02));
    }

    #[test]
    fn every_sample_counts_in_welchs_estimate() {
        for len in [4999, 5000, 5001, 7499, 7501, 9999, 12_345] {
            // Half a second at the very end; what begins and ends with the signal is weighed lightly, not left out.
            let mut signal = vec![0.0; len];
            signal[len - 2500..].copy_from_slice(&sine(2500, 200.0, 1.0));
            assert!(band_powers(&signal, RATE_HZ)[10] > 0.01, "{len}");
        }
    }

    #[test]
    fn a_band_is_in_error_by_the_gain_of_the_synthesis() {
        let signal = noise(10_000, 6);
        let errors = band_errors_db(&signal, &scaled(&signal, 2.0), RATE_HZ);
        assert!(
            errors
                .iter()
                .all(|error| close(error.unwrap(), 20.0 * 2f64.log10(), 1e-9))
        );
        assert_eq!(
            band_errors_db(&signal, &vec![0.0; 10_000], RATE_HZ),
            [None; BAND_COUNT]
        );
        assert_eq!(band_errors_db(&[], &signal, RATE_HZ), [None; BAND_COUNT]);
        // At 1 kHz there is nothing above 500 Hz, and half of what the 500 Hz band holds.
        let errors = band_errors_db(&signal, &signal, 1000.0);
        assert!(
            errors[..=14].iter().all(Option::is_some) && errors[15..].iter().all(Option::is_none)
        );
    }

    #[test]
    fn log_spectral_distance_is_a_distance_of_levels() {
        let (a, b) = (noise(25_000, 7), noise(25_000, 8));
        let distance =
            |a: &[f64], b: &[f64]| log_spectral_distance_db(a, b, RATE_HZ, 30.0, 1000.0).unwrap();
        assert_eq!(distance(&a, &a).to_bits(), 0.0f64.to_bits());
        assert!(close(distance(&a, &b), distance(&b, &a), 1e-12));
        assert!(close(distance(&a, &scaled(&a, 10.0)), 20.0, 1e-9));
        // Two takes of one noise are near, even though of different lengths.
        assert!(distance(&a, &b) < 1.5, "{}", distance(&a, &b));
        assert!(distance(&a, &scaled(&b[..15_000], 2.0)) > 5.0);
    }

    #[test]
    fn log_spectral_distance_hears_nothing_outside_its_range() {
        let a = noise(25_000, 9);
        let tone = sine(25_000, 1500.0, 30.0);
        let with_tone: Vec<f64> = a.iter().zip(&tone).map(|(a, tone)| a + tone).collect();
        let within = log_spectral_distance_db(&a, &with_tone, RATE_HZ, 30.0, 1000.0).unwrap();
        let across = log_spectral_distance_db(&a, &with_tone, RATE_HZ, 30.0, 2000.0).unwrap();
        assert!(within < 0.1 && across > 5.0, "{within}, {across}");
    }

    #[test]
    fn log_spectral_distance_without_a_range_or_power_is_none() {
        let a = noise(5000, 10);
        for (low_hz, high_hz) in [
            (100.0, 100.0),
            (200.0, 100.0),
            (0.0, 100.0),
            (f64::NAN, 100.0),
            (30.0, 4000.0),
        ] {
            assert_eq!(
                log_spectral_distance_db(&a, &a, RATE_HZ, low_hz, high_hz),
                None
            );
        }
        assert_eq!(
            log_spectral_distance_db(&a, &vec![0.0; 5000], RATE_HZ, 30.0, 1000.0),
            None
        );
        assert_eq!(
            log_spectral_distance_db(&a, &a, RATE_HZ, 100.0, 105.0),
            Some(0.0)
        );
    }
}
