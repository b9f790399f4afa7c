//! A plant's response, for the page's switch between the pin and the tip, as it is and after a calibration.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use model_format::scene::Biquad;
use serde::Serialize;
use stylus_plant::{Complex, Plant};

use crate::dsp::equaliser::{CALIBRATION_GAIN_DB, Response, design};

/// Distance of the response's frequencies, Hz: an impulse response of half a second.
const STEP_HZ: f64 = 2.0;

/// Highest of the response's frequencies, Hz: a kernel at 10 kHz plays nothing above it.
const HIGHEST_HZ: f64 = 5000.0;

/// Rate at which a calibration's equaliser is designed here, Hz. Below 1 kHz one for 5 kHz does the same.
const RATE_HZ: f64 = 10_000.0;

/// Frequencies at which a calibration measures, Hz.
const MEASURED_HZ: std::ops::RangeInclusive<u32> = 10..=1000;

/// Third octaves from the lowest frequency of the band in which tip and pin have the same mean level.
const LEVEL_BANDS: i32 = 15;
const LEVEL_FROM_HZ: f64 = 30.0;

/// A plant's response.
#[derive(Serialize)]
pub struct TipData {
    name: String,
    step_hz: f64,
    /// The plant's response at multiples of `step_hz`, at a mean level of 0 dB: real and imaginary parts, `f32` in
    /// little endian, in Base64.
    tip: String,
    /// The response through the equaliser of a calibration, in the form of `tip`.
    calibrated: String,
}

impl TipData {
    /// The response of `plant`, called `name`, with a mean level of 0 dB over third octaves from 30 to 760 Hz. A second
    /// response is the one after a calibration that knows the plant without noise.
    pub fn of(name: &str, plant: &Plant) -> Self {
        let level_db = |hz: f64| (hz, 20.0 * plant.response(hz).norm().log10());
        let points = MEASURED_HZ.step_by(5).map(|hz| level_db(f64::from(hz)));
        // A plant without a finite response is left as it is.
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

/// `response` over frequency with a mean level of 0 dB, in base 64.
fn levelled(response: impl Fn(f64) -> Complex<f64>) -> String {
    // The mean of logarithms, because levels are to agree: a resonance's peak would decide a mean of powers.
    let bands = (0..LEVEL_BANDS).map(|band| LEVEL_FROM_HZ * 2_f64.powf(f64::from(band) / 3.0));
    let logarithms = bands.map(|hz| response(hz).norm().ln());
    let level = (logarithms.sum::<f64>() / f64::from(LEVEL_BANDS)).exp();
    let steps = (HIGHEST_HZ / STEP_HZ) as u32;
    // Nothing moves at zero frequency, where a stylus that hangs free has no steady state.
    let there = (1..=steps).map(|step| response(f64::from(step) * STEP_HZ) / level);
    let parts = there.flat_map(|response| [response.re, response.im]);
    let parts = [0.0, 0.0].into_iter().chain(parts);
    let bytes: Vec<u8> = parts.flat_map(|part| (part as f32).to_le_bytes()).collect();
    STANDARD.encode(bytes)
}

/// The response of `sections` in a row at `hz`.
fn cascade(sections: &[Biquad], hz: f64) -> Complex<f64> {
    let delay = Complex::cis(-std::f64::consts::TAU * hz / RATE_HZ);
    let of = |section: &Biquad| {
        let ([b0, b1, b2], [a1, a2]) = (section.numerator(), section.denominator());
        ((delay * b2 + b1) * delay + b0) / ((delay * a2 + a1) * delay + 1.0)
    };
    sections.iter().map(of).product()
}
