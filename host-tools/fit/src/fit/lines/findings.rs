//! Lines of a texture and of its trials, and the reasons for having none.

use crate::support::number::counted;
use std::fmt;

use model_format::limits::{MAX_LINE_AMPLITUDE, MAX_WAVELENGTH_MM, MIN_WAVELENGTH_MM};
use model_format::{LineSpec, LinesSpec, Wander};
use serde::{Deserialize, Serialize};

use crate::texture::grid::Grid;

/// The lines of a texture, or the reason that there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Lines tied to position, the strongest first.
    pub lines: Vec<Line>,
    /// Frequencies that stay while the speed changes, Hz: hum and motors, which are no part of a surface.
    pub time_locked_hz: Vec<f64>,
    /// Scatter of the trials' speeds about those listed, as the lines tell it: standard deviation over the speed.
    pub speed_scatter: Option<f64>,
    /// Trials whose speed was followed through its changes.
    pub followed_trials: usize,
    /// Reason for having no lines.
    pub none_because: Option<NoLines>,
    /// Wanders that lines share.
    #[serde(default)]
    pub wanders: Vec<Wander>,
}

/// A line that is tied to position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Wavelength, mm.
    pub wavelength_mm: f64,
    /// Phase at place 0 of a sine, turns: relative to the fundamental for a harmonic, 0 for others.
    pub phase_turns: f64,
    /// Index of the fundamental among the lines, and the number of the harmonic.
    pub harmonic_of: Option<(usize, u32)>,
    /// Agreement of the trials on a harmonic's phase, 0 to 1; 1 for others.
    pub phase_agreement: f64,
    /// Speeds at which the line shows, and at which it could.
    pub shown_at_speeds: (usize, usize),
    /// Lowest and highest amplitude of a trial that shows it, m/s².
    pub amplitude_range_m_s2: (f64, f64),
    /// Index of the line's wander among those of the findings; none if the line's place does not wander.
    #[serde(default)]
    pub wander: Option<usize>,
}

/// A reason for having no lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoLines {
    /// Recordings at one speed cannot tell place from time.
    OneSpeed,
    /// Nothing stands out at one wavelength.
    NothingStandsOut,
}

impl fmt::Display for NoLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OneSpeed => "recordings at one speed cannot tell place from time",
            Self::NothingStandsOut => {
                "nothing stands out at one wavelength over half of the speeds"
            }
        })
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.none_because {
            _ if !self.lines.is_empty() => self.fmt_lines(f)?,
            Some(reason) => write!(f, "no lines tied to position: {reason}")?,
            None => write!(f, "no lines tied to position")?,
        }
        if !self.time_locked_hz.is_empty() {
            let hz: Vec<String> = self
                .time_locked_hz
                .iter()
                .map(|hz| format!("{hz:.1}"))
                .collect();
            write!(
                f,
                "; left in the noise, because they stay while the speed changes: {} Hz",
                hz.join(", ")
            )?;
        }
        Ok(())
    }
}

impl Findings {
    fn fmt_lines(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} tied to position:", counted(self.lines.len(), "line"))?;
        for (index, line) in self.lines.iter().enumerate() {
            let (low, high) = line.amplitude_range_m_s2;
            let (shown, all) = line.shown_at_speeds;
            let separator = if index > 0 { ";" } else { "" };
            write!(
                f,
                "{separator} {:.4} mm ({low:.3} to {high:.3} m/s², at {shown} of {all} speeds",
                line.wavelength_mm
            )?;
            match line.harmonic_of {
                Some((of, n)) => write!(f, ", harmonic {n} of line {})", of + 1)?,
                None => write!(f, ")")?,
            }
        }
        for (index, wander) in self.wanders.iter().enumerate() {
            let own = |line: &&Line| line.wander == Some(index);
            let longest = self.lines.iter().find(own);
            fmt_wander(wander, longest.map_or(1.0, |line| line.wavelength_mm), f)?;
        }
        if let Some(scatter) = self.speed_scatter {
            let per_cent = 100.0 * scatter;
            write!(f, "; the speeds are within {per_cent:.2} % of those listed")?;
        }
        if self.followed_trials > 0 {
            write!(
                f,
                "; changes of speed were followed in {}",
                counted(self.followed_trials, "trial")
            )?;
        }
        Ok(())
    }
}

/// Writes what is said of a `wander`, by the wavelength of the longest of its lines, mm.
fn fmt_wander(wander: &Wander, longest: f64, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let rad = std::f64::consts::TAU * f64::from(wander.rms_mm) / longest;
    let held = if wander.clock_mm_s > 0.0 {
        let hz = f64::from(wander.clock_mm_s) / longest;
        format!("hold {hz:.1} Hz at any speed, and ")
    } else {
        String::new()
    };
    let (rms, length) = (wander.rms_mm, wander.correlation_mm);
    write!(
        f,
        "; that of {longest:.4} mm and its harmonics {held}wander by {rms:.3} mm RMS ({rad:.2} rad) over {length:.2} mm"
    )
}

