//! The estimate of a recording's autocorrelation.
//!
//! A rectangular window weights every sample equally and has the finest resolution. But it leaks from a strong band
//! into weak ones, because the signal starts and ends abruptly. Tapered ends hardly leak, and cost the weight of a
//! tenth of a second. The leakage is measured, and the ends are tapered where it matters.

use std::ops::Range;
use std::sync::LazyLock;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize};
use stylus_dsp::autocorrelation::PaddedSpectrum;
use stylus_dsp::high_pass::lowest_hz;
use stylus_dsp::log_spectrum::{FINE_BINS, density_of_model};
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::AMPLITUDE_JND_DB;
use stylus_dsp::sums::{extremes, sum};

/// Number of frequencies, 0.5 Hz apart, at which a model is compared with a recording: one more than half of 5 · 2¹¹,
/// because a transform of that length is fast.
const BINS: usize = 5121;

/// Leakage in any third-octave band above which the ends are tapered, dB.
const TOLERABLE_LEAKAGE_DB: f64 = 1.0;

/// Fraction of half a recording's rate up to which its content is the surface's. Above it, the filters of converters
/// attenuate.
const CARRIED: f64 = 0.9;

/// Returns the frequency up to which a recording at `source_rate_hz` holds the surface's spectrum, Hz; `None` if it
/// holds the whole band of models at 5 kHz.
pub fn carried_hz(source_rate_hz: f64) -> Option<f64> {
    (source_rate_hz < f64::from(SAMPLE_RATE_HZ)).then(|| CARRIED * source_rate_hz / 2.0)
}

/// Fraction of the models' band that is kept of a recording of a higher rate. Above it, the filter of the conversion
/// attenuates, over a few per cent of the band.
const CONVERTED: f64 = 0.98;

/// Band of the surface that a recording holds. If an end is `None`, the whole of the models' band is held on that side.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct KnownBand {
    from_hz: Option<f64>,
    to_hz: Option<f64>,
}

impl KnownBand {
    /// Returns the band of a recording at `source_rate_hz` for models at `rate_hz`; `cut_hz` is the cut-off of its
    /// high-pass filter, if any.
    pub fn of(source_rate_hz: f64, rate_hz: u32, cut_hz: Option<f64>) -> Self {
        let rate_hz = f64::from(rate_hz);
        let converted = || (source_rate_hz > rate_hz).then_some(CONVERTED * rate_hz / 2.0);
        Self {
            from_hz: cut_hz.map(lowest_hz),
            to_hz: carried_hz(source_rate_hz).or_else(converted),
        }
    }

    /// The band, Hz.
    pub fn range_hz(self) -> Range<f64> {
        self.from_hz.unwrap_or(0.0)..self.to_hz.unwrap_or(f64::INFINITY)
    }

    fn is_all(self) -> bool {
        self.from_hz.is_none() && self.to_hz.is_none()
    }
}

/// Statistics of a recording that a model is fitted to and checked against.
pub(super) struct Estimate {
    /// Autocorrelation from lag 0 on, (m/s²)²; lag 0 is the recording's power, with what was filled in outside of the
    /// known band.
    pub lags: Vec<f64>,
    /// Third-octave bands of the recording with tapered ends.
    pub bands: Bands,
}

