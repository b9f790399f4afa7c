//! Measures of properties that a power spectrum does not show: impulses, a varying level, and a fluctuating line.
//!
//! | measure | definition | Gaussian noise, white |
//! |---|---|---|
//! | kurtosis | mean x⁴ / (mean x²)² about the mean | 3 |
//! | residual kurtosis | median over windows of 50 ms of the kurtosis of the prediction error | 2.94 |
//! | crest factor | greatest magnitude over the RMS | 4.4 in 10 s at 5 kHz |
//! | modulation | RMS of the part from 8 to 64 Hz of the envelope of 100 to 1000 Hz, over the envelope's mean | 0.18 |
//! | level spread, dB | standard deviation of the levels of windows of 50 ms | 0.39 |
//! | line's range, dB | highest less lowest level of the strongest narrow line in windows of 0.5 s | no line |
//!
//! The envelope is the magnitude of the analytic signal of the band, computed block by block with a Fourier transform.
//! Its power from 8 to 64 Hz is Welch's estimate with Hann windows of up to 0.82 s. The prediction error comes from the
//! signal's own predictor, of order up to 100, computed by Levinson and Durbin's recursion from lags within blocks.
//! Before all measures, the mean over all blocks is subtracted. Kurtosis, crest factor and ranges grow with a signal's
//! duration, so only signals of the same duration can be compared.

use serde::{Deserialize, Serialize};

use super::autocorrelation::Autocorrelation;
use super::fourier;
use super::linear_prediction::{Prediction, corrected, step_up};
use super::spectrum::PowerSpectrum;

mod line;
#[cfg(test)]
mod tests;

pub use line::strongest_line_hz;

/// The measures of one signal. A measure is `None` where it does not exist, for example for silence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Liveliness {
    /// Kurtosis of the signal; 3 for Gaussian noise.
    pub kurtosis: Option<f64>,
    /// Median kurtosis of the prediction error within windows of 50 ms.
    pub residual_kurtosis: Option<f64>,
    /// Greatest magnitude divided by the RMS.
    pub crest_factor: Option<f64>,
    /// RMS of the envelope's part from 8 to 64 Hz, divided by the envelope's mean.
    pub modulation: Option<f64>,
    /// Standard deviation of the levels of windows of 50 ms, dB.
    pub level_spread_db: Option<f64>,
    /// Highest level of the line less its lowest level, in windows of 0.5 s, dB.
    pub line_range_db: Option<f64>,
}

impl Liveliness {
    /// Measures a signal in blocks, sampled at `rate_hz`, and its line near `line_hz`, if there is one.
    ///
    /// Blocks that are shorter than a window do not count in the measures that use windows.
    pub fn of(blocks: &[&[f64]], rate_hz: f64, line_hz: Option<f64>) -> Self {
        let Some(centred) = centred(blocks) else {
            return Self::default();
        };
        let blocks: Vec<&[f64]> = centred.iter().map(Vec::as_slice).collect();
        Self {
            kurtosis: kurtosis(blocks.iter().copied().flatten()),
            residual_kurtosis: residual_kurtosis(&blocks, rate_hz),
            crest_factor: crest_factor(blocks.iter().copied().flatten()),
            modulation: modulation(&blocks, rate_hz),
            level_spread_db: spread_db(&blocks, rate_hz),
            line_range_db: line_hz.and_then(|near| line::range_db(&blocks, rate_hz, near)),
        }
    }

    /// Returns the median of each measure over the signals that have it.
    pub fn median(of: &[Self]) -> Self {
        let median = |measure: fn(&Self) -> Option<f64>| median(of.iter().filter_map(measure));
        Self {
            kurtosis: median(|l| l.kurtosis),
            residual_kurtosis: median(|l| l.residual_kurtosis),
            crest_factor: median(|l| l.crest_factor),
            modulation: median(|l| l.modulation),
            level_spread_db: median(|l| l.level_spread_db),
            line_range_db: median(|l| l.line_range_db),
        }
    }
}

/// Mean x⁴ / (mean x²)²; `None` for silence and if a sample is not finite.
pub fn kurtosis<'a>(signal: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (mut count, mut square, mut fourth) = (0.0, 0.0, 0.0);
    for x in signal {
        let power = x * x;
        count += 1.0;
        square += power;
        fourth += power * power;
    }
    Some(fourth * count / (square * square)).filter(|kurtosis| kurtosis.is_finite())
}

/// Greatest magnitude divided by the RMS; `None` for silence and if a sample is not finite.
fn crest_factor<'a>(signal: impl Iterator<Item = &'a f64>) -> Option<f64> {
    let (mut count, mut square, mut peak) = (0.0, 0.0, 0.0f64);
    for x in signal {
        count += 1.0;
        square += x * x;
        peak = peak.max(x.abs());
    }
    Some(peak / f64::sqrt(square / count)).filter(|crest| crest.is_finite())
}