/// A trial's share of its texture's lines.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialLines {
    /// Amplitude of each line in the trial, m/s², without what noise adds to it; none where the trial cannot hold the
    /// line or was not looked at.
    pub amplitudes_m_s2: Vec<Option<f64>>,
    /// The trial's speed over the one listed, as the lines tell it.
    pub speed_ratio: Option<f64>,
}

/// A trial of a grid, as far as its lines need it.
pub struct LineMember<'a> {
    /// Speed of the trial's node, mm/s.
    pub speed_mm_s: f64,
    /// Force of the trial's node, N.
    pub force_n: f64,
    /// True if the trial was found silent.
    pub is_silent: bool,
    /// The trial's share of the texture's lines.
    pub lines: &'a TrialLines,
}

/// The lines of `findings` with an amplitude per node of `grid`, from the trials that made it; `None` without lines.
///
/// A node that no trial tells of, because none was recorded or because the line is above the frequencies that can be
/// recorded there, has what lies between its neighbours of the same force, or the nearest of them, or that of the
/// nearest force. Above those frequencies the device fades a line out by itself.
pub fn lines_on(grid: &Grid, findings: &Findings, members: &[LineMember<'_>]) -> Option<LinesSpec> {
    let lines: Vec<LineSpec> = findings
        .lines
        .iter()
        .enumerate()
        .filter_map(|(index, line)| {
            let known: Vec<Option<f64>> = grid
                .nodes()
                .map(|(speed, force, _)| {
                    let here = members.iter().filter(|member| {
                        member.speed_mm_s as f32 == speed && member.force_n as f32 == force
                    });
                    mean_amplitude(here, index)
                })
                .collect();
            let amplitudes = filled(grid, &known);
            let wavelength_mm = line.wavelength_mm as f32;
            let is_held = (MIN_WAVELENGTH_MM..=MAX_WAVELENGTH_MM).contains(&wavelength_mm)
                && amplitudes.iter().any(|&a| a > 0.0);
            is_held.then(|| LineSpec {
                wavelength_mm,
                phase: (line.phase_turns.rem_euclid(1.0) * 65_536.0).round() as u32 as u16,
                amplitudes,
                wander: line.wander.map(|index| index as u8),
            })
        })
        .collect();
    (!lines.is_empty()).then(|| LinesSpec::with_wanders(lines, &findings.wanders))
}

/// RMS of the amplitudes of line `index` in a node's trials; `None` if none of them tells.
fn mean_amplitude<'m>(
    trials: impl Iterator<Item = &'m LineMember<'m>>,
    index: usize,
) -> Option<f64> {
    let known: Vec<f64> = trials
        .filter_map(|member| {
            if member.is_silent {
                Some(0.0)
            } else {
                member.lines.amplitudes_m_s2.get(index).copied().flatten()
            }
        })
        .collect();
    let square: f64 = known.iter().map(|a| a * a).sum();
    (!known.is_empty()).then(|| (square / known.len() as f64).sqrt())
}

fn filled(grid: &Grid, known: &[Option<f64>]) -> Vec<f32> {
    let (speeds, forces) = (&grid.speeds_mm_s, &grid.forces_n);
    let along_speed: Vec<Option<f64>> = (0..known.len())
        .map(|node| {
            let force = node % forces.len();
            let column = (0..speeds.len()).map(|s| known[grid.index(s, force)]);
            between(speeds, &column.collect::<Vec<_>>(), node / forces.len())
        })
        .collect();
    (0..known.len())
        .map(|node| {
            let speed = node / forces.len();
            let row: Vec<_> = (0..forces.len())
                .map(|f| along_speed[grid.index(speed, f)])
                .collect();
            let amplitude = between(forces, &row, node % forces.len()).unwrap_or(0.0);
            amplitude.clamp(0.0, f64::from(MAX_LINE_AMPLITUDE)) as f32
        })
        .collect()
}

/// Value at position `at` of an axis: what is known, or linear between the known ones on both sides, or the nearest.
fn between(axis: &[f32], known: &[Option<f64>], at: usize) -> Option<f64> {
    let before = (0..=at).rev().find_map(|i| Some((i, known[i]?)));
    let after = (at..axis.len()).find_map(|i| Some((i, known[i]?)));
    match (before, after) {
        (Some((a, left)), Some((b, right))) if a < b => {
            let share = f64::from((axis[at] - axis[a]) / (axis[b] - axis[a]));
            Some(left + share * (right - left))
        }
        (Some((_, value)), _) | (None, Some((_, value))) => Some(value),
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_trial_tells_lies_between_its_neighbours_or_is_that_of_the_nearest() {
        let axis = [10.0, 20.0, 40.0, 80.0];
        let known = [None, Some(1.0), None, Some(4.0)];
        for (at, expected) in [1.0, 1.0, 2.0, 4.0].into_iter().enumerate() {
            assert!((between(&axis, &known, at).unwrap() - expected).abs() < 1e-6);
        }
        assert_eq!(between(&axis, &[None; 4], 2), None);
    }
}
