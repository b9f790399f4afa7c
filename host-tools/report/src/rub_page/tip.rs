//! A plant's response, with and without a calibration, for the page's switch between pin and tip.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use model_format::scene::Biquad;
use serde::Serialize;
use stylus_dsp::equaliser::{CALIBRATION_GAIN_DB, Response, design};
use stylus_plant::{Complex, Plant};

/// Spacing of the response's frequencies, Hz. It gives an impulse response half a second long.
const STEP_HZ: f64 = 2.0;

/// Highest of the response's frequencies, Hz. A kernel at 10 kHz plays nothing above it.
const HIGHEST_HZ: f64 = 5000.0;

/// Sample rate for which a calibration's equaliser is designed here, Hz. Below 1 kHz an equaliser for 5 kHz has the
/// same effect.
const RATE_HZ: f64 = 10_000.0;

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
            .and_then(|response| design(&response, RATE_HZ, CALIBRATION_GAIN_DB).ok());
        let sections = designed.map_or_else(Vec::new, |design| design.biquads);
        Self {
            name: name.to_owned(),
            step_hz: STEP_HZ,
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
    let steps = (HIGHEST_HZ / STEP_HZ) as u32;
    // The response at zero frequency is set to zero, because a stylus that hangs free has no steady state.
    let parts = (1..=steps)
        .map(|step| response(f64::from(step) * STEP_HZ) / level)
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
    let delay = Complex::cis(-std::f64::consts::TAU * hz / RATE_HZ);
    let of = |section: &Biquad| {
        let ([b0, b1, b2], [a1, a2]) = (section.numerator(), section.denominator());
        ((delay * b2 + b1) * delay + b0) / ((delay * a2 + a1) * delay + 1.0)
    };
    sections.iter().map(of).product()
}
