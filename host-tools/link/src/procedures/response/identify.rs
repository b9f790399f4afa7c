//! Identification of an actuator: its response at three levels, approached from a very small level, and its faults.

use model_format::link::{MAX_PROBE_M_S2, ProbeThrough, Setting, Settings};
use serde::Serialize;
use stylus_app::safety::Config;
use stylus_dsp::equaliser::CALIBRATION_GAIN_DB;
use stylus_dsp::response::{Bandwidths, Fit, Line, MeasuredResponse, Multisine, PERIOD, Resonance, STEP_HZ, Spectra};

use super::bench::{Played, Probe, ProbedStylus, usable};
use super::{Fault, Result, Verdict};
use crate::link::capture::Calibration;

/// Band that has to be flat, Hz.
pub const BAND_HZ: [f64; 2] = [30.0, 800.0];

/// Fraction of the largest voltage that a probe uses.
const SHARE_OF_PEAK: f64 = 0.9;

/// Largest RMS of a probe, as a fraction of the RMS at the power limit. The thermal limiter does not act on it, because
/// it begins at three quarters of that power as a mean over the coil's time constant.
pub(super) const SHARE_OF_RMS: f64 = 0.6;

/// Largest RMS of the probe at the highest level, as a fraction of the RMS at the power limit. That level lasts for
/// only two seconds, and shows clipping and knocking.
const SHARE_OF_RMS_AT_TOP: f64 = 1.2;

/// Largest peak at the tip, as a fraction of half the converter's range.
const SHARE_OF_RANGE: f64 = 0.45;

/// First peak, as a fraction of the largest peak.
const FIRST: f64 = 1.0 / 64.0;

/// Number of periods of a measurement at rest, and on the way up. Each of the three levels is a fraction of the highest
/// level and a number of periods, from the lowest level on.
const REST: usize = 4;
const UPWARDS: usize = 2;
const LEVELS: [(f64, usize); 3] = [(0.25, 8), (0.5, 16), (1.0, 2)];

/// Index in [`LEVELS`] of the level whose response is used. It is the loudest level that can last.
const MEASURED: usize = 1;

/// Least noise of an axis that works, as a fraction of the noise of the noisiest axis.
const LEAST_NOISE: f64 = 0.1;

/// Thresholds of hum: its amplitude at rest, m/s², and the ratio to the median amplitude in the band of hum.
const HUM: (f64, f64) = (0.04, 8.0);

/// Band in which hum is searched for, Hz.
const HUM_HZ: [f64; 2] = [40.0, 420.0];

/// Least ratio of the lines' power to the power of the noise in them at which something moves.
pub(super) const MOVES: f64 = 4.0;

/// Ratio of the lines' power to the power of the noise from which on distortion can be judged.
const CLEAR: f64 = 300.0;

/// Least fraction of the lines in the band that must stand out enough from the noise to be trusted.
const TRUSTED: f64 = 0.9;

/// Noise at rest, as a fraction of the largest peak, that can hide all motion.
const NOISY: f64 = 0.1;

/// Distortion on the way up from which on the level is not raised further.
const TOO_BENT: f64 = 0.2;

/// Bounds for a linear actuator: distortion, change of the gain in dB, and relative shift of the resonance from the
/// lowest to the highest level.
const BENT: (f64, f64, f64) = (0.03, 0.4, 0.025);

/// Relative deviation of the fitted resonance at the highest level above which the fault is knocking. Below it, the
/// model still explains the motion, as a resonance that stiffens.
const ROUGH: f64 = 0.02;

/// Choices of a calibration.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Bandwidth of the accelerometer's axes.
    pub bandwidths: Bandwidths,
    /// Largest gain of the equaliser relative to the response's mean, dB.
    pub max_gain_db: f64,
    /// Sine at the tip that coil and limits must sustain at every corrected frequency, m/s² RMS.
    pub level_m_s2: f64,
    /// True if a reversed response is accepted, and inverted by the equaliser.
    pub invert: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            bandwidths: Bandwidths::default(),
            max_gain_db: CALIBRATION_GAIN_DB,
            level_m_s2: 1.0,
            invert: false,
        }
    }
}

/// The findings at one level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Peak at the pin, V.
    pub volts: f64,
    /// Mean level from 100 to 800 Hz, dB relative to 1 m/s² per V; none if the noise hides it.
    pub gain_db: Option<f64>,
    /// Resonance.
    pub resonance: Option<Resonance>,
    /// Distortion of even order, relative to what was asked for.
    pub even: f64,
    /// Distortion of odd order, relative to what was asked for.
    pub odd: f64,
    /// Noise of one period, relative to what was asked for. If it grows with the level, something knocks.
    pub restless: f64,
}

