//! The resonance and the delay that explain a response.
//!
//! The model describes a coil whose mass moves against a body held in a hand, driven by an amplifier that blocks steady
//! voltages, after the high-pass filter of the device itself:
//!
//! ```text
//! K s⁴ / ((s² + 2 ζ₁ ω₁ s + ω₁²) (s² + 2 ζ₂ ω₂ s + ω₂²)) · s² / ((s + ω₀) (s + ω₃)) · exp(-s τ)
//! ```
//! The second pair of poles is the resonance; the first pair is the stylus in the hand. Effects above the band, such as
//! the coil's inductance, become part of the delay. Levenberg-Marquardt fits the model to the logarithm of the
//! response, so that level and phase have the same weight at all levels.

use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector, SVector};

use super::measured::Line;
use crate::fourier::Complex;

/// Corner of the high-pass in the device's safety stages, Hz, through which every probe passes too.
const DC_BLOCKER_HZ: f64 = 2.0;

/// Initial value of the delay, ms: the delay of the device's interpolator and converters.
const START_MS: f64 = 0.45;

/// Initial values of the resonance, Hz; the fit starts from each.
const STARTS_HZ: [f64; 4] = [45.0, 80.0, 150.0, 300.0];

/// Lower bound of a line's standard deviation, nepers, because no actuator follows the model exactly.
const LEAST_DEVIATION: f64 = 0.003;

/// Iterations of Levenberg-Marquardt from each start.
const ROUNDS: usize = 60;

/// The gain in nepers; the logarithms of ω₁, ζ₁, ω₂, ζ₂ and ω₀; the delay in ms; and the phase at 1 kHz, rad, by which
/// the device's minimum-phase interpolator differs from a pure delay.
type Unknowns = SVector<f64, 8>;

/// A resonance.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Resonance {
    /// Undamped natural frequency, Hz.
    pub hz: f64,
    /// Standard deviation of the natural frequency, Hz, from the lines' deviations, or from the scatter about the model
    /// if it is larger.
    pub hz_deviation: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// The model that explains a response.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Fit {
    /// The resonance.
    pub resonance: Resonance,
    /// Delay, s.
    pub delay_s: f64,
    /// RMS of the residual, in units of the lines' standard deviations.
    pub error: f64,
    /// True if, above the resonance, a positive voltage accelerates the tip in the positive direction.
    pub is_positive: bool,
}

impl Fit {
    /// Fits the model to the trusted lines; returns `None` if they are fewer than 40.
    pub fn of(lines: &[Line]) -> Option<Self> {
        let lines: Vec<&Line> = lines.iter().filter(|line| line.is_trusted()).collect();
        if lines.len() < 40 {
            return None;
        }
        // Above all poles, the model's level is its gain.
        let top = lines[lines.len() - 1].value.norm().ln();
        let (is_positive, (error, mut unknowns, mut jacobian)) = STARTS_HZ
            .into_iter()
            .flat_map(|hz| [(hz, true), (hz, false)])
            .map(|(hz, is_positive)| {
                let [hand, own, passed] = [14.0, hz, 4.0].map(|hz| (TAU * hz).ln());
                let start = [top, hand, 0.3f64.ln(), own, 0.3f64.ln(), passed, START_MS, 0.0];
                (is_positive, refined(&lines, is_positive, Unknowns::from(start)))
            })
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
        if unknowns[1] > unknowns[3] {
            // The resonance is the pair of higher frequency.
            for at in [1, 2] {
                unknowns.swap_rows(at, at + 2);
                jacobian.swap_columns(at, at + 2);
            }
        }
        let mut square = jacobian.tr_mul(&jacobian);
        // A parameter that nothing depends on, such as the frequency of a hand that is absent, would make the matrix
        // singular.
        (0..square.nrows()).for_each(|at| square[(at, at)] = square[(at, at)] * (1.0 + 1e-9) + 1e-9);
        let variance = square.try_inverse().map_or(f64::INFINITY, |inverse| inverse[(3, 3)]);
        // The lines' standard deviations may be smaller than the residual, so the residual's scatter scales the result.
        let scatter = error * error;
        let hz = unknowns[3].exp() / TAU;
        Some(Self {
            resonance: Resonance {
                hz,
                hz_deviation: hz * (variance * scatter.max(1.0)).sqrt(),
                damping_ratio: unknowns[4].exp(),
            },
            delay_s: 1e-3 * unknowns[6],
            error,
            is_positive,
        })
    }
}

/// Returns the logarithm of the model's response at `hz`.
fn model(unknowns: &Unknowns, hz: f64) -> Complex<f64> {
    let s = Complex::new(0.0, TAU * hz);
    let pair = |at: usize| {
        let (omega, damping) = (unknowns[at].exp(), unknowns[at + 1].exp());
        s * s / (s * s + 2.0 * damping * omega * s + omega * omega)
    };
    let passed = s / (s + unknowns[5].exp()) * s / (s + TAU * DC_BLOCKER_HZ);
    let share = hz / 1e3;
    let phase = -TAU * share * unknowns[6] + unknowns[7] * share.powi(3);
    (pair(1) * pair(3) * passed).ln() + Complex::new(unknowns[0], phase)
}

