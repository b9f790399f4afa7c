//! Bands of one recording whose amplitude is steadier than that of Gaussian noise.
//!
//! The threads of a weave are not evenly spaced, so its line is not narrow. It is a band a few per cent wide, which a
//! spectrum cannot distinguish from noise. The band's envelope can: the intensity of Gaussian noise in a band is
//! exponentially distributed, while that of a line is nearly constant whatever its phase does.
//!
//! The statistic is the ratio of the arithmetic to the geometric mean of the intensity. It is e^γ = 1.78 for noise.
//! With N independent intensities Iₖ and their fractions Dₖ = Iₖ / Σ I,
//!
//! ```text
//! E ∏ (N Dₖ)ˢ = N^(N s) Γ(N) Γ(1 + s)^N / Γ(N (1 + s))
//! ```
//! because the fractions are uniform on the simplex. Chernoff's bound on that moment bounds the p-value.

use std::f64::consts::TAU;

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::fourier::{self, Complex};

use super::peaks::{HIGHEST_HZ, LOWEST_HZ, tells_lines};

/// Widths of the Gaussian kernels that smooth a spectrum to find bands in it, Hz: standard deviations.
const WIDTHS_HZ: [f64; 4] = [1.0, 3.0, 9.0, 24.0];

/// Ratio of the power at a band's edge to that at its peak.
const EDGE: f64 = 0.1;

/// Ratio of a valley's power to a peak's. A shallower valley before a higher peak means that there is no peak; a deeper
/// one ends the peak's band.
const VALLEY: f64 = 0.25;

/// Fraction of an envelope that is left out at each of its ends, because the transform joins them.
const ENDS: f64 = 0.02;

/// Logarithm of the ratio of means above which a band counts as noise. That of noise is 0.577.
const MOST_LN_RATIO: f64 = 0.45;

/// Least number of samples of an envelope per bin of the spectrum in its band.
const OVERSAMPLING: usize = 4;

/// Largest ratio of a band's width to its frequency. A wider band does not determine a wavelength.
const MOST_WIDTH: f64 = 0.6;

/// A band around a peak of the spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Band {
    /// Frequency of the peak, Hz.
    pub frequency_hz: f64,
    /// Lowest and highest frequency, Hz.
    pub edges_hz: [f64; 2],
    /// Natural logarithm of an upper bound on the probability that noise has so steady an envelope there.
    pub ln_chance: f64,
}

impl Band {
    /// Distance between the band's edges, Hz.
    pub(super) fn width_hz(&self) -> f64 {
        self.edges_hz[1] - self.edges_hz[0]
    }
}

/// Spectrum of a whole recording.
pub(super) struct WholeSpectrum {
    bins: Vec<Complex<f64>>,
    samples: usize,
    /// Number of samples with those that follow, because a transform of their number alone may be slow.
    length: usize,
}

/// Envelope of a band: its complex amplitude relative to the band's lowest frequency, at even times.
pub(super) struct Envelope {
    values: Vec<Complex<f64>>,
    lowest_hz: f64,
    /// Number of the recording's samples between two values.
    step: f64,
    /// Number of the recording's samples.
    samples: f64,
}

impl WholeSpectrum {
    /// Spectrum of `signal`; `None` if it is too short or silent.
    pub(super) fn of(signal: &[f64]) -> Option<Self> {
        if !tells_lines(signal) {
            return None;
        }
        let (samples, length) = (signal.len(), fourier::quick_length(signal.len()));
        // From the last sample back to the first, the end's mirror image goes over into the beginning's.
        let spare = length - samples;
        let images = signal.iter().rev().zip(signal[..spare].iter().rev()).enumerate();
        let joined = images.map(|(n, (end, begin))| {
            let share = (n as f64 + 0.5) / spare as f64;
            (1.0 - share) * end + share * begin
        });
        let mut circle: Vec<f64> = signal.iter().copied().chain(joined).collect();
        Some(Self {
            bins: fourier::forward(&mut circle),
            samples,
            length,
        })
    }

    fn step_hz(&self) -> f64 {
        f64::from(SAMPLE_RATE_HZ) / self.length as f64
    }