/// An actuator without a fault.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Identified {
    /// Noise of each axis at rest, m/s² RMS.
    pub rest_m_s2: [f64; 3],
    /// The levels.
    pub levels: [Level; 3],
    /// Response at the middle level.
    pub measured: MeasuredResponse,
    /// The model that was fitted to the response.
    pub fit: Fit,
}

/// Bounds of a probe.
pub(super) struct Bounds {
    peak_volts: f64,
    rms_volts: f64,
    volts_per_sample: f64,
    pub(super) output_gain: f64,
    pub(super) range_m_s2: f64,
    /// Axes that are wired: those whose scale is not the least that the setting may have.
    wired: [bool; 3],
}

/// Scales of the accelerometer's axes.
const SCALES: [Setting; 3] = [
    Setting::AccelerationPerVoltX,
    Setting::AccelerationPerVoltY,
    Setting::AccelerationPerVoltZ,
];

impl Bounds {
    pub(super) fn of(settings: &Settings) -> Self {
        let limits = Config::new(settings, 1.0).output_limits(settings);
        let gain = f64::from(settings.get(Setting::OutputGain));
        let scales = Calibration::new(settings, None).m_s2_per_code;
        let wired = SCALES.map(|scale| settings.get(scale).abs() > scale.spec().least_magnitude);
        let narrowest = scales
            .iter()
            .zip(wired)
            .filter(|(_, is_wired)| *is_wired)
            .map(|(scale, _)| scale.abs())
            .fold(f64::INFINITY, f64::min);
        Self {
            peak_volts: (SHARE_OF_PEAK * f64::from(limits.peak_volt))
                // The device refuses a probe above this peak.
                .min(f64::from(MAX_PROBE_M_S2) * gain),
            rms_volts: f64::from(limits.mean_square).sqrt(),
            // Between two samples the interpolated slope is up to 1.5 times the slope of the samples.
            // At 5 kHz a sample takes 0.2 ms, and the setting is in V/ms.
            volts_per_sample: f64::from(settings.get(Setting::SlewLimit)) * 0.2 / 1.5,
            output_gain: gain,
            range_m_s2: SHARE_OF_RANGE * narrowest * 32_768.0,
            wired,
        }
    }

    /// Largest RMS voltage of a sine at the pin, V.
    pub(super) fn sine_volts(&self) -> f64 {
        (self.peak_volts / SHARE_OF_PEAK / std::f64::consts::SQRT_2).min(self.rms_volts)
    }

    /// Returns the largest peak, V, of a waveform whose samples at the pin are `samples` times this peak.
    pub(super) fn volts(&self, samples: &[f64], share_of_rms: f64) -> f64 {
        let peak = samples.iter().fold(0.0f64, |peak, sample| peak.max(sample.abs()));
        let square: f64 = samples.iter().map(|sample| sample * sample).sum();
        let rms = (square / samples.len() as f64).sqrt();
        let around = samples.iter().cycle().skip(1);
        let slope = samples
            .iter()
            .zip(around)
            .fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        (self.peak_volts / peak)
            .min(share_of_rms * self.rms_volts / rms)
            .min(self.volts_per_sample / slope)
    }
}

/// The findings at a level, with the response and the model that was fitted to it.
type Found = (Level, MeasuredResponse, Option<Fit>);

/// The excitation on a bench.
struct Probing<'a, B> {
    bench: &'a mut B,
    bounds: &'a Bounds,
    wave: Multisine,
    bandwidths: &'a Bandwidths,
    heard: &'a mut dyn FnMut(&str),
}

