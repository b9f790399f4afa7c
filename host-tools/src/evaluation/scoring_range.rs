//! The frequencies that a recording can be judged at.

use serde::Serialize;

use crate::dsp::spectrum::{BAND_COUNT, band_edges_hz, longest_segment};
use model_format::SAMPLE_RATE_HZ;

/// Share of half a recording's own sample rate up to which it is judged: above it, filters before sampling and the
/// resampler's transition band, which is a few per cent wide, take from the level.
const NYQUIST_SHARE: f64 = 0.9;

/// Number of steps of the resolution that the narrowest window of a third octave must be wide.
const RESOLUTION_STEPS: f64 = 2.0;

/// The range over which the log-spectral distance is taken where the recording allows it, Hz.
pub const DISTANCE_RANGE_HZ: (f64, f64) = (30.0, 1000.0);

/// The frequencies at which a recording is judged: none above its own half sample rate, and none that its blocks do not
/// resolve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ScoringRange {
    /// Lowest frequency of bands, Hz.
    pub low_hz: f64,
    /// Highest frequency of bands, Hz.
    pub high_hz: f64,
    /// Lowest and highest frequency of the cost C, Hz.
    pub cost_hz: (f64, f64),
    /// Samples per segment of a power spectrum.
    #[serde(skip)]
    pub segment: usize,
}

impl ScoringRange {
    /// The range of a recording of `source_rate_hz` that is judged in blocks of `block` samples at 5 kHz. `None` if no
    /// third octave is left.
    ///
    /// A window of a third octave from f on is 0.26 f wide and must be two steps of the resolution wide, 2/T for
    /// segments of T = 1 s, or of a block if that is shorter.
    pub fn of(source_rate_hz: f64, block: usize) -> Option<Self> {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let segment = longest_segment(rate_hz).min(block);
        if segment < 2 {
            return None;
        }
        let resolved_hz = RESOLUTION_STEPS * rate_hz / segment as f64 / (10f64.powf(0.1) - 1.0);
        let (lowest_hz, highest_hz) = (band_edges_hz(0).0, band_edges_hz(BAND_COUNT - 1).1);
        let own_hz = if source_rate_hz < rate_hz {
            NYQUIST_SHARE * source_rate_hz / 2.0
        } else {
            rate_hz / 2.0
        };
        let range = Self {
            low_hz: lowest_hz.max(resolved_hz),
            high_hz: highest_hz.min(own_hz),
            cost_hz: (rate_hz / block as f64, own_hz),
            segment,
        };
        Some(range).filter(Self::holds_a_third_octave)
    }

    /// The lowest and the highest frequency of bands, Hz.
    pub fn band_edges_hz(&self) -> (f64, f64) {
        (self.low_hz, self.high_hz)
    }

    /// The range of the log-spectral distance, Hz.
    pub fn distance_hz(&self) -> (f64, f64) {
        let (low_hz, high_hz) = DISTANCE_RANGE_HZ;
        (low_hz.max(self.low_hz), high_hz.min(self.high_hz))
    }

    /// Returns whether the band from `low_hz` to `high_hz` lies in the range, edges included.
    pub fn holds(&self, low_hz: f64, high_hz: f64) -> bool {
        low_hz >= self.low_hz * (1.0 - 1e-9) && high_hz <= self.high_hz * (1.0 + 1e-9)
    }

    fn holds_a_third_octave(&self) -> bool {
        (0..BAND_COUNT).any(|band| {
            let (low, high) = band_edges_hz(band);
            self.holds(low, high)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_ends_below_half_of_the_recordings_own_rate() {
        let range = |rate_hz| ScoringRange::of(rate_hz, 5000).unwrap();
        assert_eq!(range(1000.0).high_hz, 450.0);
        assert_eq!(range(1000.0).cost_hz.1, 450.0);
        assert_eq!(range(1000.0).distance_hz(), (30.0, 450.0));
        for rate_hz in [5000.0, 44_100.0] {
            assert!((range(rate_hz).high_hz - 1122.0).abs() < 0.1);
            assert_eq!(range(rate_hz).cost_hz.1, 2500.0);
            assert_eq!(range(rate_hz).distance_hz(), DISTANCE_RANGE_HZ);
        }
        assert_eq!(ScoringRange::of(40.0, 5000), None);
    }

    #[test]
    fn a_range_begins_where_blocks_resolve_a_third_octave() {
        let low_hz = |block| ScoringRange::of(5000.0, block).map(|range| range.low_hz);
        assert_eq!(low_hz(2500), low_hz(5000));
        assert!((low_hz(1000).unwrap() - 38.6).abs() < 0.1);
        assert_eq!(low_hz(1), None);
        assert_eq!(low_hz(0), None);
    }
}
