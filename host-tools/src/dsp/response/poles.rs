//! The poles that explain a response, by vector fitting (Gustavsen and Semlyen, IEEE Trans. Power Delivery 14, 1999,
//! 1052), with a delay beside them.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use realfft::num_complex::Complex;

use super::measured::Line;

/// Angular frequency that is 1 in the fit, so that its matrices are well conditioned.
const UNIT: f64 = TAU * 200.0;

/// Pairs of poles at the start, by their frequencies in Hz.
const PAIRS_HZ: [f64; 2] = [25.0, 150.0];

/// Real poles at the start, Hz.
const REAL_HZ: [f64; 2] = [400.0, 2500.0];

/// Rounds of relocating poles for each delay that is tried.
const ROUNDS: usize = 12;

/// Longest delay that is tried, s, and the steps to it.
const DELAYS: (f64, u32) = (1.2e-3, 24);

/// Frequencies of what counts as the resonance, Hz.
const RESONANCE_HZ: [f64; 2] = [15.0, 900.0];

/// A resonance.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Resonance {
    /// Undamped natural frequency, Hz.
    pub hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// Poles and delay that explain a response.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Delay, s.
    pub delay_s: f64,
    /// The pair of poles that has most of the response; none if none is within 15 to 900 Hz.
    pub resonance: Option<Resonance>,
    /// RMS of what is not explained, relative to the response.
    pub error: f64,
    /// True if the response is positive above the resonance: the tip moves along its direction with the voltage.
    pub is_positive: bool,
}

impl Fit {
    /// Fits trusted lines; none of too few.
    pub fn of(lines: &[Line]) -> Option<Self> {
        let lines: Vec<&Line> = lines.iter().filter(|line| line.is_trusted()).collect();
        let unknowns = 2 * (2 * PAIRS_HZ.len() + REAL_HZ.len()) + 1;
        if lines.len() < 2 * unknowns {
            return None;
        }
        let (longest, steps) = DELAYS;
        let tried = (0..=steps)
            .filter_map(|n| with_delay(&lines, longest * f64::from(n) / f64::from(steps)));
        let coarse = tried.min_by(|a, b| a.error.total_cmp(&b.error))?;
        let step = longest / f64::from(steps);
        let nearer =
            (-4..=4).filter_map(|n| with_delay(&lines, coarse.delay_s + f64::from(n) * step / 5.0));
        nearer.min_by(|a, b| a.error.total_cmp(&b.error))
    }
}

/// A real pole, or a pair of complex ones by the one above the real axis.
#[derive(Clone, Copy)]
enum Pole {
    Real(f64),
    Pair(Complex<f64>),
}

fn with_delay(lines: &[&Line], delay_s: f64) -> Option<Fit> {
    let s: Vec<Complex<f64>> = lines
        .iter()
        .map(|line| Complex::new(0.0, TAU * line.hz / UNIT))
        .collect();
    let values: Vec<Complex<f64>> = lines
        .iter()
        .map(|line| line.value * Complex::from_polar(1.0, TAU * line.hz * delay_s))
        .collect();
    let mut poles: Vec<Pole> = PAIRS_HZ
        .iter()
        .map(|hz| Pole::Pair(Complex::new(-0.2, 1.0) * (TAU * hz / UNIT)))
        .chain(REAL_HZ.iter().map(|hz| Pole::Real(-TAU * hz / UNIT)))
        .collect();
    let count = 2 * PAIRS_HZ.len() + REAL_HZ.len();
    let mut solution = DVector::zeros(0);
    let mut error = f64::INFINITY;
    for round in 0..=ROUNDS {
        // The last round leaves the poles where they are, and has residues alone.
        let relocates = round < ROUNDS;
        let columns = if relocates { 2 * count + 1 } else { count + 1 };
        let mut matrix = DMatrix::zeros(2 * lines.len(), columns);
        let mut right = DVector::zeros(2 * lines.len());
        for (row, (&s, &value)) in s.iter().zip(&values).enumerate() {
            let weight = 1.0 / value.norm();
            let mut set = |column: usize, entry: Complex<f64>| {
                matrix[(2 * row, column)] = entry.re * weight;
                matrix[(2 * row + 1, column)] = entry.im * weight;
            };
            for (column, part) in parts(&poles, s).into_iter().enumerate() {
                set(column, part);
                if relocates {
                    set(count + 1 + column, -part * value);
                }
            }
            set(count, Complex::new(1.0, 0.0));
            right[2 * row] = value.re * weight;
            right[2 * row + 1] = value.im * weight;
        }
        let svd = matrix.clone().svd(true, true);
        solution = svd.solve(&right, 1e-13 * svd.singular_values.max()).ok()?;
        if relocates {
            poles = relocated(&poles, &solution.as_slice()[count + 1..])?;
        } else {
            error = (&matrix * &solution - right).norm() / (lines.len() as f64).sqrt();
        }
    }
    let top = s[s.len() - 1];
    let whole: Complex<f64> = parts(&poles, top)
        .into_iter()
        .zip(solution.iter())
        .map(|(part, residue)| part * *residue)
        .sum::<Complex<f64>>()
        + solution[count];
    Some(Fit {
        delay_s,
        resonance: resonance(&poles, &solution),
        error,
        is_positive: whole.re > 0.0,
    })
}