/// Returns the residuals of each line, level and then phase, in units of the line's standard deviation.
fn residual(lines: &[&Line], is_positive: bool, unknowns: &Unknowns) -> DVector<f64> {
    let sign = if is_positive { 1.0 } else { -1.0 };
    let mut residual = DVector::zeros(2 * lines.len());
    for (row, line) in lines.iter().enumerate() {
        let off = (line.value * sign).ln() - model(unknowns, line.hz);
        // The logarithm determines the phase only up to whole turns; the value nearest to zero is used.
        let phase = (off.im + PI).rem_euclid(TAU) - PI;
        // A neper is 20 / ln 10 dB.
        let deviation = (line.deviation_db / 8.686).max(LEAST_DEVIATION);
        (residual[2 * row], residual[2 * row + 1]) = (off.re / deviation, phase / deviation);
    }
    residual
}

/// Returns the local minimum that is reached from `unknowns`: its RMS, the unknowns, and the Jacobian before the last
/// step to it.
fn refined(lines: &[&Line], is_positive: bool, mut unknowns: Unknowns) -> (f64, Unknowns, DMatrix<f64>) {
    // The unknowns are logarithms, milliseconds and radians, so that one step suits them all.
    const STEP: f64 = 1e-5;
    let of = |unknowns: &Unknowns| residual(lines, is_positive, unknowns);
    let mut left = of(&unknowns);
    let mut damping = 1e-2;
    let mut jacobian = DMatrix::zeros(left.len(), unknowns.len());
    for _ in 0..ROUNDS {
        for column in 0..unknowns.len() {
            let mut aside = unknowns;
            aside[column] += STEP;
            jacobian.set_column(column, &((of(&aside) - &left) / STEP));
        }
        let square = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&left);
        let mut is_better = false;
        while !is_better && damping < 1e9 {
            let mut damped = square.clone();
            for at in 0..unknowns.len() {
                damped[(at, at)] += damping * square[(at, at)].max(1e-9);
            }
            let Some(step) = damped.cholesky().map(|matrix| matrix.solve(&gradient)) else {
                break;
            };
            let tried = Unknowns::from_fn(|at, _| unknowns[at] - step[at].clamp(-0.7, 0.7));
            let of_tried = of(&tried);
            is_better = of_tried.norm() < left.norm();
            if is_better {
                let gained = 1.0 - of_tried.norm() / left.norm();
                (unknowns, left) = (tried, of_tried);
                // A damping of 1e10 ends both loops.
                damping = if gained < 1e-7 { 1e10 } else { damping / 5.0 };
            } else {
                damping *= 5.0;
            }
        }
        if damping > 1e8 {
            break;
        }
    }
    (left.norm() / (left.len() as f64).sqrt(), unknowns, jacobian)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::db;
    use test_helpers::{near, noise};

    /// Lines of a mass on a spring that is held by a hand and moved by a coil whose inductance has its corner at 7 kHz,
    /// after a delay.
    fn lines(hz: f64, damping: f64, sign: f64, scatter: f64) -> Vec<Line> {
        let hiss = noise(7, 400);
        (0..200)
            .map(|n| {
                let at = 10.0 + 5.0 * f64::from(n);
                let s = Complex::new(0.0, at);
                let own = s * s / (s * s + 2.0 * damping * hz * s + hz * hz);
                let hand = s * s / (s * s + 2.0 * 0.5 * 14.0 * s + 14.0 * 14.0);
                let coil = 1.0 / (1.0 + s / 7000.0) * s / (s + 5.0) * s / (s + 2.0);
                let noise = 1.0 + scatter * Complex::new(hiss[2 * n as usize], hiss[2 * n as usize + 1]);
                let value = 40.0 * sign * own * hand * coil * noise * Complex::from_polar(1.0, -TAU * at * 0.61e-3);
                let (level_db, deviation_db) = (db(value.norm()), 8.686 * scatter);
                Line {
                    hz: at,
                    value,
                    level_db,
                    deviation_db,
                    coherence: 1.0,
                }
            })
            .collect()
    }

    #[test]
    fn resonance_damping_delay_and_sign_are_found_as_near_as_they_say() {
        for (hz, damping, sign) in [
            (47.0, 0.6, 1.0),
            (62.0, 0.12, 1.0),
            (125.0, 0.3, -1.0),
            (250.0, 0.08, 1.0),
        ] {
            for scatter in [0.0, 0.01, 0.04] {
                let found = Fit::of(&lines(hz, damping, sign, scatter)).unwrap();
                let Resonance {
                    hz: found_hz,
                    hz_deviation,
                    damping_ratio,
                } = found.resonance;
                near(found_hz, hz, 4.0 * hz_deviation + 5e-3 * hz);
                assert!(hz_deviation < hz * (2e-3 + scatter), "{hz} {scatter}: {found:?}");
                near(damping_ratio / damping, 1.0, 0.03 + 3.0 * scatter);
                // The inductance accounts for 23 µs of the delay.
                near(found.delay_s, 0.633e-3, 0.01e-3 + scatter * 1e-3);
                assert_eq!(found.is_positive, sign > 0.0);
            }
        }
        assert!(Fit::of(&lines(100.0, 0.1, 1.0, 0.0)[..20]).is_none());
    }
}