/// Estimates the autocorrelation of `signal` at `rate_hz`, whose recording holds the band `known`; `plain` is its
/// spectrum. Outside that band the spectrum is filled in with what costs a model the fewest coefficients.
pub(super) fn estimate(rate_hz: u32, signal: &[f64], plain: PaddedSpectrum, known: KnownBand) -> Estimate {
    let rate_hz = f64::from(rate_hz);
    let tapered = PaddedSpectrum::tapered(signal, plain.max_lag());
    let leaks = |bands: &Bands, density: &[f64], power: f64| {
        let with_leakage = Bands::of_density(density, power, rate_hz);
        bands.largest_excess_db(&with_leakage, signal.len()) > TOLERABLE_LEAKAGE_DB
    };
    if known.is_all() {
        // Of the two spectra, only the one that gives the lags is transformed back.
        let power = plain.mean_square();
        let bands = Bands::of_density(&tapered.power, power, rate_hz);
        let leaks = leaks(&bands, &plain.power, power);
        let lags = if leaks { &tapered } else { &plain }.lags();
        return Estimate { lags, bands };
    }
    let filled = |whole: PaddedSpectrum| whole.into_autocorrelation().filled(known.from_hz, known.to_hz, rate_hz);
    let tapered = filled(tapered);
    let bands = Bands::of_density(&tapered.power, tapered.lags[0], rate_hz);
    // A high-pass filter has removed what leaks most, so leakage is not measured after it: the tapered estimate is
    // used.
    let plain = known.from_hz.is_none().then(|| filled(plain));
    let plain = plain.filter(|plain| !leaks(&bands, &plain.power, plain.lags[0]));
    Estimate {
        lags: plain.unwrap_or(tapered).lags,
        bands,
    }
}

/// Estimates the autocorrelation of the `parts` of a signal at `rate_hz`, up to `max_lag`: the mean over the parts,
/// weighted by their lengths.
pub(super) fn estimate_of(rate_hz: u32, parts: &[&[f64]], max_lag: usize, known: KnownBand) -> Estimate {
    let samples: usize = parts.iter().map(|part| part.len()).sum();
    let of_part = |part: &&[f64]| {
        let weight = part.len() as f64 / samples.max(1) as f64;
        (
            weight,
            estimate(rate_hz, part, PaddedSpectrum::of(part, max_lag), known),
        )
    };
    let estimates: Vec<(f64, Estimate)> = parts.iter().map(of_part).collect();
    let lags = estimates.iter().map(|(weight, estimate)| (*weight, &estimate.lags[..]));
    Estimate {
        lags: pooled_lags(lags),
        bands: Bands::mean(estimates.iter().map(|(weight, estimate)| (*weight, &estimate.bands))),
    }
}

/// Returns the weighted mean of autocorrelations, as long as the longest; the weights add up to one.
pub(super) fn pooled_lags<'a>(terms: impl Iterator<Item = (f64, &'a [f64])>) -> Vec<f64> {
    let mut pooled = Vec::new();
    for (weight, lags) in terms {
        if pooled.len() < lags.len() {
            pooled.resize(lags.len(), 0.0);
        }
        for (sum, lag) in pooled.iter_mut().zip(lags) {
            *sum += weight * lag;
        }
    }
    pooled
}

/// Number of bands, from 4 Hz to 2 kHz: from those of the hand's motion, into which the tool's lowest mode leaks, up to
/// the last whole band below half of 5 kHz.
pub(super) const COUNT: usize = 28;

/// Exponent of the lowest band's centre, 10^(6/10) Hz: base ten of IEC 61260-1.
const LOWEST: f64 = 6.0;

/// Index of the lowest band that is felt, that of 20 Hz.
const FELT: usize = 7;

/// Ratio of a band's power to that of the strongest band below which the band is not felt.
const AUDIBLE_SHARE: f64 = 1e-5;

/// Least product of a band's width and the recording's length. Below it, the standard deviation of the band's own level
/// exceeds 1.4 dB, and the band is not judged.
const LEAST_DEGREES: f64 = 9.0;

/// Least degrees of freedom of a band that is felt if both spectra come from one recording, because they then scatter
/// together.
const FELT_DEGREES: f64 = 1.0;

/// Number of standard deviations of a band's level by which a model of lower order may miss the recording's level, up
/// to [`UNFELT_DB`].
const SCATTER: f64 = 1.5;

/// Largest level error that a lower order may cause, dB: half of the least change that is felt.
const UNFELT_DB: f64 = 0.5 * AMPLITUDE_JND_DB;

/// Power in each band, in (signal's unit)².
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bands {
    powers: [f64; COUNT],
    /// Sample rate of the signal, Hz.
    rate_hz: f64,
}

/// A band with a level, in dB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BandLevel {
    /// Centre of the band, Hz.
    pub centre_hz: f64,
    /// Level, dB.
    pub level_db: f64,
}