impl<B: ProbedStylus> Probing<'_, B> {
    /// Plays `periods` with a peak of `volts`. The measurement is `None` if nothing moves.
    fn play(&mut self, volts: f64, periods: usize) -> Result<(Played, Option<MeasuredResponse>)> {
        (self.heard)(&format!("{:.1} mV of peak", 1e3 * volts));
        let probe = Probe {
            codes: &self.wave.codes(),
            peak_m_s2: volts / self.bounds.output_gain,
            periods,
            through: ProbeThrough::Nothing,
        };
        let played = usable(self.bench.play(&probe)?, volts)?;
        let spectra = Spectra::of(&played.axes);
        let measured = MeasuredResponse::of(&spectra, &self.wave, volts, self.bandwidths);
        Ok((played, measured.filter(|measured| measured.over_noise > MOVES)))
    }

    /// Finds the peak of the highest level, V. Raises the peak until the response is distorted or a bound is reached.
    fn top(&mut self) -> Result<f64> {
        let most = self.bounds.volts(&self.wave.samples, SHARE_OF_RMS_AT_TOP);
        let mut top = most * FIRST;
        loop {
            let (played, measured) = self.play(top, UPWARDS)?;
            let bent = measured.as_ref().is_some_and(|measured| {
                // In a weak motion, noise in the empty lines looks like distortion.
                measured.over_noise > CLEAR && measured.even.max(measured.odd) > TOO_BENT
            });
            let peak = played.axes.iter().map(|axis| swing(axis)).fold(0.0, f64::max);
            let next = (2.0 * top)
                // The tip follows the voltage in proportion, so this is the peak at which it would reach its bound.
                .min(top * self.bounds.range_m_s2 / peak)
                .min(most);
            // A step of less than 5 % would cost a measurement and show nothing new.
            if bent || next < 1.05 * top {
                return Ok(top);
            }
            top = next;
        }
    }

    /// Measures at each of [`LEVELS`], as fractions of `top`; none where nothing moves.
    fn levels(&mut self, top: f64) -> Result<Vec<Option<Found>>> {
        let at = |(share, periods)| {
            let volts = share * top;
            let measured = self.play(volts, periods)?.1;
            Ok(measured.map(|measured| {
                let fit = Fit::of(&measured.lines);
                (level(volts, &measured, fit.as_ref(), periods), measured, fit)
            }))
        };
        LEVELS.into_iter().map(at).collect()
    }
}

/// Identifies an actuator, and reports each step to `heard`.
pub fn identify(bench: &mut impl ProbedStylus, options: &Options, heard: &mut dyn FnMut(&str)) -> Result<Identified> {
    let bounds = Bounds::of(bench.settings());
    heard("at rest");
    let rest_m_s2 = rest(bench, &bounds)?;
    let mut probing = Probing {
        bench,
        bounds: &bounds,
        wave: excitation(),
        bandwidths: &options.bandwidths,
        heard,
    };
    let top = probing.top()?;
    let found = probing.levels(top)?;
    let Some((_, measured, fit)) = found[MEASURED].clone() else {
        let loudest = rest_m_s2.into_iter().fold(0.0, f64::max);
        let seen = format!("nothing moves at {top:.3} V of peak");
        let verdict = if loudest > NOISY * bounds.range_m_s2 {
            Verdict::Noisy
        } else {
            Verdict::NothingMoves
        };
        return Err(verdict.failure(seen));
    };
    let levels: Vec<Level> = found.iter().flatten().map(|(level, ..)| *level).collect();
    // Knocking is noise, too, so it is judged before the lines are found too noisy.
    if let Some(fault) = bent(&levels) {
        return Err(fault.into());
    }
    let share = trusted(&measured);
    let (Ok(levels), Some(fit), true) = (<[Level; 3]>::try_from(levels), fit, share > TRUSTED) else {
        let share = 100.0 * share;
        let seen = format!("only {share:.0} % of the response from 30 to 800 Hz can be trusted at {top:.3} V of peak");
        return Err(Verdict::Noisy.failure(seen));
    };
    if !fit.is_positive && !options.invert {
        let seen = "a positive voltage moves the tip against the accelerometer's positive axis";
        return Err(Verdict::Reversed.failure(seen));
    }
    Ok(Identified {
        rest_m_s2,
        levels,
        measured,
        fit,
    })
}

/// Returns the excitation. It is weaker at high frequencies, so that it reaches the hard limit before the slew limit.
pub(super) fn excitation() -> Multisine {
    Multisine::new(1, |hz| 1.0 / (hz / 250.0).hypot(1.0))
}

/// Largest distance from the mean.
fn swing(axis: &[f64]) -> f64 {
    let mean = axis.iter().sum::<f64>() / axis.len().max(1) as f64;
    axis.iter().fold(0.0, |most, value| most.max((value - mean).abs()))
}