/// Duration of a window of levels, s.
pub const LEVEL_WINDOW_S: f64 = 0.05;

/// Band whose envelope is measured, Hz: the frequencies that skin feels as vibration.
pub const MODULATION_BAND_HZ: (f64, f64) = (100.0, 1000.0);

/// Frequencies of the envelope that count as modulation, Hz: slower than a tone and faster than a stroke.
pub const MODULATION_HZ: (f64, f64) = (8.0, 64.0);

/// Longest segment of the envelope's spectrum, s: 4096 samples at 5 kHz.
const SEGMENT_S: f64 = 0.8192;

/// Shortest segment of the envelope's spectrum, s: two periods of the slowest modulation.
const SHORTEST_SEGMENT_S: f64 = 2.0 / MODULATION_HZ.0;

/// Least level of a window, as a fraction of the mean power: a dropout counts as -60 dB.
const FLOOR: f64 = 1e-6;

/// Returns the number of samples per window; `None` if it is less than two.
fn window_samples(rate_hz: f64) -> Option<usize> {
    let samples = (LEVEL_WINDOW_S * rate_hz).round() as usize;
    (samples >= 2).then_some(samples)
}

/// Returns the RMS of the part of the envelopes within [`MODULATION_HZ`], divided by their mean. Blocks that are too
/// short to resolve this part are left out. Returns `None` if all blocks are too short or the band is silent.
fn modulation(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let least = (SHORTEST_SEGMENT_S * rate_hz).ceil() as usize;
    let (low_hz, high_hz) = MODULATION_BAND_HZ;
    let long = || blocks.iter().filter(|block| block.len() >= least);
    let mut envelopes: Vec<Vec<f64>> = long()
        .map(|block| Analytic::of(block, rate_hz, low_hz, high_hz).envelope())
        .collect();
    let shortest = envelopes.iter().map(Vec::len).min()?;
    let segment = shortest.min((SEGMENT_S * rate_hz).round() as usize);
    let count: usize = envelopes.iter().map(Vec::len).sum();
    let mean = envelopes.iter().flatten().sum::<f64>() / count as f64;
    let power = mean_square(long().copied().flatten(), count);
    // A level this low is only the round-off of the transform.
    if mean * mean <= 1e-20 * power {
        return None;
    }
    envelopes.iter_mut().flatten().for_each(|x| *x -= mean);
    let envelopes: Vec<&[f64]> = envelopes.iter().map(Vec::as_slice).collect();
    let spectrum = PowerSpectrum::of_blocks(&envelopes, segment, rate_hz);
    let square = spectrum.power_between(MODULATION_HZ.0, MODULATION_HZ.1);
    Some(square.sqrt() / mean).filter(|share| share.is_finite())
}

/// Returns the standard deviation of the levels of windows within blocks, dB; `None` if there are fewer than two
/// windows.
fn spread_db(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let window = window_samples(rate_hz)?;
    let powers: Vec<f64> = blocks
        .iter()
        .flat_map(|block| block.chunks_exact(window))
        .map(|w| mean_square(w.iter(), window))
        .collect();
    let count = powers.len() as f64;
    let floor = FLOOR * powers.iter().sum::<f64>() / count;
    let levels: Vec<f64> = powers.iter().map(|power| 10.0 * power.max(floor).log10()).collect();
    let mean = levels.iter().sum::<f64>() / count;
    let variance = levels.iter().map(|level| (level - mean).powi(2)).sum::<f64>() / count;
    (powers.len() >= 2 && variance.is_finite()).then(|| variance.sqrt())
}

/// Highest order of the predictor. With this order, the prediction error of textures is white enough.
const ORDER: usize = 100;

/// Least number of samples per coefficient from which a predictor is estimated.
const SAMPLES_PER_COEFFICIENT: usize = 20;

/// Fraction of the signal's power below which a prediction error is only the round-off of lines and not a residual.
const LEAST_ERROR: f64 = 1e-7;

/// Returns the median, over windows of 50 ms, of the kurtosis of the prediction error about each window's mean. Returns
/// `None` if no block is longer than the predictor's order by a window, or if the prediction error is only round-off.
fn residual_kurtosis(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let residual = residual(blocks);
    let window = window_samples(rate_hz)?;
    let of_window = |window: &[f64]| {
        let mean = window.iter().sum::<f64>() / window.len() as f64;
        let centred: Vec<f64> = window.iter().map(|x| x - mean).collect();
        kurtosis(centred.iter())
    };
    let windows = residual.iter().flat_map(|block| block.chunks_exact(window));
    median(windows.filter_map(of_window))
}

