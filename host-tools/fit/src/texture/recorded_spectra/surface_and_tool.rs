//! Separation of the spectra of one surface at several speeds into what moves with the speed and what stays.
//!
//! A tool that is dragged over a surface at the speed v vibrates with the surface's profile, whose components stay at
//! fixed spatial frequencies f/v. The vibration is shaped by the resonances of tool and hand, which stay at fixed
//! frequencies f. In logarithms: L(f, v) = S(ln f - ln v) + T(ln f) + R(f, v). S and T are found by backfitting (Hastie
//! and Tibshirani, *Generalized Additive Models*, 1990, ch. 4): each in turn is the mean of what the other leaves. For
//! another speed, S is moved and T is not. R, which neither explains, is taken from the neighbouring speeds as a smooth
//! curve.
//!
//! Moving the whole spectrum with the speed would move the tool's resonances too.

use std::sync::LazyLock;

use crate::dsp::log_spectrum::{BINS, LogSpectrum, STEP_HZ};

/// Number of frequencies of the decomposition, evenly spaced in ln f.
const POINTS: usize = 1400;

/// The lowest of these frequencies, Hz. Below it, spectra are constant.
const LOWEST_HZ: f64 = 4.0;

/// Rounds of backfitting. Most of the change is in the first three.
const ROUNDS: usize = 8;

/// A third octave in base ten, as a difference of natural logarithms.
const THIRD_OCTAVE: f64 = 0.1 * std::f64::consts::LN_10;

/// Least number of speeds whose spectra can be separated. Two do not show what moves and what stays; their whole
/// spectra are warped.
pub const FEWEST_SPEEDS: usize = 3;

/// A curve over ln f, [`POINTS`] values.
type Curve = Vec<f64>;

/// Spacing of the points in ln f.
fn step() -> f64 {
    static STEP: LazyLock<f64> =
        LazyLock::new(|| (((BINS - 1) as f64 * STEP_HZ) / LOWEST_HZ).ln() / (POINTS - 1) as f64);
    *STEP
}

fn curve_of(spectrum: &LogSpectrum) -> Curve {
    /// The bin of each point.
    static BIN_OF: LazyLock<Vec<f64>> = LazyLock::new(|| {
        let bin = |point: usize| LOWEST_HZ * (step() * point as f64).exp() / STEP_HZ;
        (0..POINTS).map(bin).collect()
    });
    BIN_OF.iter().map(|&bin| spectrum.at(bin)).collect()
}

fn spectrum_of(curve: &[f64]) -> LogSpectrum {
    /// Position of each bin among the points.
    static PLACE_OF: LazyLock<Vec<f64>> = LazyLock::new(|| {
        let frequency_hz = |bin: usize| (bin as f64 * STEP_HZ).max(LOWEST_HZ);
        let place = |bin| (frequency_hz(bin) / LOWEST_HZ).ln() / step();
        (0..BINS).map(place).collect()
    });
    let values = PLACE_OF.iter().map(|&place| value_at(curve, place));
    LogSpectrum::from_values(values.collect())
}

/// Returns the value between two points. Beyond the ends, it is that of the end.
fn value_at(values: &[f64], place: f64) -> f64 {
    let place = place.clamp(0.0, (values.len() - 1) as f64);
    let below = (place as usize).min(values.len() - 2);
    values[below] + (values[below + 1] - values[below]) * (place - below as f64)
}

/// Spectra of one surface at one force, separated into surface, tool and rest.
#[derive(Clone, Debug)]
pub struct SurfaceAndTool {
    /// ln v of every spectrum, ascending.
    log_speeds: Vec<f64>,
    /// The surface's curve over ln f - ln v, in the same steps. It starts at the lowest frequency and the highest
    /// speed.
    surface: Vec<f64>,
    tool: Curve,
    /// The part of every spectrum that neither surface nor tool explains, smoothed.
    rest: Vec<Curve>,
}

impl SurfaceAndTool {
    /// Separates spectra at ascending speeds, mm/s, into surface, tool and rest.
    /// Panics if there are fewer than [`FEWEST_SPEEDS`].
    pub fn of(members: &[(f64, &LogSpectrum)]) -> Self {
        assert!(members.len() >= FEWEST_SPEEDS);
        let log_speeds: Vec<f64> = members.iter().map(|(speed, _)| speed.ln()).collect();
        let curves: Vec<Curve> = members.iter().map(|(_, s)| curve_of(s)).collect();
        // Over ln f - ln v, the curves of the slowest and the fastest speed are this many points apart.
        let reach = (log_speeds[log_speeds.len() - 1] - log_speeds[0]) / step();
        let mut parts = Self {
            surface: vec![0.0; POINTS + reach.ceil() as usize],
            tool: vec![0.0; POINTS],
            rest: Vec::new(),
            log_speeds,
        };
        for _ in 0..ROUNDS {
            parts.surface = parts.surface_left_by_tool(&curves);
            parts.tool = parts.tool_left_by_surface(&curves);
        }
        parts.rest = curves
            .iter()
            .zip(&parts.log_speeds)
            .map(|(curve, &log_speed)| {
                let offset = parts.offset(log_speed);
                let rest = (0..POINTS).map(|p| curve[p] - parts.both_at(p, offset));
                smoothed(&smoothed(&rest.collect::<Curve>()))
            })
            .collect();
        parts
    }

    /// Returns the position on the surface's curve of point 0 of a spectrum at this speed.
    fn offset(&self, log_speed: f64) -> f64 {
        (self.log_speeds[self.log_speeds.len() - 1] - log_speed) / step()
    }

    /// Returns the sum of surface and tool at `point` of a spectrum; `offset` is the position of its point 0 on the
    /// surface's curve.
    fn both_at(&self, point: usize, offset: f64) -> f64 {
        self.tool[point] + value_at(&self.surface, point as f64 + offset)
    }

