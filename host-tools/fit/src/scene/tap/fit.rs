//! Least-squares fit of a decaying sine.

use std::f64::consts::TAU;

use stylus_dsp::fourier;
use stylus_dsp::sums::upper_median;

/// Time constants at which the search starts, s.
const DECAYS_S: [f64; 12] = [
    0.0006, 0.0012, 0.0025, 0.004, 0.007, 0.012, 0.02, 0.035, 0.06, 0.12, 0.3, 0.8,
];

/// Frequencies at which the search starts, as multiples of the loudest line's frequency.
const AROUND: [f64; 9] = [0.7, 0.8, 0.88, 0.95, 1.0, 1.05, 1.12, 1.25, 1.4];

/// Iterations of Gauss-Newton from the best starting point.
const ROUNDS: usize = 40;

/// A · exp(-t/τ) · sin(2πft + φ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// f, Hz.
    pub frequency_hz: f64,
    /// τ, s.
    pub decay_s: f64,
    /// A, in the signal's unit.
    pub amplitude: f64,
    /// φ, rad.
    pub phase_rad: f64,
    /// Fraction of the signal's power that is left as residual.
    pub residual: f64,
}

/// Fits a decaying sine to `signal` by least squares.
///
/// For a given frequency and decay the problem is linear in amplitude and phase, which are eliminated (variable
/// projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). Frequency and decay are searched first on a grid
/// around the loudest line of the spectrum, then by damped Gauss-Newton.
///
/// A signal that is silent or shorter than 8 samples gives an amplitude of 0 and a residual of 1.
pub fn fit(signal: &[f64], rate_hz: f64) -> Ringing {
    let power: f64 = signal.iter().map(|x| x * x).sum();
    let silent = Ringing {
        frequency_hz: 0.0,
        decay_s: 0.0,
        amplitude: 0.0,
        phase_rad: 0.0,
        residual: 1.0,
    };
    if signal.len() < 8 || power <= 0.0 {
        return silent;
    }
    let line_hz = loudest_line_hz(signal, rate_hz);
    let mut best: Option<Projection> = None;
    for decay_s in DECAYS_S {
        for around in AROUND {
            let tried = Projection::new(signal, rate_hz, around * line_hz, decay_s);
            if best.as_ref().is_none_or(|best| tried.left < best.left) {
                best = Some(tried);
            }
        }
    }
    let Some(start) = best else { return silent };
    let found = refine(signal, rate_hz, start);
    Ringing {
        frequency_hz: found.frequency_hz,
        decay_s: found.decay_s,
        amplitude: found.cosine.hypot(found.sine),
        phase_rad: found.cosine.atan2(found.sine),
        residual: found.left / power,
    }
}

/// The best amplitudes for a frequency and a decay, with the residual and its power.
struct Projection {
    frequency_hz: f64,
    decay_s: f64,
    cosine: f64,
    sine: f64,
    residual: Vec<f64>,
    left: f64,
}

impl Projection {
    fn new(signal: &[f64], rate_hz: f64, frequency_hz: f64, decay_s: f64) -> Self {
        let wave = |n: usize| {
            let time_s = n as f64 / rate_hz;
            let (sin, cos) = (TAU * frequency_hz * time_s).sin_cos();
            let envelope = (-time_s / decay_s).exp();
            (envelope * cos, envelope * sin)
        };
        let (mut cc, mut cs, mut ss, mut cx, mut sx) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let waves: Vec<(f64, f64)> = (0..signal.len()).map(wave).collect();
        for (&(c, s), x) in waves.iter().zip(signal) {
            cc += c * c;
            cs += c * s;
            ss += s * s;
            cx += c * x;
            sx += s * x;
        }
        let determinant = cc * ss - cs * cs;
        // If both waves are linearly dependent, only the first is used.
        let (cosine, sine) = if determinant > 1e-12 * cc * ss {
            ((ss * cx - cs * sx) / determinant, (cc * sx - cs * cx) / determinant)
        } else {
            (cx / cc, 0.0)
        };
        let residual: Vec<f64> = waves
            .iter()
            .zip(signal)
            .map(|(&(c, s), x)| x - cosine * c - sine * s)
            .collect();
        let left = residual.iter().map(|r| r * r).sum();
        Self {
            frequency_hz,
            decay_s,
            cosine,
            sine,
            residual,
            left,
        }
    }
}

