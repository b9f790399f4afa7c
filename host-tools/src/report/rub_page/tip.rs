//! A plant's response, for the page's switch between the pin and the tip.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use stylus_plant::Plant;

/// Distance of the response's frequencies, Hz: an impulse response of half a second.
const STEP_HZ: f64 = 2.0;

/// The highest one, Hz: a kernel at 10 kHz plays nothing above it.
const HIGHEST_HZ: f64 = 5000.0;

/// Third octaves from the lowest frequency of the band in which tip and pin have the same mean level.
const LEVEL_BANDS: i32 = 15;
const LEVEL_FROM_HZ: f64 = 30.0;

/// A plant's response.
#[derive(Serialize)]
pub struct TipData {
    name: String,
    step_hz: f64,
    /// Real and imaginary parts by frequency, f32 in little endian.
    response_base64: String,
}

impl TipData {
    /// The response of `plant`, called `name`, with a mean level of 0 dB over third octaves from 30 to 760 Hz.
    pub fn of(name: &str, plant: &Plant) -> Self {
        let bands = (0..LEVEL_BANDS).map(|band| LEVEL_FROM_HZ * 2_f64.powf(f64::from(band) / 3.0));
        let logarithms = bands.map(|hz| plant.response(hz).norm().ln());
        let level = (logarithms.sum::<f64>() / f64::from(LEVEL_BANDS)).exp();
        let steps = (HIGHEST_HZ / STEP_HZ) as u32;
        // Nothing moves at zero frequency, where a stylus that hangs free has no steady state.
        let response = (1..=steps).map(|step| plant.response(f64::from(step) * STEP_HZ) / level);
        let parts = response.flat_map(|response| [response.re, response.im]);
        let parts = [0.0, 0.0].into_iter().chain(parts);
        let bytes: Vec<u8> = parts.flat_map(|part| (part as f32).to_le_bytes()).collect();
        Self {
            name: name.to_owned(),
            step_hz: STEP_HZ,
            response_base64: STANDARD.encode(bytes),
        }
    }
}