    /// Returns the bands around the peaks at each width of smoothing, each with the probability of its envelope in
    /// noise. Bands that are too wide or beyond the range of lines' frequencies are left out.
    pub(super) fn bands(&self) -> Vec<Band> {
        let powers: Vec<f64> = self.bins.iter().map(Complex::norm_sqr).collect();
        let mut bands: Vec<Band> = Vec::new();
        for width_hz in WIDTHS_HZ {
            let smooth = smoothed(&powers, width_hz / self.step_hz());
            for (peak, [low, high]) in ranges(&smooth) {
                let [frequency_hz, low_hz, high_hz] = [peak, low, high].map(|bin| bin as f64 * self.step_hz());
                let is_narrow = high_hz - low_hz < MOST_WIDTH * frequency_hz;
                let is_in_range = (LOWEST_HZ..=HIGHEST_HZ).contains(&frequency_hz);
                if is_in_range && is_narrow && high > low + 2 {
                    bands.push(Band {
                        frequency_hz,
                        edges_hz: [low_hz, high_hz],
                        ln_chance: self.ln_chance([low, high]),
                    });
                }
            }
        }
        bands
    }

    /// Returns the band around `frequency_hz` with these edges.
    pub(super) fn band(&self, frequency_hz: f64, edges_hz: [f64; 2]) -> Band {
        Band {
            frequency_hz,
            edges_hz,
            ln_chance: self.ln_chance(self.bins_of(edges_hz)),
        }
    }

    /// Returns the envelope of the band from `edges_hz[0]` to `edges_hz[1]`.
    pub(super) fn envelope(&self, edges_hz: [f64; 2]) -> Envelope {
        self.envelope_of(self.bins_of(edges_hz))
    }

    fn bins_of(&self, edges_hz: [f64; 2]) -> [usize; 2] {
        let last = self.bins.len() - 1;
        let [low, high] = edges_hz.map(|hz| ((hz / self.step_hz()).round() as usize).clamp(1, last));
        [low, high.max(low)]
    }

    fn envelope_of(&self, [low, high]: [usize; 2]) -> Envelope {
        let count = high - low + 1;
        let length = (OVERSAMPLING * count).next_power_of_two();
        // Bins without their negative frequencies give an analytic signal. The band's lowest frequency is shifted to 0
        // Hz.
        let mut values = vec![Complex::default(); length];
        values[..count].copy_from_slice(&self.bins[low..=high]);
        fourier::inverse_complex(&mut values);
        // Scaled so that a sine of amplitude 1 has an envelope of amplitude 1.
        let scale = 2.0 / self.length as f64;
        values.iter_mut().for_each(|value| *value *= scale);
        Envelope {
            values,
            lowest_hz: low as f64 * self.step_hz(),
            step: self.length as f64 / length as f64,
            samples: self.samples as f64,
        }
    }

    /// Returns the natural logarithm of an upper bound on the probability that noise has an envelope as steady as this
    /// one.
    fn ln_chance(&self, [low, high]: [usize; 2]) -> f64 {
        let powers = || self.bins[low..=high].iter().map(Complex::norm_sqr);
        let (sum, squares) = powers().fold((0.0, 0.0), |(a, b), p| (a + p, b + p * p));
        // The equivalent number of independent intensities is bandwidth times duration; the mean square of a
        // periodogram's values is twice the square of their expectation. Samples that were added make more values,
        // but no more independent ones. One is subtracted, because few values give too high a number.
        let share = self.samples as f64 / self.length as f64;
        let count = (2.0 * share * sum * sum / squares.max(f64::MIN_POSITIVE) - 1.0).max(1.0);
        let envelope = self.envelope_of([low, high]);
        let intensities: Vec<f64> = envelope.middle().map(|(_, value)| value.norm_sqr()).collect();
        let mean = intensities.iter().sum::<f64>() / intensities.len() as f64;
        // One logarithm of the product of eight ratios, none of which is so small that the product is zero.
        let ln_of_products = intensities
            .chunks(8)
            .map(|some| some.iter().map(|i| (i / mean).max(1e-30)).product::<f64>().ln());
        let ln_ratio = -ln_of_products.sum::<f64>() / intensities.len() as f64;
        if ln_ratio < MOST_LN_RATIO {
            ln_bound(count, ln_ratio)
        } else {
            0.0
        }
    }
}

impl Envelope {
    /// Returns the values without those at the ends, each with its time in samples.
    pub(super) fn middle(&self) -> impl Iterator<Item = (f64, Complex<f64>)> {
        let inside = (self.samples / self.step).ceil() as usize;
        let ends = (ENDS * inside as f64).ceil() as usize;
        let values = self.values[..inside].iter().enumerate();
        let kept = values.skip(ends).take(inside - 2 * ends);
        kept.map(|(index, value)| (index as f64 * self.step, *value))
    }