/// Refines `best` by damped Gauss-Newton until no step lowers the residual further.
fn refine(signal: &[f64], rate_hz: f64, mut best: Projection) -> Projection {
    const STEP: f64 = 1e-5;
    let at = |ln_frequency: f64, ln_decay: f64| {
        let frequency_hz = ln_frequency.exp().clamp(1.0, 0.5 * rate_hz);
        let decay_s = ln_decay.exp().clamp(1e-4, 10.0);
        Projection::new(signal, rate_hz, frequency_hz, decay_s)
    };
    let mut damping = 1e-3;
    for _ in 0..ROUNDS {
        // In logarithms steps are relative, and neither value becomes negative.
        let (f, d) = (best.frequency_hz.ln(), best.decay_s.ln());
        let by_f = at(f + STEP, d);
        let by_d = at(f, d + STEP);
        // The normal equations in two unknowns (the amplitudes were eliminated), in closed form.
        let (mut ff, mut fd, mut dd, mut fr, mut dr) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (n, r) in best.residual.iter().enumerate() {
            let (jf, jd) = ((by_f.residual[n] - r) / STEP, (by_d.residual[n] - r) / STEP);
            ff += jf * jf;
            fd += jf * jd;
            dd += jd * jd;
            fr += jf * r;
            dr += jd * r;
        }
        // Damping in proportion to the diagonal does not depend on the scale of the unknowns (Marquardt, 1963).
        let (a, b) = (ff * (1.0 + damping), dd * (1.0 + damping));
        let determinant = a * b - fd * fd;
        if determinant <= 0.0 || determinant.is_nan() {
            break;
        }
        let step_f = -(b * fr - fd * dr) / determinant;
        let step_d = -(a * dr - fd * fr) / determinant;
        // Far from the minimum the linearisation does not hold, so long steps are cut short.
        let tried = at(f + step_f.clamp(-0.5, 0.5), d + step_d.clamp(-1.0, 1.0));
        if tried.left < best.left {
            let gained = 1.0 - tried.left / best.left;
            best = tried;
            damping = (damping / 4.0).max(1e-9);
            if gained < 1e-12 {
                break;
            }
        } else {
            damping *= 4.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    best
}

/// Returns the frequency of the loudest line of the spectrum, Hz, on a grid at least four times finer than the signal's
/// own resolution.
fn loudest_line_hz(signal: &[f64], rate_hz: f64) -> f64 {
    let len = (4 * signal.len()).next_power_of_two();
    let mut padded = signal.to_vec();
    padded.resize(len, 0.0);
    let spectrum = fourier::forward(&mut padded);
    // An offset, in the bin at 0 Hz, is no line.
    (1..spectrum.len())
        .max_by(|&a, &b| spectrum[a].norm_sqr().total_cmp(&spectrum[b].norm_sqr()))
        .unwrap_or(1) as f64
        * rate_hz
        / len as f64
}

/// Least ratio of an impact to the noise's RMS.
const ABOVE_NOISE: f64 = 8.0;

/// Least magnitude of an impact, relative to the recording's loudest sample.
const SHARE_OF_LOUDEST: f64 = 0.1;

/// Magnitude up to which an impact has not begun, relative to the impact's loudest sample; at least three times the
/// noise's RMS.
const SHARE_AT_ONSET: f64 = 0.03;

/// Least quiet time before an impact, s.
const QUIET_S: f64 = 0.025;

/// Longest time from the onset of an impact to its loudest sample, s.
const RISE_S: f64 = 0.01;

/// Returns the index of the first sample of each impact in `samples`, ascending.
///
/// An impact is louder than the noise and follows a quiet time. The noise's RMS is estimated from the median magnitude,
/// which is 0.6745 of the RMS of Gaussian noise.
pub fn onsets(samples: &[f64], rate_hz: f64) -> Vec<usize> {
    let magnitudes: Vec<f64> = samples.iter().map(|x| x.abs()).collect();
    let loudest = magnitudes.iter().copied().fold(0.0, f64::max);
    if !(loudest > 0.0 && loudest.is_finite()) {
        return Vec::new();
    }
    let noise = upper_median(&magnitudes).unwrap_or(0.0) / 0.6745;
    let loud = (ABOVE_NOISE * noise).max(SHARE_OF_LOUDEST * loudest);
    let (quiet, rise) = ((QUIET_S * rate_hz) as usize, (RISE_S * rate_hz) as usize);
    let mut found = Vec::new();
    let mut last_loud: Option<usize> = None;
    for (at, sample) in samples.iter().enumerate() {
        if sample.abs() <= loud {
            continue;
        }
        if last_loud.is_none_or(|last| at - last > quiet) {
            let end = (at + rise).min(samples.len());
            let peak = samples[at..end].iter().fold(0.0f64, |peak, x| peak.max(x.abs()));
            let least = (3.0 * noise).max(SHARE_AT_ONSET * peak);
            // An onset is after the last loud sample of the impact before it, and at most the longest rise before its
            // own.
            let floor = last_loud.map_or(0, |last| last + 1).max(at.saturating_sub(rise));
            let before = (floor..at).rev().find(|&n| samples[n].abs() <= least);
            found.push(before.unwrap_or(at));
        }
        last_loud = Some(at);
    }
    found
}
