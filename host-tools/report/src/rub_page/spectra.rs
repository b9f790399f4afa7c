//! What the page draws over frequency: power densities of recordings and models in twelfth-octave bands, and a plant's
//! response, with and without a calibration, for the page's switch between pin and tip.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use model_format::scene::Biquad;
use model_format::{Node, SAMPLE_RATE_HZ};
use serde::Serialize;
use stylus_dsp::equaliser::{CALIBRATION_GAIN_DB, Response, design};
use stylus_dsp::log_spectrum::LogSpectrum;
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::{PowerSpectrum, longest_segment};
use stylus_fit::texture::quantise::reflection;
use stylus_plant::{Complex, Plant};

/// Bands per octave.
const BANDS_PER_OCTAVE: f64 = 12.0;

/// Centre of the lowest band, Hz.
const LOWEST_BAND_HZ: f64 = 20.0;

/// Number of bands. The centre of the last is the highest one up to 1 kHz.
const BANDS: usize = 68;

/// Steps of a code per decibel.
pub const STEPS_PER_DB: f64 = 2.0;

/// Code of a band without power.
const NO_POWER: u8 = u8::MAX;

/// Number of frequencies of a model's spectrum. At 5 kHz they are 0.5 Hz apart, less than half the narrowest band's
/// width.
const MODEL_BINS: usize = 5001;

/// Centres of the bands, Hz, ascending.
pub fn band_centres_hz() -> impl Iterator<Item = f64> {
    (0..BANDS).map(|band| LOWEST_BAND_HZ * (band as f64 / BANDS_PER_OCTAVE).exp2())
}

/// Lower and upper edge of each band, Hz.
fn band_edges_hz() -> impl Iterator<Item = (f64, f64)> {
    let half = (0.5 / BANDS_PER_OCTAVE).exp2();
    band_centres_hz().map(move |centre| (centre / half, centre * half))
}

/// Mean power densities, (m/s²)²/Hz, one per band; 0 where there is no power.
pub struct Spectrum([f64; BANDS]);

impl Spectrum {
    /// A spectrum without power.
    pub fn silence() -> Self {
        Self([0.0; BANDS])
    }

    /// Computes the mean density in each band. `power_between` returns the power between two frequencies, Hz.
    fn of(power_between: impl Fn(f64, f64) -> f64) -> Self {
        let mut densities = [0.0; BANDS];
        for (density, (low, high)) in densities.iter_mut().zip(band_edges_hz()) {
            *density = power_between(low, high) / (high - low);
        }
        Self(densities)
    }

    /// Levels, dB re 1 (m/s²)²/Hz; `None` for a band without power.
    pub fn levels_db(&self) -> impl Iterator<Item = Option<f64>> {
        self.0
            .iter()
            .map(|&density| (density > 0.0).then(|| 10.0 * density.log10()))
    }

