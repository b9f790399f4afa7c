//! The equaliser: the inverse of a measured response of the actuator, as a cascade of peaking and shelving sections.
//!
//! The sections are those of Robert Bristow-Johnson's *Cookbook formulae for audio equalizer biquad filter
//! coefficients* (W3C Group Note, 2021), computed by the `biquad` crate. Levenberg-Marquardt fits their frequencies,
//! quality factors and gains to the level in dB at frequencies spaced evenly on a logarithmic scale. Sections are added
//! one at a time. Each is of the kind that lowers the residual most, and the fit ends when one more section would lower
//! the residual too little.
//!
//! **Level.** The equaliser inverts the deviation of the response from its mean level in dB over the band, so that the
//! corrected response is neither louder nor softer than necessary. No frequency is boosted by more than the limit. If
//! the response is further below its mean than the limit, some deviation remains.

mod design;
mod response;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use biquad::{Coefficients, Hertz, Type};
pub use design::{CALIBRATION_GAIN_DB, Design, design};
use model_format::scene::Biquad;
pub use response::{Response, ResponseFault};
use serde::Deserialize;

/// A value outside its range, with its key in the text of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Key of the value.
    pub key: &'static str,
    /// Description of the problem.
    pub problem: String,
}

impl Fault {
    fn new(key: &'static str, problem: impl Into<String>) -> Self {
        Self {
            key,
            problem: problem.into(),
        }
    }
}

/// Range of the frequency of a section, as a fraction of the sample rate. Below it, a section rings for longer than a
/// second at 5 kHz; above it, the upper flank does not fit below half the sample rate.
const FREQUENCY_SHARES: [f64; 2] = [0.0002, 0.45];

/// Range of the quality factors in a scene.
const QS: [f64; 2] = [0.1, 50.0];

/// Largest magnitude of a section's gain, dB; slightly less than the format's limit.
const MAX_SECTION_GAIN_DB: f64 = 24.0;

/// Effect of a section around its frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SectionKind {
    /// Raises or lowers the level near its frequency.
    Peaking,
    /// Raises or lowers the level below its frequency.
    LowShelf,
    /// Raises or lowers the level above its frequency.
    HighShelf,
}

/// A section of the equaliser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Kind of the section.
    pub kind: SectionKind,
    /// Centre frequency, Hz.
    pub frequency_hz: f64,
    /// Quality factor.
    pub q: f64,
    /// Gain, dB.
    pub gain_db: f64,
}

impl Section {
    /// Returns the stored form of the section at the sample rate `rate_hz`.
    ///
    /// # Errors
    /// The frequency, the quality factor or the gain is outside its range, or the coefficients do not fit the format.
    pub fn biquad(&self, rate_hz: f64) -> Result<Biquad, Fault> {
        let frequencies = FREQUENCY_SHARES.map(|share| share * rate_hz);
        within("frequency_hz", self.frequency_hz, frequencies, "Hz")?;
        within("q", self.q, QS, "")?;
        let gains = [-MAX_SECTION_GAIN_DB, MAX_SECTION_GAIN_DB];
        within("gain_db", self.gain_db, gains, "dB")?;
        self.coefficients(rate_hz)
            .and_then(|c| Biquad::from_f64([c.b0, c.b1, c.b2], [c.a1, c.a2]))
            .ok_or_else(|| Fault::new("gain_db", "its coefficients do not fit the stored format"))
    }

    /// Level at `frequency_hz`, dB, before rounding to the stored form.
    fn level_db(&self, rate_hz: f64, frequency_hz: f64) -> f64 {
        self.coefficients(rate_hz).map_or(f64::NAN, |c| {
            let numerator = [c.b0, c.b1, c.b2];
            level_db(numerator, [c.a1, c.a2], frequency_hz / rate_hz)
        })
    }

    /// Returns the unrounded coefficients; `None` if the crate refuses the parameters.
    fn coefficients(&self, rate_hz: f64) -> Option<Coefficients<f64>> {
        let kind = match self.kind {
            SectionKind::Peaking => Type::PeakingEQ(self.gain_db),
            SectionKind::LowShelf => Type::LowShelf(self.gain_db),
            SectionKind::HighShelf => Type::HighShelf(self.gain_db),
        };
        let rate = Hertz::<f64>::from_hz(rate_hz).ok()?;
        let frequency = Hertz::<f64>::from_hz(self.frequency_hz).ok()?;
        Coefficients::from_params(kind, rate, frequency, self.q).ok()
    }
}

/// Returns the level of a cascade of stored sections at `frequency_hz`, dB.
pub fn cascade_db(sections: &[Biquad], rate_hz: f64, frequency_hz: f64) -> f64 {
    let share = frequency_hz / rate_hz;
    sections.iter().map(|section| stored_level_db(section, share)).sum()
}

/// Filters `samples` by a cascade of stored sections, from rest.
pub fn filtered(sections: &[Biquad], samples: &[f64]) -> Vec<f64> {
    let mut samples = samples.to_vec();
    for section in sections {
        let ([b0, b1, b2], [a1, a2]) = (section.numerator(), section.denominator());
        let (mut first, mut second) = (0.0, 0.0);
        for sample in &mut samples {
            let output = b0 * *sample + first;
            first = b1 * *sample - a1 * output + second;
            second = b2 * *sample - a2 * output;
            *sample = output;
        }
    }
    samples
}

/// Returns the level of a stored section at the fraction `share` of the sample rate, dB.
fn stored_level_db(section: &Biquad, share: f64) -> f64 {
    level_db(section.numerator(), section.denominator(), share)
}

fn level_db(numerator: [f64; 3], [a1, a2]: [f64; 2], share: f64) -> f64 {
    let half = (0.5 * TAU * share).sin().powi(2);
    // |c0 + c1 z⁻¹ + c2 z⁻²|² on the unit circle, written with the squared sine of half the angle, because the direct
    // form suffers from cancellation at low frequencies.
    let square = |[c0, c1, c2]: [f64; 3]| {
        let sum = c0 + c1 + c2;
        sum * sum - 4.0 * (c0 * c1 + 4.0 * c0 * c2 + c1 * c2) * half + 16.0 * c0 * c2 * half * half
    };
    10.0 * (square(numerator) / square([1.0, a1, a2])).log10()
}

fn within(key: &'static str, value: f64, [low, high]: [f64; 2], unit: &str) -> Result<(), Fault> {
    // A NaN is in no range.
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let problem = format!("is {value} {unit}; it must be finite and {low} to {high}");
    Err(Fault::new(key, problem.replace("  ", " ").replace(" ;", ";")))
}