/// The partial fractions at `s`: one per real pole, two per pair.
fn parts(poles: &[Pole], s: Complex<f64>) -> Vec<Complex<f64>> {
    let mut parts = Vec::new();
    for pole in poles {
        match *pole {
            Pole::Real(real) => parts.push(1.0 / (s - real)),
            Pole::Pair(pole) => {
                let (above, below) = (1.0 / (s - pole), 1.0 / (s - pole.conj()));
                parts.extend([above + below, Complex::<f64>::i() * (above - below)]);
            }
        }
    }
    parts
}

/// The zeros of 1 + Σ residues · parts, mirrored to the left, which are the next poles.
fn relocated(poles: &[Pole], residues: &[f64]) -> Option<Vec<Pole>> {
    let count = residues.len();
    let (mut matrix, mut input, mut at) = (DMatrix::zeros(count, count), DVector::zeros(count), 0);
    for pole in poles {
        match *pole {
            Pole::Real(real) => {
                (matrix[(at, at)], input[at]) = (real, 1.0);
                at += 1;
            }
            Pole::Pair(pole) => {
                (matrix[(at, at)], matrix[(at + 1, at + 1)]) = (pole.re, pole.re);
                (matrix[(at, at + 1)], matrix[(at + 1, at)]) = (pole.im, -pole.im);
                input[at] = 2.0;
                at += 2;
            }
        }
    }
    let zeros =
        (matrix - input * DVector::from_row_slice(residues).transpose()).complex_eigenvalues();
    let mut next = Vec::new();
    for zero in zeros.iter() {
        if !zero.re.is_finite() {
            return None;
        }
        let left = -zero.re.abs().max(1e-6);
        if zero.im.abs() < 1e-9 * zero.norm() {
            next.push(Pole::Real(left));
        } else if zero.im > 0.0 {
            next.push(Pole::Pair(Complex::new(left, zero.im)));
        }
    }
    let kept = |pole: &Pole| if matches!(pole, Pole::Real(_)) { 1 } else { 2 };
    (next.iter().map(kept).sum::<usize>() == count).then_some(next)
}

/// The pair within the range that has the largest part of the response at its own frequency.
fn resonance(poles: &[Pole], solution: &DVector<f64>) -> Option<Resonance> {
    let (mut at, mut best) = (0, None);
    for pole in poles {
        let Pole::Pair(pole) = pole else {
            at += 1;
            continue;
        };
        let residue = Complex::new(solution[at], solution[at + 1]).norm();
        at += 2;
        let (hz, share) = (pole.norm() * UNIT / TAU, residue / pole.re.abs());
        let is_within = (RESONANCE_HZ[0]..=RESONANCE_HZ[1]).contains(&hz);
        if is_within && best.is_none_or(|(most, _)| share > most) {
            let damping_ratio = -pole.re / pole.norm();
            best = Some((share, Resonance { hz, damping_ratio }));
        }
    }
    best.map(|(_, resonance)| resonance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::response::db;
    use crate::dsp::test_signals::noise;

    /// A mass on a spring that a coil of 1.3 kHz moves, held by a hand, after a delay.
    fn lines(hz: f64, damping: f64, sign: f64, scatter: f64) -> Vec<Line> {
        let hiss = noise(7, 400);
        (0..200)
            .map(|n| {
                let at = 10.0 + 5.0 * f64::from(n);
                let s = Complex::new(0.0, at);
                let own = s * s / (s * s + 2.0 * damping * hz * s + hz * hz);
                let hand = s * s / (s * s + 2.0 * 0.5 * 14.0 * s + 14.0 * 14.0);
                let coil = 1.0 / (1.0 + s / 1300.0);
                let noise =
                    1.0 + scatter * Complex::new(hiss[2 * n as usize], hiss[2 * n as usize + 1]);
                let value = 40.0
                    * sign
                    * own
                    * hand
                    * coil
                    * noise
                    * Complex::from_polar(1.0, -TAU * at * 0.61e-3);
                let level_db = db(value.norm());
                Line {
                    hz: at,
                    value,
                    level_db,
                    deviation_db: 0.1,
                    coherence: 1.0,
                }
            })
            .collect()
    }

    #[test]
    fn resonance_damping_delay_and_sign_are_found() {
        for (hz, damping, sign) in [(62.0, 0.12, 1.0), (125.0, 0.3, -1.0), (250.0, 0.08, 1.0)] {
            for (scatter, within) in [(0.0, 1e-3), (0.01, 0.02)] {
                let found = Fit::of(&lines(hz, damping, sign, scatter)).unwrap();
                let resonance = found.resonance.unwrap();
                assert!(
                    (resonance.hz / hz - 1.0).abs() < within,
                    "{hz} {scatter}: {found:?}"
                );
                assert!(
                    (resonance.damping_ratio - damping).abs() < 5.0 * within,
                    "{hz}: {found:?}"
                );
                assert!(
                    (found.delay_s - 0.61e-3).abs() < 0.08e-3 && found.error < 0.03,
                    "{found:?}"
                );
                assert_eq!(found.is_positive, sign > 0.0);
            }
        }
        assert!(Fit::of(&lines(100.0, 0.1, 1.0, 0.0)[..20]).is_none());
    }
}