    /// Highest level, dB re 1 (m/s²)²/Hz; negative infinity for silence.
    pub fn highest_db(&self) -> f64 {
        self.levels_db().flatten().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Levels as numbers of steps of 0.5 dB below `top_db`, an upper bound of all levels.
    pub fn codes(&self, top_db: f64) -> Vec<u8> {
        let code = |level: Option<f64>| {
            let steps = level.map(|db| (STEPS_PER_DB * (top_db - db)).round());
            // A level below the range of the codes counts as the weakest, not as silence.
            steps.map_or(NO_POWER, |steps| steps.min(f64::from(NO_POWER - 1)) as u8)
        };
        self.levels_db().map(code).collect()
    }
}

/// Returns the spectrum of a node's model as it is played, without lines, at the node's own level.
pub fn model_spectrum(node: &Node<'_>, rate_hz: f64) -> Spectrum {
    let output_power = f64::from(node.output_power);
    if output_power <= 0.0 {
        return Spectrum::silence();
    }
    let model = Model {
        reflection: reflection(node.coefficients),
        output_power,
        flags: node.flags,
    };
    let values = LogSpectrum::of_model_at(&model, MODEL_BINS);
    let step_hz = rate_hz / 2.0 / (MODEL_BINS - 1) as f64;
    Spectrum::of(|low_hz, high_hz| {
        // Each value stands for the frequencies that are nearer to its own frequency than to any other.
        let first = (low_hz / step_hz).round() as usize;
        let last = ((high_hz / step_hz).round() as usize).min(MODEL_BINS - 1);
        let share = |bin: usize| {
            let (from, to) = ((bin as f64 - 0.5) * step_hz, (bin as f64 + 0.5) * step_hz);
            (to.min(high_hz) - from.max(low_hz)).max(0.0)
        };
        let values = (first..=last).filter_map(|bin| Some((bin, values.values().get(bin)?)));
        // One-sided density, per hertz: twice the two-sided density, divided by the sample rate.
        values.map(|(bin, value)| value.exp() * share(bin)).sum::<f64>() * 2.0 / rate_hz
    })
}

/// Returns the mean spectrum of the recordings of one node, m/s²; `None` if they are silent.
pub fn recorded_spectrum(signals: &[Vec<f64>]) -> Option<Spectrum> {
    let blocks: Vec<&[f64]> = signals.iter().map(Vec::as_slice).collect();
    let shortest = blocks.iter().map(|block| block.len()).min()?;
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    // Each of several recordings must contain at least one segment, because their spectra are averaged.
    let segment = longest_segment(rate_hz).min(shortest);
    let density = PowerSpectrum::of_blocks(&blocks, segment, rate_hz);
    let spectrum = Spectrum::of(|low_hz, high_hz| density.power_between(low_hz, high_hz));
    spectrum.highest_db().is_finite().then_some(spectrum)
}

/// Spacing of the response's frequencies, Hz. It gives an impulse response half a second long.
const RESPONSE_STEP_HZ: f64 = 2.0;

/// Highest of the response's frequencies, Hz. A kernel at 10 kHz plays nothing above it.
const RESPONSE_HIGHEST_HZ: f64 = 5000.0;

/// Sample rate for which a calibration's equaliser is designed here, Hz. Below 1 kHz an equaliser for 5 kHz has the
/// same effect.
const EQUALISER_RATE_HZ: f64 = 10_000.0;

/// Frequencies at which a calibration measures, Hz.
const MEASURED_HZ: std::ops::RangeInclusive<u32> = 10..=1000;

/// Number of third-octave bands, and centre of the lowest, Hz, over which tip and pin have the same mean level.
const LEVEL_BANDS: i32 = 15;
const LEVEL_FROM_HZ: f64 = 30.0;

/// A plant's response.
#[derive(Serialize)]
pub struct TipData {
    name: String,
    step_hz: f64,
    /// The plant's response at multiples of `step_hz`, with 0 at 0 Hz and a mean level of 0 dB. Real and imaginary
    /// parts alternate, as little-endian `f32` in Base64.
    tip: String,
    /// The response through a calibration's equaliser, in the same form as `tip`.
    calibrated: String,
}

impl TipData {
    /// Computes the response of `plant`, called `name`, with a mean level of 0 dB over third-octave bands from 30 to
    /// 760 Hz. A second response includes a calibration that measures the plant without noise.
    pub fn of(name: &str, plant: &Plant) -> Self {
        let level_db = |hz: f64| (hz, 20.0 * plant.response(hz).norm().log10());
        let points = MEASURED_HZ.step_by(5).map(|hz| level_db(f64::from(hz)));
        // A plant without a finite response is not equalised.
        let designed = Response::new(points.collect())
            .ok()
            .and_then(|response| design(&response, EQUALISER_RATE_HZ, CALIBRATION_GAIN_DB).ok());
        let sections = designed.map_or_else(Vec::new, |design| design.biquads);
        Self {
            name: name.to_owned(),
            step_hz: RESPONSE_STEP_HZ,
            tip: levelled(|hz| plant.response(hz)),
            calibrated: levelled(|hz| plant.response(hz) * cascade(&sections, hz)),
        }
    }
}

/// Encodes `response` over frequency, with a mean level of 0 dB, in Base64.
fn levelled(response: impl Fn(f64) -> Complex<f64>) -> String {
    // The mean of logarithms is taken, because levels have to agree. A mean of powers would be dominated by a
    // resonance's peak.
    let logarithms = (0..LEVEL_BANDS)
        .map(|band| LEVEL_FROM_HZ * 2_f64.powf(f64::from(band) / 3.0))
        .map(|hz| response(hz).norm().ln());
    let level = (logarithms.sum::<f64>() / f64::from(LEVEL_BANDS)).exp();
    let steps = (RESPONSE_HIGHEST_HZ / RESPONSE_STEP_HZ) as u32;
    // The response at zero frequency is set to zero, because a stylus that hangs free has no steady state.
    let parts = (1..=steps)
        .map(|step| response(f64::from(step) * RESPONSE_STEP_HZ) / level)
        .flat_map(|response| [response.re, response.im]);
    let bytes: Vec<u8> = [0.0, 0.0]
        .into_iter()
        .chain(parts)
        .flat_map(|part| (part as f32).to_le_bytes())
        .collect();
    STANDARD.encode(bytes)
}

/// Returns the response at `hz` of `sections` in series.
fn cascade(sections: &[Biquad], hz: f64) -> Complex<f64> {
    let delay = Complex::cis(-std::f64::consts::TAU * hz / EQUALISER_RATE_HZ);
    let of = |section: &Biquad| {
        let ([b0, b1, b2], [a1, a2]) = (section.numerator(), section.denominator());
        ((delay * b2 + b1) * delay + b0) / ((delay * a2 + a1) * delay + 1.0)
    };
    sections.iter().map(of).product()
}