    fn surface_left_by_tool(&self, curves: &[Curve]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.surface.len()];
        for (curve, &log_speed) in curves.iter().zip(&self.log_speeds) {
            let left: Curve = curve.iter().zip(&self.tool).map(|(l, t)| l - t).collect();
            let offset = self.offset(log_speed);
            let first = offset.ceil() as usize;
            for (index, sum) in sums.iter_mut().enumerate().skip(first) {
                let place = index as f64 - offset;
                if place > (POINTS - 1) as f64 {
                    break;
                }
                sum.0 += value_at(&left, place);
                sum.1 += 1.0;
            }
        }
        // The outermost values may lie between points of the only spectrum that reaches them.
        let mut surface: Vec<f64> = sums.iter().map(|(sum, n)| sum / n).collect();
        for index in 1..surface.len() {
            if sums[index].1 <= 0.0 {
                surface[index] = surface[index - 1];
            }
        }
        surface
    }

    fn tool_left_by_surface(&self, curves: &[Curve]) -> Curve {
        let weight = 1.0 / curves.len() as f64;
        let mut tool = vec![0.0; POINTS];
        for (curve, &log_speed) in curves.iter().zip(&self.log_speeds) {
            let offset = self.offset(log_speed);
            for (point, (tool, value)) in tool.iter_mut().zip(curve).enumerate() {
                *tool += weight * (value - value_at(&self.surface, point as f64 + offset));
            }
        }
        tool
    }

    /// Returns the spectrum at a speed between the first and the last, mm/s.
    pub fn at(&self, speed_mm_s: f64) -> LogSpectrum {
        let log_speed = speed_mm_s.ln();
        let above = self
            .log_speeds
            .partition_point(|&known| known < log_speed)
            .clamp(1, self.log_speeds.len() - 1);
        let (low, high) = (
            self.log_speeds[above - 1].exp(),
            self.log_speeds[above].exp(),
        );
        // At the first and the last speed, rounding may go beyond the ends.
        let share = ((speed_mm_s - low) / (high - low)).clamp(0.0, 1.0);
        let offset = self.offset(log_speed);
        let curve: Curve = (0..POINTS)
            .map(|point| {
                let (below, above) = (&self.rest[above - 1], &self.rest[above]);
                let rest = below[point] + (above[point] - below[point]) * share;
                self.both_at(point, offset) + rest
            })
            .collect();
        spectrum_of(&curve)
    }
}

/// Returns the running mean over a third octave; at the ends, over the points that exist.
fn smoothed(curve: &[f64]) -> Curve {
    let half = (0.5 * THIRD_OCTAVE / step()) as usize;
    let mut sums = vec![0.0; POINTS + 1];
    for (point, value) in curve.iter().enumerate() {
        sums[point + 1] = sums[point] + value;
    }
    (0..POINTS)
        .map(|point| {
            let (first, end) = (point.saturating_sub(half), (point + half + 1).min(POINTS));
            (sums[end] - sums[first]) / (end - first) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A surface with a line at 1/mm and a tool that resonates at 300 Hz.
    fn truth(speed_mm_s: f64) -> LogSpectrum {
        let values = (0..BINS).map(|bin| {
            let frequency_hz = (bin as f64 * STEP_HZ).max(LOWEST_HZ);
            let line = ((frequency_hz / speed_mm_s).ln() / 0.1).powi(2);
            let resonance = ((frequency_hz / 300.0).ln() / 0.2).powi(2);
            6.0 * (-line).exp() + 3.0 * (-resonance).exp() - 0.5 * (frequency_hz / speed_mm_s).ln()
        });
        LogSpectrum::from_values(values.collect())
    }

    fn largest_error(a: &LogSpectrum, b: &LogSpectrum) -> f64 {
        let bins = 40..4900;
        bins.map(|bin| (a.values()[bin] - b.values()[bin]).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_line_moves_with_the_speed_and_a_resonance_stays() {
        let [low, high] = [100.0, 140.0].map(|speed| (0.5, truth(speed).warped(speed, 120.0)));
        let whole = LogSpectrum::mean(&[(low.0, &low.1), (high.0, &high.1)]);
        let whole = largest_error(&whole, &truth(120.0));
        let few = vec![60.0, 100.0, 140.0];
        assert_eq!(few.len(), FEWEST_SPEEDS);
        let many = vec![40.0, 60.0, 80.0, 100.0, 140.0, 160.0, 180.0, 200.0];
        for (speeds, most) in [(few, 0.5 * whole), (many, 0.5f64.min(0.5 * whole))] {
            let spectra: Vec<_> = speeds.iter().map(|&speed| truth(speed)).collect();
            let members: Vec<_> = speeds.into_iter().zip(&spectra).collect();
            let apart = largest_error(&SurfaceAndTool::of(&members).at(120.0), &truth(120.0));
            let count = members.len();
            assert!(apart < most, "{count} speeds: {apart} against {most}");
        }
    }

    #[test]
    fn what_is_not_a_sum_at_all_is_still_between_its_neighbours() {
        let speeds = [20.0, 40.0, 60.0, 80.0];
        let spectra =
            [0.0, 1.0, -1.0, 2.0].map(|level| LogSpectrum::from_values(vec![level; BINS]));
        let members: Vec<_> = speeds.into_iter().zip(&spectra).collect();
        let parts = SurfaceAndTool::of(&members);
        for (speed, level) in [(20.0, 0.0), (40.0, 1.0), (60.0, -1.0), (80.0, 2.0)] {
            let there = parts.at(speed);
            assert!(
                (there.values()[1000] - level).abs() < 0.05,
                "{speed}: {}",
                there.values()[1000]
            );
        }
    }
}
