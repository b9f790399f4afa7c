//! Changes of level: the envelope's modulation, and the spread of the levels of short windows.

use super::values::mean_square;
use crate::dsp::analytic::Analytic;
use crate::dsp::spectrum::PowerSpectrum;

/// Duration of a window of levels, s.
pub const LEVEL_WINDOW_S: f64 = 0.05;

/// Band whose envelope is taken, Hz: what skin feels as vibration.
pub const MODULATION_BAND_HZ: (f64, f64) = (100.0, 1000.0);

/// Frequencies of the envelope that count as modulation, Hz: slower than a tone, faster than a stroke.
pub const MODULATION_HZ: (f64, f64) = (8.0, 64.0);

/// Longest segment of the envelope's spectrum, s: 4096 samples at 5 kHz.
const SEGMENT_S: f64 = 0.8192;

/// Shortest segment, s: two periods of the slowest modulation.
const SHORTEST_SEGMENT_S: f64 = 2.0 / MODULATION_HZ.0;

/// Least level of a window, as a share of the mean power: a dropout counts for -60 dB.
const FLOOR: f64 = 1e-6;

/// Samples per window; `None` where a window holds fewer than two.
pub(super) fn window_samples(rate_hz: f64) -> Option<usize> {
    let samples = (LEVEL_WINDOW_S * rate_hz).round() as usize;
    (samples >= 2).then_some(samples)
}

/// RMS of the envelopes' part within [`MODULATION_HZ`] over their mean. Blocks that are too short to resolve it are
/// left out; `None` if all are, or the band is silent.
pub(super) fn modulation(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let least = (SHORTEST_SEGMENT_S * rate_hz).ceil() as usize;
    let (low_hz, high_hz) = MODULATION_BAND_HZ;
    let long = blocks.iter().filter(|block| block.len() >= least);
    let mut envelopes: Vec<Vec<f64>> = long
        .map(|block| Analytic::of(block, rate_hz, low_hz, high_hz).envelope())
        .collect();
    let shortest = envelopes.iter().map(Vec::len).min()?;
    let segment = shortest.min((SEGMENT_S * rate_hz).round() as usize);
    let count: usize = envelopes.iter().map(Vec::len).sum();
    let mean = envelopes.iter().flatten().sum::<f64>() / count as f64;
    let power = mean_square(blocks.iter().copied().flatten(), count);
    // The transform's round-off is no band.
    if mean * mean <= 1e-20 * power {
        return None;
    }
    envelopes.iter_mut().flatten().for_each(|x| *x -= mean);
    let envelopes: Vec<&[f64]> = envelopes.iter().map(Vec::as_slice).collect();
    let spectrum = PowerSpectrum::of_blocks(&envelopes, segment, rate_hz);
    let square = spectrum.power_between(MODULATION_HZ.0, MODULATION_HZ.1);
    Some(square.sqrt() / mean).filter(|share| share.is_finite())
}

/// Standard deviation of the levels of windows within blocks, dB; `None` of fewer than two windows.
pub(super) fn spread_db(blocks: &[&[f64]], rate_hz: f64) -> Option<f64> {
    let window = window_samples(rate_hz)?;
    let windows = blocks.iter().flat_map(|block| block.chunks_exact(window));
    let powers: Vec<f64> = windows.map(|w| mean_square(w.iter(), window)).collect();
    let count = powers.len() as f64;
    let floor = FLOOR * powers.iter().sum::<f64>() / count;
    let levels: Vec<f64> = powers
        .iter()
        .map(|power| 10.0 * power.max(floor).log10())
        .collect();
    let mean = levels.iter().sum::<f64>() / count;
    let variance = levels
        .iter()
        .map(|level| (level - mean).powi(2))
        .sum::<f64>()
        / count;
    (powers.len() >= 2 && variance.is_finite()).then(|| variance.sqrt())
}