/// Returns the prediction error of each block, without the samples whose past is not in the block. The result is empty
/// if the error is only round-off.
fn residual(blocks: &[&[f64]]) -> Vec<Vec<f64>> {
    let count: usize = blocks.iter().map(|block| block.len()).sum();
    let order = ORDER.min(count / SAMPLES_PER_COEFFICIENT);
    let mut lags = vec![0.0; order + 1];
    for block in blocks.iter().filter(|block| block.len() > order) {
        let own = Autocorrelation::of(block, order).lags;
        // Lags are means over a block, so a block's length is its weight.
        for (sum, lag) in lags.iter_mut().zip(own) {
            *sum += lag * block.len() as f64;
        }
    }
    let prediction = Prediction::levinson_durbin(&corrected(lags), order);
    let a = step_up(&prediction.reflection);
    let predict = |block: &&[f64]| -> Vec<f64> {
        let ends = a.len()..block.len().max(a.len());
        ends.map(|n| {
            let past = block[n - a.len()..n].iter().rev();
            block[n] + a.iter().zip(past).map(|(a, x)| a * x).sum::<f64>()
        })
        .collect()
    };
    let residual: Vec<Vec<f64>> = blocks.iter().map(predict).collect();
    let left = residual.iter().map(Vec::len).sum();
    let power = mean_square(blocks.iter().copied().flatten(), count);
    if mean_square(residual.iter().flatten(), left) > LEAST_ERROR * power {
        residual
    } else {
        Vec::new()
    }
}

/// Subtracts the common mean from the blocks; `None` if only round-off is left, or if a sample is not finite.
fn centred(blocks: &[&[f64]]) -> Option<Vec<Vec<f64>>> {
    /// Power of round-off, as a fraction of the squared peak.
    const ROUND_OFF: f64 = 1e-24;
    let count: usize = blocks.iter().map(|block| block.len()).sum();
    let mean = blocks.iter().copied().flatten().sum::<f64>() / count.max(1) as f64;
    let peak = blocks
        .iter()
        .copied()
        .flatten()
        .fold(0.0f64, |peak, x| peak.max(x.abs()));
    let centred: Vec<Vec<f64>> = blocks
        .iter()
        .map(|block| block.iter().map(|x| x - mean).collect())
        .collect();
    let square = mean_square(centred.iter().flatten(), count);
    (square.is_finite() && square > ROUND_OFF * peak * peak && square > f64::MIN_POSITIVE).then_some(centred)
}

/// Mean of the squares of `count` samples.
fn mean_square<'a>(samples: impl Iterator<Item = &'a f64>, count: usize) -> f64 {
    samples.map(|x| x * x).sum::<f64>() / count.max(1) as f64
}

/// Returns the median, which is the mean of the two middle values if their number is even; `None` if there are no
/// values.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    let upper = values.get(half).copied()?;
    Some(if values.len() % 2 == 1 {
        upper
    } else {
        f64::midpoint(values[half - 1], upper)
    })
}

/// The part of a block within a range of frequencies, and its Hilbert transform.
struct Analytic {
    signal: Vec<f64>,
    quadrature: Vec<f64>,
}

impl Analytic {
    /// Transforms the block, keeps the bins from `low_hz` to `high_hz`, and transforms them back: once unchanged, and
    /// once delayed by a quarter of a period. The transform is circular: it treats the ends of a block as neighbours.
    fn of(block: &[f64], rate_hz: f64, low_hz: f64, high_hz: f64) -> Self {
        let len = block.len();
        if len < 2 {
            return Self {
                signal: vec![0.0; len],
                quadrature: vec![0.0; len],
            };
        }
        let mut bins = fourier::forward(&mut block.to_vec());
        for (bin, value) in bins.iter_mut().enumerate() {
            let frequency_hz = bin as f64 * rate_hz / len as f64;
            // Bins at 0 Hz and at half the rate have no quadrature.
            let is_edge = bin == 0 || 2 * bin == len;
            let is_kept = (low_hz..=high_hz).contains(&frequency_hz) && !is_edge;
            *value *= if is_kept { 1.0 / len as f64 } else { 0.0 };
        }
        let mut later = bins.clone();
        // A factor of -j delays each component by a quarter of its period.
        for value in &mut later {
            (value.re, value.im) = (value.im, -value.re);
        }
        Self {
            signal: fourier::inverse(&mut bins, len),
            quadrature: fourier::inverse(&mut later, len),
        }
    }

    /// Magnitude of the analytic signal, sample by sample.
    fn envelope(&self) -> Vec<f64> {
        self.signal
            .iter()
            .zip(&self.quadrature)
            .map(|(x, y)| x.hypot(*y))
            .collect()
    }
}