/// Noise of each axis while the output is driven and silent, m/s² RMS.
fn rest(bench: &mut impl ProbedStylus, bounds: &Bounds) -> Result<[f64; 3]> {
    let probe = Probe {
        codes: &[0; PERIOD],
        // All samples are 0, so the peak plays no role. The device refuses a peak of 0.
        peak_m_s2: 1e-3 / bounds.output_gain.max(1e-3),
        periods: REST,
        through: ProbeThrough::Nothing,
    };
    let played = usable(bench.play(&probe)?, 0.0)?;
    // Only differences between periods count. A hum may show on all axes, so it does not prove that an axis works.
    let spectra = Spectra::of(&played.axes);
    let deviations =
        // A line of amplitude a has the power a²/2. Bin 0 is the mean, which may drift.
        [0, 1, 2].map(|axis| (0.5 * spectra.variance[axis][1..].iter().sum::<f64>()).sqrt());
    let largest = deviations.into_iter().fold(0.0, f64::max);
    let axes = ['X', 'Y', 'Z'].into_iter().zip(deviations).zip(bounds.wired);
    for ((axis, deviation), is_wired) in axes {
        if is_wired && deviation <= LEAST_NOISE * largest {
            return Err(Verdict::DeadAxis.failure(format!("axis {axis} shows nothing, not even noise")));
        }
    }
    let bins = HUM_HZ.map(|hz| (hz / STEP_HZ) as usize);
    let mut amplitudes: Vec<f64> = (bins[0]..=bins[1])
        .map(|bin| spectra.mean.iter().map(|axis| axis[bin].norm_sqr()).sum::<f64>().sqrt())
        .collect();
    let (loudest, m_s2) = amplitudes
        .iter()
        .copied()
        .enumerate()
        .fold((0, 0.0), |best, now| if now.1 > best.1 { now } else { best });
    amplitudes.sort_by(f64::total_cmp);
    // The median is the noise between the few lines of a hum.
    if m_s2 > HUM.0 && m_s2 > HUM.1 * amplitudes[amplitudes.len() / 2] {
        let hz = (bins[0] + loudest) as f64 * STEP_HZ;
        let seen = format!("{m_s2:.2} m/s² at {hz:.1} Hz while nothing is played");
        return Err(Verdict::Hum.failure(seen));
    }
    Ok(deviations)
}

fn level(volts: f64, measured: &MeasuredResponse, fit: Option<&Fit>, periods: usize) -> Level {
    let within = |line: &&Line| (100.0..BAND_HZ[1]).contains(&line.hz);
    let lines: Vec<&Line> = measured.lines.iter().filter(within).collect();
    let is_clear = lines.iter().filter(|line| line.is_trusted()).count() as f64 > TRUSTED * lines.len() as f64;
    let mean = lines.iter().map(|line| line.level_db).sum::<f64>() / lines.len() as f64;
    Level {
        volts,
        gain_db: is_clear.then_some(mean),
        resonance: fit.map(|fit| fit.resonance),
        even: measured.even,
        odd: measured.odd,
        // `over_noise` compares with the noise of the mean over all periods, whose power is that of one period divided
        // by their number.
        restless: (periods as f64 / measured.over_noise).sqrt(),
    }
}

/// Fraction of the lines in the band that can be trusted.
pub(super) fn trusted(measured: &MeasuredResponse) -> f64 {
    let within = |line: &&Line| (BAND_HZ[0]..=BAND_HZ[1]).contains(&line.hz);
    let (all, trusted) = measured
        .lines
        .iter()
        .filter(within)
        .fold((0, 0), |(all, trusted), line| {
            (all + 1, trusted + u32::from(line.is_trusted()))
        });
    f64::from(trusted) / f64::from(all.max(1))
}

/// Returns the fault of an actuator that, according to the levels, is not linear.
fn bent(levels: &[Level]) -> Option<Fault> {
    let (first, last) = (levels.first()?, levels.last()?);
    // Noise that is as strong at the lowest level was not caused by the motion.
    let distortion = last.even.max(last.odd).max(last.restless - first.restless);
    // A change that noise hides at either level counts as none.
    let loss_db = first
        .gain_db
        .zip(last.gain_db)
        .map_or(0.0, |(first, last)| first - last);
    let (distorted, changed_db, moved) = BENT;
    let resonances = first
        .resonance
        .zip(last.resonance)
        .map(|(first, last)| [first.hz, last.hz]);
    let moves = resonances.map_or(0.0, |[low, high]| (high / low - 1.0).abs());
    if distortion < distorted && loss_db.abs() < changed_db && moves < moved {
        return None;
    }
    let volts = last.volts;
    let is_rough = last
        .resonance
        .is_none_or(|resonance| resonance.hz_deviation > ROUGH * resonance.hz);
    Some(match resonances {
        // A clipped signal is distorted, too, so the loss of gain is asked first.
        _ if loss_db > changed_db => Verdict::Clipped.seen(format!(
            "the gain falls by {loss_db:.1} dB from 100 to 800 Hz towards {volts:.3} V of peak"
        )),
        Some([low_hz, high_hz]) if moves > moved && !is_rough => Verdict::MovingResonance.seen(format!(
            "the resonance moves from {low_hz:.1} to {high_hz:.1} Hz with the level"
        )),
        _ => Verdict::Loose.seen(format!(
            "{:.0} % of what moves at {volts:.3} V of peak was not asked for, and came with the level",
            100.0 * distortion
        )),
    })
}