impl Bands {
    /// Returns the bands of a spectrum of total power `power`. Its `density`, in any unit, is at evenly spaced
    /// frequencies from 0 Hz to half of the sample rate `rate_hz`.
    pub(super) fn of_density(density: &[f64], power: f64, rate_hz: f64) -> Self {
        let last = density.len() - 1;
        let step_hz = rate_hz / 2.0 / last as f64;
        // The bins at both ends are half as wide as the others.
        let total = density.iter().sum::<f64>() - 0.5 * (density[0] + density[last]);
        let scale = if total > 0.0 { power / total } else { 0.0 };
        let powers = std::array::from_fn(|band| {
            let (low, high) = edges_hz(band);
            let (low, high) = (low / step_hz, high / step_hz);
            let (first, end) = (low.round() as usize, (high.round() as usize).min(last));
            let part = |bin: usize| {
                let share = (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
                density[bin] * share.max(0.0)
            };
            if first >= end {
                return scale * (first..=end).map(part).sum::<f64>();
            }
            // All bins except those at both ends count in full.
            let inner = density[first + 1..end].iter();
            scale * (inner.fold(part(first), |sum, bin| sum + bin) + part(end))
        });
        Self { powers, rate_hz }
    }

    /// Returns the bands of the output of `model` at `rate_hz`, computed at `bins` frequencies. The model must not be
    /// silent.
    fn of_model(model: &Model, bins: usize, rate_hz: f64) -> Self {
        let mut density = density_of_model(model, bins);
        // The bins at both ends are half as wide as the others.
        let total = sum(&density) - 0.5 * (density[0] + density[bins - 1]);
        // A line that is narrower than the spacing of the frequencies gets too little power in the sum if it lies
        // between two of them, and too much if it lies on one. The model's power is known, so the difference is
        // assigned to the strongest bin.
        let amiss = model.output_power * (bins - 1) as f64 - total;
        let (_, most) = extremes(&density);
        if let Some(strongest) = density.iter_mut().rfind(|bin| **bin >= most) {
            *strongest = (*strongest + amiss).max(0.0);
        }
        Self::of_density(&density, model.output_power, rate_hz)
    }

    /// Returns the weighted mean of bands of one rate; the weights add up to one.
    pub(super) fn mean<'a>(terms: impl IntoIterator<Item = (f64, &'a Self)>) -> Self {
        let mut mean = Self {
            powers: [0.0; COUNT],
            rate_hz: f64::from(SAMPLE_RATE_HZ),
        };
        for (weight, bands) in terms {
            mean.rate_hz = bands.rate_hz;
            for (sum, power) in mean.powers.iter_mut().zip(&bands.powers) {
                *sum += weight * power;
            }
        }
        mean
    }

    /// Returns the centre, Hz, and level, dB, of each band that has power and that a recording of `samples` samples is
    /// long enough to measure.
    pub(super) fn known_db(&self, samples: usize) -> Vec<(f64, f64)> {
        let duration_s = samples as f64 / self.rate_hz;
        (0..COUNT)
            .filter(|&band| {
                let (low, high) = edges_hz(band);
                (high - low) * duration_s >= LEAST_DEGREES && self.powers[band] > 0.0
            })
            .map(|band| (centre_hz(band), 10.0 * self.powers[band].log10()))
            .collect()
    }

    /// Returns the level of `other` relative to this one, in each band that is within 50 dB of this one's strongest and
    /// that a recording of `samples` samples is long enough to measure. Each comes with the standard deviation of the
    /// band's own level, dB. Bands that are felt, from 20 Hz on, only need `felt_degrees`.
    fn levels_db<'a>(
        &'a self,
        other: &'a Self,
        samples: usize,
        felt_degrees: f64,
    ) -> impl Iterator<Item = (BandLevel, f64)> + 'a {
        let strongest = self.powers.iter().copied().fold(0.0, f64::max);
        let duration_s = samples as f64 / self.rate_hz;
        (0..COUNT).filter_map(move |band| {
            let (low, high) = edges_hz(band);
            let degrees = (high - low) * duration_s;
            let least = if band < FELT { LEAST_DEGREES } else { felt_degrees };
            let known = degrees >= least && self.powers[band] > AUDIBLE_SHARE * strongest;
            let level_db = 10.0 * (other.powers[band] / self.powers[band]).log10();
            let level = BandLevel {
                centre_hz: centre_hz(band),
                level_db,
            };
            // The power of noise in a band B over a time T has a relative deviation of 1/√(BT) (Bendat and Piersol,
            // Random Data, 4th edition, 2010, ch. 8).
            known.then(|| (level, 10.0 / std::f64::consts::LN_10 / degrees.sqrt()))
        })
    }

    /// Returns the largest level of `other`, another spectrum of the same recording, relative to this one in any band,
    /// dB; zero if no band can be measured.
    pub(super) fn largest_excess_db(&self, other: &Self, samples: usize) -> f64 {
        // The bands that are strong in `other` count. Both spectra are of one recording, so they scatter together.
        other
            .levels_db(self, samples, FELT_DEGREES)
            .map(|(level, _)| -level.level_db)
            .fold(0.0, f64::max)
    }

    /// Returns an order, at most that of `model`, with which every band of a recording of `samples` samples is
    /// preserved. A band is preserved if it is within [`SCATTER`] standard deviations and [`UNFELT_DB`] of the
    /// recording's, or as near to it as with all of `model`. The search assumes that no band gets worse as the order
    /// rises.
    pub(super) fn sufficient_order(&self, model: &Model, samples: usize) -> usize {
        /// Number of frequencies of a first search, which takes a sixth of the time.
        const FEW_BINS: usize = 1281;
        let levels = |order: usize, bins: usize| {
            // Lower orders need not be fitted again: their models are the first stages of this lattice.
            let model = Model {
                reflection: model.reflection[..order].to_vec(),
                ..model.clone()
            };
            let bands = Self::of_model(&model, bins, self.rate_hz);
            self.levels_db(&bands, samples, FELT_DEGREES)
                .map(|(level, deviation_db)| {
                    let free_db = UNFELT_DB.min(SCATTER * deviation_db);
                    (level.level_db.abs(), free_db)
                })
                .collect::<Vec<_>>()
        };
        let highest = model.reflection.len();
        let of_all = |bins: usize| {
            let wanted = levels(highest, bins);
            move |order: usize| {
                (levels(order, bins).iter().zip(&wanted)).all(|((own, free), (wanted, _))| own <= &wanted.max(*free))
            }
        };
        let likely = lowest(0..highest, of_all(FEW_BINS));
        let is_held = of_all(BINS);
        if is_held(likely) {
            likely
        } else {
            lowest(likely + 1..highest, is_held)
        }
    }

    /// Returns the band of `model` that is furthest from this recording's. Only those count that are more than
    /// `limit_db` plus two standard deviations of the recording's own level away.
    pub(super) fn missed_by(&self, model: &Model, samples: usize, limit_db: f64) -> Option<BandLevel> {
        let at = |bins: usize| {
            let bands = Self::of_model(model, bins, self.rate_hz);
            self.levels_db(&bands, samples, LEAST_DEGREES)
                .filter(|(level, deviation_db)| level.level_db.abs() > limit_db + 2.0 * deviation_db)
                .map(|(level, _)| level)
                .max_by(|a, b| a.level_db.abs().total_cmp(&b.level_db.abs()))
        };
        // A coarse grid misses a narrow resonance, and a fine one resolves it. Only a suspicion justifies the time of
        // the fine one.
        at(BINS).and_then(|_| at(FINE_BINS))
    }
}

