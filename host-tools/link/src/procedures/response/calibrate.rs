//! A whole calibration, from the noise at rest to the proof.

use model_format::PlayRate;
use model_format::link::{ProbeThrough, Response, Sections, Setting};
use stylus_dsp::equaliser::{cascade_db, filtered};
use stylus_dsp::response::{MeasuredResponse, Multisine, PERIOD, Spectra, db, ratio};

use super::bench::{Probe, ProbedStylus, usable};
pub use super::design::Flatness;
use super::design::{Design, design, response};
use super::identify::{BAND_HZ, Bounds, Identified, Options, SHARE_OF_RMS, identify};
use super::{Result, Verdict};

/// Periods of the proof.
const PROOF: usize = 6;

/// Largest deviation that passes, dB: RMS, worst, and mean level.
const PASSES: [f64; 3] = [1.0, 2.0, 0.5];

/// A calibration whose proof has passed.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Calibrated {
    /// The actuator.
    pub identified: Identified,
    /// The response that is proposed, and is to be stored.
    pub response: Response,
    /// Equaliser and level.
    pub design: Design,
    /// Response without the equaliser, at the output gain that was set, and its flatness.
    pub before: (Vec<(f64, f64)>, Flatness),
    /// Response through the equaliser, dB relative to what was asked for, and its flatness.
    pub after: (Vec<(f64, f64)>, Flatness),
    /// Time for which the device has played, s.
    pub seconds: f64,
}

/// Calibrates an actuator: identifies it, designs the equaliser, proposes the response, proves it by a measurement, and
/// proposes it again with the proof's figures. `measured_at` is the time, s since 1970.
///
/// # Errors
/// A fault of the actuator, a proof that does not pass, a lost link or an interrupt. Nothing is stored in any case.
pub fn calibrate(
    bench: &mut impl ProbedStylus,
    options: &Options,
    measured_at: u64,
    heard: &mut dyn FnMut(&str),
) -> Result<Calibrated> {
    let identified = identify(bench, options, heard)?;
    let bounds = Bounds::of(bench.settings());
    let design = design(&identified.measured, &bounds, options, identified.fit.is_positive)?;
    // The device plays the proof through the proposal, and stores only what was proposed.
    let mut response = record(bench, &identified, &design, measured_at)?;
    bench.propose(&response)?;
    let before = {
        let curve = self::response(&identified.measured)?;
        let gain_db = db(bounds.output_gain);
        let points = curve
            .points()
            .iter()
            .map(|&(hz, level)| (hz, level + gain_db))
            .collect();
        (points, Flatness::of(design.band_hz, |hz| curve.level_db(hz) + gain_db))
    };
    heard("through the equaliser");
    let after = prove(bench, &bounds, &design, options)?;
    let [rms, worst, level] = PASSES;
    let Flatness {
        level_db,
        rms_db,
        worst_db,
    } = after.1;
    // A NaN does not pass.
    if !(rms_db <= rms && worst_db <= worst && level_db.abs() <= level) {
        return Err(Verdict::NotFlat.failure(format!(
            "through its equaliser the tip is off by {rms_db:.2} dB RMS and {worst_db:.2} dB at worst, its level by \
             {level_db:+.2} dB"
        )));
    }
    (response.rms_db, response.worst_db) = (rms_db as f32, worst_db as f32);
    bench.propose(&response)?;
    Ok(Calibrated {
        seconds: bench.seconds(),
        identified,
        response,
        design,
        before,
        after,
    })
}

/// Returns the response in the form that the device stores, without the proof's figures.
fn record(bench: &impl ProbedStylus, identified: &Identified, design: &Design, measured_at: u64) -> Result<Response> {
    let (settings, fit) = (bench.settings(), &identified.fit);
    let bands = identified.measured.bands();
    let sections = |of: usize| Sections::new(&design.sections[of]).unwrap_or(Sections::NONE);
    let trusted = bands.iter().enumerate().filter(|(_, band)| band.trusted);
    let curve = response(&identified.measured)?;
    Ok(Response {
        sections_5khz: sections(0),
        sections_10khz: sections(1),
        measured_at,
        worst_db: 0.0,
        rms_db: 0.0,
        resonance_hz: fit.resonance.hz as f32,
        damping_ratio: fit.resonance.damping_ratio as f32,
        delay_us: (1e6 * fit.delay_s) as f32,
        axis: identified.measured.axis.map(|part| part as f32),
        level_m_s2_per_volt: ratio(Flatness::of(BAND_HZ, |hz| curve.level_db(hz)).level_db) as f32,
        bands_centi_db: bands.map(|band| (100.0 * band.level_db).round() as i16),
        trusted_bands: trusted.fold(0, |bits, (band, _)| bits | 1 << band),
        output_gain: design.output_gain as f32,
        amplifier_gain: settings.get(Setting::AmplifierGain),
        coil_resistance: settings.get(Setting::CoilResistance),
        hard_limit: settings.get(Setting::HardLimit),
    })
}

/// Measures the response through the proposed equaliser, and its flatness.
fn prove(
    bench: &mut impl ProbedStylus,
    bounds: &Bounds,
    design: &Design,
    options: &Options,
) -> Result<(Vec<(f64, f64)>, Flatness)> {
    let wave = Multisine::new(2, |_| 1.0);
    // The equalised waveform is steady in its third period.
    let played = filtered(&design.sections[0], &wave.samples.repeat(3));
    let pin: Vec<f64> = played[2 * PERIOD..]
        .iter()
        .map(|sample| sample * design.output_gain)
        .collect();
    // The samples at the pin are in V per m/s², so the bound of voltage gives an acceleration. The tip follows it, once
    // it is equalised.
    let peak_m_s2 = bounds.volts(&pin, SHARE_OF_RMS).min(bounds.range_m_s2);
    let probe = Probe {
        codes: &wave.codes(),
        peak_m_s2,
        periods: PROOF,
        through: ProbeThrough::Proposed,
    };
    let volts = peak_m_s2 * design.output_gain;
    let played = usable(bench.play(&probe)?, volts)?;
    let measured = MeasuredResponse::of(&Spectra::of(&played.axes), &wave, peak_m_s2, &options.bandwidths)
        .ok_or_else(|| Verdict::NothingMoves.failure(format!("nothing moves at {volts:.3} V of peak")))?;
    let curve = response(&measured)?;
    let at_ten = |hz: f64| {
        let of = |at: usize, rate: PlayRate| cascade_db(&design.sections[at], rate.hz().into(), hz);
        of(1, PlayRate::Hz10000) - of(0, PlayRate::Hz5000)
    };
    let five = Flatness::of(design.band_hz, |hz| curve.level_db(hz));
    let ten = Flatness::of(design.band_hz, |hz| curve.level_db(hz) + at_ten(hz));
    // Only the equaliser for 5 kHz is played. The one for 10 kHz differs from it by its design, which is known. The
    // worse of the two must pass.
    let worse = if ten.worst_db > five.worst_db { ten } else { five };
    Ok((curve.points().to_vec(), worse))
}
