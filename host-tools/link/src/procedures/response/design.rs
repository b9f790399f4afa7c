//! The equalisers and the absolute level of a measured response.

use model_format::PlayRate;
use model_format::link::Setting;
use model_format::scene::Biquad;
use stylus_dsp::equaliser::{self, Response, cascade_db};
use stylus_dsp::response::{MeasuredResponse, db, ratio};

use super::identify::{BAND_HZ, Bounds, Options};
use super::{Failure, Result, Verdict};

/// Band that must be within the limits, Hz. Outside it, the limits may leave a part uncorrected, which is reported.
const NEEDED_HZ: [f64; 2] = [60.0, 500.0];

/// Number of frequencies at which flatness is judged, evenly spaced on a logarithmic scale.
const POINTS: u32 = 200;

/// Equalisers, and the output gain that belongs to them.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Design {
    /// Sections at 5 and at 10 kHz.
    pub sections: [Vec<Biquad>; 2],
    /// Voltage at the pin per acceleration, V per m/s².
    pub output_gain: f64,
    /// Part of the band from 30 to 800 Hz that can be corrected within the limits, Hz.
    pub band_hz: [f64; 2],
    /// Largest gain of the equaliser relative to the response's mean, dB.
    pub max_gain_db: f64,
}

/// Deviation of a response from flat over a band.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Flatness {
    /// Mean level, dB.
    pub level_db: f64,
    /// RMS deviation from the mean, dB.
    pub rms_db: f64,
    /// Largest deviation from the mean, dB.
    pub worst_db: f64,
}

impl Flatness {
    /// The flatness of a level over `band_hz`, each octave with the same weight.
    pub(super) fn of(band_hz: [f64; 2], level_db: impl Fn(f64) -> f64) -> Self {
        let [low, high] = band_hz.map(f64::ln);
        let levels: Vec<f64> = (0..POINTS)
            .map(|n| level_db((low + (high - low) * f64::from(n) / f64::from(POINTS - 1)).exp()))
            .collect();
        let mean = levels.iter().sum::<f64>() / f64::from(POINTS);
        let off = || levels.iter().map(|level| level - mean);
        Self {
            level_db: mean,
            rms_db: (off().map(|off| off * off).sum::<f64>() / f64::from(POINTS)).sqrt(),
            worst_db: off().fold(0.0, |most, off| most.max(off.abs())),
        }
    }
}

/// Returns the measured level over frequency.
pub(super) fn response(measured: &MeasuredResponse) -> Result<Response> {
    Response::new(measured.points()).map_err(|fault| Verdict::Noisy.failure(fault.to_string()))
}

/// Designs equalisers and level for `measured`.
///
/// # Errors
/// A response with too few trusted lines, limits that leave too little of the band, or an output gain out of its range.
pub(super) fn design(
    measured: &MeasuredResponse,
    bounds: &Bounds,
    options: &Options,
    is_positive: bool,
) -> Result<Design> {
    let measured = response(measured)?;
    // A sine of the reference level may need no more voltage than the limits allow, so the response must have at least
    // this level.
    let floor_db = db(options.level_m_s2 / bounds.sine_volts());
    let band_hz = allowed(&measured, floor_db);
    if band_hz[0] > NEEDED_HZ[0] || band_hz[1] < NEEDED_HZ[1] {
        let [low_hz, high_hz] = band_hz;
        return Err(beyond(low_hz, high_hz));
    }
    let known = measured.points();
    let (first, last) = (known[0].0, known[known.len() - 1].0);
    // A level below the floor counts as the floor, so that the equaliser asks for no voltage beyond the limits.
    let floored = known
        .iter()
        .map(|&(hz, level_db)| (hz, level_db.max(floor_db)))
        .collect();
    let floored = Response::new(floored).unwrap_or(measured.clone());
    let of_rate = |rate: PlayRate| {
        equaliser::design(&floored, rate.hz().into(), options.max_gain_db).map_err(|_| beyond(first, last))
    };
    let [five, ten] = [of_rate(PlayRate::Hz5000)?, of_rate(PlayRate::Hz10000)?];
    let after = Flatness::of(band_hz, |hz| {
        measured.level_db(hz) + cascade_db(&five.biquads, PlayRate::Hz5000.hz().into(), hz)
    });
    let output_gain = ratio(-after.level_db);
    if Setting::OutputGain.check(output_gain as f32).is_err() {
        let seen = format!("output-gain would be {output_gain:.2e} V/(m/s²)");
        return Err(Verdict::OutputGain.failure(seen));
    }
    let max_gain_db = five.max_gain_db.max(ten.max_gain_db);
    let mut sections = [five.biquads, ten.biquads];
    if !is_positive {
        sections.iter_mut().for_each(invert);
    }
    Ok(Design {
        sections,
        output_gain,
        band_hz,
        max_gain_db,
    })
}

fn beyond(low_hz: f64, high_hz: f64) -> Failure {
    Verdict::BeyondLimits.failure(format!("only {low_hz:.0} to {high_hz:.0} Hz can be corrected"))
}

/// Returns the band around the middle of [`NEEDED_HZ`] in which the response is at least `floor_db`, Hz.
fn allowed(response: &Response, floor_db: f64) -> [f64; 2] {
    // The search goes outwards from the middle, so that what lies beyond a gap does not count.
    let middle = (NEEDED_HZ[0] * NEEDED_HZ[1]).sqrt();
    let is_low = |point: &&(f64, f64)| point.1 < floor_db;
    let points = || response.points().iter();
    let below = points().filter(|point| point.0 <= middle).rev().find(is_low);
    let above = points().filter(|point| point.0 > middle).find(is_low);
    let ends = [0, response.points().len() - 1].map(|end| response.points()[end].0);
    [
        BAND_HZ[0].max(below.map_or(ends[0], |point| point.0)),
        BAND_HZ[1].min(above.map_or(ends[1], |point| point.0)),
    ]
}

/// Inverts the sign of a cascade, and adds a section if it has none.
fn invert(sections: &mut Vec<Biquad>) {
    if sections.is_empty() {
        sections.push(Biquad::IDENTITY);
    }
    // The sign of one section is that of the whole cascade.
    sections[0].numerator = sections[0].numerator.map(|value| -value);
}
