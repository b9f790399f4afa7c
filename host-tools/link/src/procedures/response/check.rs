//! Check of an actuator against its stored response, within two seconds.

use model_format::link::{ProbeThrough, Response};
use serde::Serialize;
use stylus_dsp::response::{Bandwidths, Fit, MeasuredResponse, Spectra};

use super::Result;
use super::bench::{Probe, ProbedStylus, usable};
use super::identify::{Bounds, MOVES, SHARE_OF_RMS, excitation};

/// Periods of the probe. With one period to settle and a soft start of at most 0.4 s, it takes two seconds.
const PERIODS: usize = 3;

/// Peak of the probe, as a fraction of the largest peak that is allowed.
const SHARE: f64 = 0.25;

/// Smallest changes that count: of the gain, dB; of the resonance, relative; of the axis, degrees; and of a
/// third-octave band apart from the gain, dB.
const GAIN_DB: f64 = 1.0;
const RESONANCE: f64 = 0.06;
const AXIS_DEG: f64 = 10.0;
const BAND_DB: f64 = 3.0;

/// Comparison of the present response with the stored one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checked {
    /// True if nothing has changed.
    pub ok: bool,
    /// Descriptions of the changes; empty if nothing has changed.
    pub moved: Vec<String>,
    /// Change of the gain, dB; NaN if no band is trusted now and in the stored response, and -∞ if nothing moves.
    pub gain_db: f64,
    /// Present resonance, Hz; none if it is not found.
    pub resonance_hz: Option<f64>,
    /// Angle between the present and the stored direction of motion, degrees.
    pub axis_deg: f64,
    /// Time for which the device has played, s.
    pub seconds: f64,
}

impl Checked {
    /// Describes the changes that count. `then_hz` is the stored resonance. `worst_band` is the third-octave band that
    /// has changed most apart from the gain, with the change in dB.
    fn changes(&self, then_hz: f64, worst_band: Option<(usize, f64)>) -> Vec<String> {
        let (gain_db, axis_deg) = (self.gain_db, self.axis_deg);
        let mut moved = Vec::new();
        // Without a band in common the gain is not known, which must not pass as unchanged.
        if gain_db.is_nan() || gain_db.abs() >= GAIN_DB {
            moved.push(format!("the gain has changed by {gain_db:+.1} dB"));
        }
        match self.resonance_hz {
            Some(hz) if (hz / then_hz - 1.0).abs() < RESONANCE => {}
            Some(hz) => moved.push(format!("the resonance has moved from {then_hz:.1} to {hz:.1} Hz")),
            None => moved.push(format!("the resonance of {then_hz:.1} Hz is not found")),
        }
        if axis_deg > AXIS_DEG {
            moved.push(format!("the direction of motion has turned by {axis_deg:.0} degrees"));
        }
        // A moved resonance changes bands, too. A band is named only if nothing else explains it.
        if let Some((band, off_db)) = worst_band.filter(|worst| worst.1.abs() > BAND_DB && moved.is_empty()) {
            let hz = stylus_dsp::response::band_centre_hz(band);
            moved.push(format!(
                "the level around {hz:.0} Hz has changed by {off_db:+.1} dB beside the others"
            ));
        }
        moved
    }
}

/// Compares an actuator with its `stored` response.
pub fn check(bench: &mut impl ProbedStylus, stored: &Response, bandwidths: &Bandwidths) -> Result<Checked> {
    let bounds = Bounds::of(bench.settings());
    let wave = excitation();
    let volts = SHARE * bounds.volts(&wave.samples, SHARE_OF_RMS);
    let probe = Probe {
        codes: &wave.codes(),
        peak_m_s2: volts / bounds.output_gain,
        periods: PERIODS,
        through: ProbeThrough::Nothing,
    };
    let played = usable(bench.play(&probe)?, volts)?;
    let measured = MeasuredResponse::of(&Spectra::of(&played.axes), &wave, volts, bandwidths);
    let Some(measured) = measured.filter(|measured| measured.over_noise > MOVES) else {
        return Ok(Checked {
            ok: false,
            moved: vec!["nothing moves: check coil, wire, amplifier and accelerometer".to_owned()],
            gain_db: f64::NEG_INFINITY,
            resonance_hz: None,
            axis_deg: 0.0,
            seconds: bench.seconds(),
        });
    };
    let bands: Vec<(usize, f64)> = (measured.bands().iter().zip(stored.bands_centi_db).enumerate())
        .filter(|&(band, (now, _))| now.trusted && stored.trusted_bands >> band & 1 == 1)
        .map(|(band, (now, then))| (band, now.level_db - f64::from(then) / 100.0))
        .collect();
    let mut changes: Vec<f64> = bands.iter().map(|&(_, change)| change).collect();
    changes.sort_by(f64::total_cmp);
    // The median, because a resonance that has moved changes some of the bands by much more than the gain.
    let gain_db = changes.get(changes.len() / 2).copied().unwrap_or(f64::NAN);
    let worst = bands
        .iter()
        .map(|&(band, change)| (band, change - gain_db))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let fit = Fit::of(&measured.lines);
    let resonance_hz = fit.map(|fit| fit.resonance.hz);
    let cosine: f64 = measured
        .axis
        .iter()
        .zip(stored.axis)
        .map(|(now, then)| now * f64::from(then))
        .sum();
    // Both vectors have length 1 except for rounding, which could lead out of the domain of the arc cosine.
    let axis_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
    let mut checked = Checked {
        ok: true,
        moved: Vec::new(),
        gain_db,
        resonance_hz,
        axis_deg,
        seconds: bench.seconds(),
    };
    checked.moved = checked.changes(f64::from(stored.resonance_hz), worst);
    checked.ok = checked.moved.is_empty();
    Ok(checked)
}