/// Returns the lowest of `orders` from which on all are held, by bisection; their end if none is.
fn lowest(orders: Range<usize>, is_held: impl Fn(usize) -> bool) -> usize {
    let (mut too_low, mut enough) = (orders.start, orders.end);
    while too_low < enough {
        let order = usize::midpoint(too_low, enough);
        if is_held(order) {
            enough = order;
        } else {
            too_low = order + 1;
        }
    }
    enough
}

/// Returns the centre of a band, Hz.
///
/// Centres and edges differ in their last bits from [`third_octave_hz`](stylus_dsp::spectrum::third_octave_hz), and
/// stay, because a bit of a band's power may decide on a model's order, and so on the bytes of a library.
fn centre_hz(band: usize) -> f64 {
    10f64.powf((LOWEST + band as f64) / 10.0)
}

fn edges_hz(band: usize) -> (f64, f64) {
    static EDGES_HZ: LazyLock<[(f64, f64); COUNT]> = LazyLock::new(|| {
        std::array::from_fn(|band| {
            let centre = LOWEST + band as f64;
            (10f64.powf((centre - 0.5) / 10.0), 10f64.powf((centre + 0.5) / 10.0))
        })
    });
    EDGES_HZ[band]
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{near, noise};

    fn chosen(signal: &[f64]) -> [Vec<f64>; 3] {
        let plain = PaddedSpectrum::of(signal, 400);
        let tapered = PaddedSpectrum::tapered(signal, 400).lags();
        let rectangular = plain.lags();
        [
            estimate(SAMPLE_RATE_HZ, signal, plain, KnownBand::default()).lags,
            rectangular,
            tapered,
        ]
    }

    #[test]
    fn ends_are_tapered_where_a_strong_band_leaks_and_nowhere_else() {
        let white: Vec<f64> = noise(1, 20_000);
        let [auto, rectangular, tapered] = chosen(&white);
        assert_eq!(auto, rectangular);
        assert_ne!(auto, tapered);
        // Integrated twice, noise falls by 12 dB per octave, and a rectangular window leaks 6 dB per octave.
        let (mut velocity, mut place) = (0.0, 0.0);
        let steep: Vec<f64> = white
            .iter()
            .map(|x| {
                velocity = 0.999 * velocity + x;
                place = 0.999 * place + velocity;
                place
            })
            .collect();
        let [auto, rectangular, tapered] = chosen(&steep);
        assert_eq!(auto, tapered);
        assert_ne!(auto, rectangular);
        near(auto[0] / rectangular[0], 1.0, 1e-9);
    }

    fn model(radius: f64, frequency_hz: f64) -> Model {
        let angle = std::f64::consts::TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
        let k2 = radius * radius;
        Model::new(vec![-2.0 * radius * angle.cos() / (1.0 + k2), k2], 3.0)
    }

    #[test]
    fn white_noise_has_power_in_proportion_to_a_bands_width() {
        for (band, power) in Bands::of_density(&vec![7.0; 10_001], 2500.0, f64::from(SAMPLE_RATE_HZ))
            .powers
            .iter()
            .enumerate()
        {
            let (low, high) = edges_hz(band);
            assert!((power / (high - low) - 1.0).abs() < 1e-9, "{band}: {power}");
        }
        let (low, high) = (edges_hz(0).0, edges_hz(COUNT - 1).1);
        assert!(low < 3.6 && high > 2200.0 && high < 2500.0);
    }

    #[test]
    fn a_model_misses_no_band_of_itself_and_those_of_another_by_name() {
        // Sixty seconds are enough to measure the lowest band.
        let recording = Bands::of_model(&model(0.98, 50.0), FINE_BINS, f64::from(SAMPLE_RATE_HZ));
        let missed = |m: &Model| recording.missed_by(m, 300_000, 3.0);
        assert_eq!(missed(&model(0.98, 50.0)), None);
        let level = missed(&model(0.98, 100.0)).unwrap();
        assert!(level.level_db.abs() > 6.0, "{level:?}");
        // A tenth of a second is too short for the lowest bands, and most others are inexact.
        assert_eq!(
            recording.missed_by(&model(0.97, 50.0), 500, 3.0),
            None,
            "nothing is known of a short recording"
        );
    }

    #[test]
    fn a_narrow_resonance_between_two_frequencies_is_no_miss() {
        let narrow = model(0.99999, 200.23);
        let recording = Bands::of_model(&narrow, 10 * FINE_BINS, f64::from(SAMPLE_RATE_HZ));
        assert_eq!(recording.missed_by(&narrow, 300_000, 3.0), None);
    }
}