    /// Returns the phase at each of `samples` samples, turns; it is continuous.
    pub(super) fn turns(&self, samples: usize) -> Vec<f64> {
        let (mut turns, mut last) = (Vec::with_capacity(self.values.len()), None);
        let mut phase = 0.0;
        for value in &self.values {
            phase = match last {
                Some(last) => phase + (value * Complex::conj(&last)).arg() / TAU,
                None => value.arg() / TAU,
            };
            last = Some(*value);
            turns.push(phase);
        }
        let per_sample = self.lowest_hz / f64::from(SAMPLE_RATE_HZ);
        let between = self.at_samples(&turns, samples).enumerate();
        between.map(|(n, turns)| turns + per_sample * n as f64).collect()
    }

    /// Returns the magnitude at each of `samples` samples.
    pub(super) fn magnitudes(&self, samples: usize) -> Vec<f64> {
        let magnitudes: Vec<f64> = self.values.iter().map(|value| value.norm_sqr().sqrt()).collect();
        self.at_samples(&magnitudes, samples).collect()
    }

    /// Interpolates `values`, one per value of the envelope, at each of `samples` samples.
    fn at_samples(&self, values: &[f64], samples: usize) -> impl Iterator<Item = f64> {
        let end = values.len() - 1;
        (0..samples).map(move |n| {
            let at = n as f64 / self.step;
            let left = (at as usize).min(end);
            let right = (left + 1).min(end);
            values[left] + (at - left as f64) * (values[right] - values[left])
        })
    }
}

/// Natural logarithm of Chernoff's upper bound on a probability: that ln(arithmetic mean / geometric mean) of `count`
/// independent exponential values is at most `ln_ratio`.
fn ln_bound(count: f64, ln_ratio: f64) -> f64 {
    let bound = |ln_s: f64| {
        let s = ln_s.exp();
        count * (s * count.ln() + libm::lgamma(1.0 + s) + s * ln_ratio) + libm::lgamma(count)
            - libm::lgamma(count * (1.0 + s))
    };
    // The logarithm of a moment is convex in s, so a search by thirds misses no minimum.
    let (mut low, mut high) = (-3.0, 6.0);
    for _ in 0..30 {
        let third = (high - low) / 3.0;
        if bound(low + third) < bound(high - third) {
            high -= third;
        } else {
            low += third;
        }
    }
    bound(f64::midpoint(low, high)).min(0.0)
}

/// Returns `values` smoothed by three running means, which together have a standard deviation of about `width` values.
fn smoothed(values: &[f64], width: f64) -> Vec<f64> {
    // A mean of 2 r + 1 values has a variance of r (r + 1) / 3.
    let reach = (0.5 * ((1.0 + 4.0 * width * width).sqrt() - 1.0)).round() as usize;
    let (mut smooth, count) = (values.to_vec(), values.len());
    // Differences of running sums, so that the work does not depend on the width.
    let mut sums = vec![0.0; count + 1];
    let whole = 2 * reach + 1;
    for _ in 0..3 {
        let mut sum = 0.0;
        for (after, value) in sums[1..].iter_mut().zip(&smooth) {
            sum += value;
            *after = sum;
        }
        let ends = (0..reach.min(count)).chain(count.saturating_sub(reach).max(reach)..count);
        for at in ends {
            let (from, to) = (at.saturating_sub(reach), (at + reach + 1).min(count));
            smooth[at] = (sums[to] - sums[from]) / (to - from) as f64;
        }
        let means = smooth.iter_mut().skip(reach);
        let sums = sums.iter().zip(sums.get(whole..).unwrap_or_default());
        for (mean, (before, after)) in means.zip(sums) {
            *mean = (after - before) / whole as f64;
        }
    }
    smooth
}

/// Returns the peaks of `levels`, each with the range down to [`EDGE`] times its level, or to the valley before another
/// peak.
fn ranges(levels: &[f64]) -> Vec<(usize, [usize; 2])> {
    let last = levels.len() - 1;
    // Returns the end of a peak's range in one direction; `None` if a higher peak comes first without a deep valley.
    let end = |peak: usize, step: isize| -> Option<usize> {
        let (mut at, mut least) = (peak, peak);
        loop {
            let level = levels[at];
            if level > levels[peak] {
                return (levels[least] < VALLEY * levels[peak]).then_some(least);
            }
            if level < levels[least] {
                least = at;
            } else if levels[least] < VALLEY * levels[peak] && level > 1.2 * levels[least] {
                return Some(least);
            }
            if level < EDGE * levels[peak] || at == 1 || at == last {
                return Some(at);
            }
            at = at.checked_add_signed(step)?;
        }
    };
    let is_peak = |&at: &usize| levels[at] > levels[at - 1] && levels[at] >= levels[at + 1];
    (2..last)
        .filter(is_peak)
        .filter_map(|peak| Some((peak, [end(peak, -1)?, end(peak, 1)?])))
        .collect()
}
