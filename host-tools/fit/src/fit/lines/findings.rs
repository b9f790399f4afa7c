//! The lines of a texture and of its trials, and the reasons for finding none.

use std::fmt;
use stylus_support::number::counted;

use model_format::limits::{MAX_LINE_AMPLITUDE, MAX_WAVELENGTH_MM, MIN_WAVELENGTH_MM};
use model_format::{LineSpec, LinesSpec, Wander};
use serde::{Deserialize, Serialize};

use crate::texture::grid::Grid;

/// The lines of a texture, or the reason that there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Lines tied to position: narrow ones by falling wavelength, wandering ones grouped by fundamental.
    pub lines: Vec<Line>,
    /// Frequencies that stay the same while the speed changes, Hz: hum and motors, which are no part of a surface.
    pub time_locked_hz: Vec<f64>,
    /// Scatter of the trials' actual speeds, as the lines give them, about the listed ones: standard deviation relative
    /// to the speed.
    pub speed_scatter: Option<f64>,
    /// Number of trials in which the lines' phase was followed through changes of speed.
    pub followed_trials: usize,
    /// Reason for finding no lines.
    pub none_because: Option<NoLines>,
    /// Wanders. Several lines can share one.
    pub wanders: Vec<Wander>,
}

/// A line that is tied to position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Wavelength, mm.
    pub wavelength_mm: f64,
    /// Phase of the line's sine at position 0, turns. For a harmonic it is relative to the fundamental; for others it
    /// is 0.
    pub phase_turns: f64,
    /// Index of the fundamental among the lines, and the number of the harmonic. `None` if the line is no harmonic.
    pub harmonic_of: Option<(usize, u32)>,
    /// Agreement of the trials on a harmonic's phase, 0 to 1. It is 1 for lines that are no harmonics.
    pub phase_agreement: f64,
    /// Number of speeds at which the line shows, and at which it could show.
    pub shown_at_speeds: (usize, usize),
    /// Lowest and highest amplitude among the trials that show the line, m/s².
    pub amplitude_range_m_s2: (f64, f64),
    /// Index of the line's wander among those of the findings; `None` if the line does not wander.
    pub wander: Option<usize>,
}

/// A reason for having no lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoLines {
    /// No recording can be searched.
    NothingSearched,
    /// The recordings that can be searched are at one speed, so position cannot be distinguished from time.
    OneSpeed,
    /// No wavelength stands out.
    NothingStandsOut,
}

impl fmt::Display for NoLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NothingSearched => {
                "each recording is silent, at rest, without contact, dropped or shorter than 0.2 s between cuts"
            }
            Self::OneSpeed => "recordings at one speed cannot tell place from time",
            Self::NothingStandsOut => "nothing stands out at one wavelength over half of the speeds",
        })
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.none_because {
            _ if !self.lines.is_empty() => self.fmt_lines(f)?,
            Some(reason) => write!(f, "no lines tied to position: {reason}")?,
            None => write!(f, "lines tied to position were not sought")?,
        }
        if !self.time_locked_hz.is_empty() {
            let hz: Vec<String> = self.time_locked_hz.iter().map(|hz| format!("{hz:.1}")).collect();
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
            // Lines of one wander are stored from the fundamental on, so the first has the longest wavelength.
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

/// Writes a description of `wander`; `longest` is the longest wavelength of its lines, mm.
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

/// What one trial has of its texture's lines.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialLines {
    /// Amplitude of each line in the trial, m/s², without the contribution of noise; `None` if the trial cannot hold
    /// the line or was not searched. A line that wanders has 0 then.
    pub amplitudes_m_s2: Vec<Option<f64>>,
    /// Ratio of the trial's actual speed, as the lines give it, to the listed one.
    pub speed_ratio: Option<f64>,
}

impl TrialLines {
    /// Returns what a trial has of its lines from what each of its stretches has, whose lengths are given: the RMS of
    /// the amplitudes, and the speed ratio of the longest stretch that gives one.
    pub(crate) fn of_stretches(stretches: &[(usize, Self)]) -> Self {
        if let [(_, whole)] = stretches {
            return whole.clone();
        }
        let lines = stretches.iter().map(|(_, own)| own.amplitudes_m_s2.len()).max();
        let amplitude = |line: usize| {
            let known = stretches.iter().filter_map(|(samples, own)| {
                let amplitude = own.amplitudes_m_s2.get(line).copied().flatten()?;
                Some((*samples as f64, amplitude))
            });
            let (samples, power) = known.fold((0.0, 0.0), |(n, power), (own, a)| (n + own, power + own * a * a));
            (samples > 0.0).then(|| (power / samples).sqrt())
        };
        let told = stretches
            .iter()
            .filter_map(|(samples, own)| Some((samples, own.speed_ratio?)));
        Self {
            amplitudes_m_s2: (0..lines.unwrap_or(0)).map(amplitude).collect(),
            speed_ratio: told.max_by_key(|(samples, _)| **samples).map(|(_, ratio)| ratio),
        }
    }
}

/// What the lines of a grid need to know of one trial.
pub(crate) struct LineMember<'a> {
    /// Speed of the trial's node, mm/s.
    pub speed_mm_s: f64,
    /// Force of the trial's node, N.
    pub force_n: f64,
    /// True if the trial was found silent.
    pub is_silent: bool,
    /// What the trial has of the texture's lines.
    pub lines: &'a TrialLines,
}

/// Returns the lines of `findings` with their amplitudes at the nodes of `grid`, from the trials at each node; `None`
/// if there are no lines.
///
/// A node may have no amplitude of its own, because nothing was recorded there or because the line's frequency is too
/// high to be recorded. Its amplitude is then interpolated between the nearest speeds of the same force (beyond the
/// outermost, the nearest counts), or else in the same way between forces. Above the frequencies that can be recorded,
/// the device itself fades a line out.
pub(crate) fn lines_on(grid: &Grid, findings: &Findings, members: &[LineMember<'_>]) -> Option<LinesSpec> {
    let lines: Vec<LineSpec> = findings
        .lines
        .iter()
        .enumerate()
        .filter_map(|(index, line)| {
            let known: Vec<Option<f64>> = grid
                .nodes()
                .map(|(speed, force, _)| {
                    // The grid's axes are these values in single precision, so equality is exact.
                    let here = members
                        .iter()
                        .filter(|member| member.speed_mm_s as f32 == speed && member.force_n as f32 == force);
                    mean_amplitude(here, index)
                })
                .collect();
            let amplitudes = filled(grid, &known);
            let wavelength_mm = line.wavelength_mm as f32;
            // The format holds no line that is silent at every node.
            let is_held =
                (MIN_WAVELENGTH_MM..=MAX_WAVELENGTH_MM).contains(&wavelength_mm) && amplitudes.iter().any(|&a| a > 0.0);
            is_held.then(|| LineSpec {
                wavelength_mm,
                // A phase that rounds up to a whole turn wraps to 0.
                phase: (line.phase_turns.rem_euclid(1.0) * 65_536.0).round() as u32 as u16,
                amplitudes,
                wander: line.wander.map(|index| index as u8),
            })
        })
        .collect();
    (!lines.is_empty()).then(|| LinesSpec::with_wanders(lines, &findings.wanders))
}

/// RMS of the amplitudes of line `index` in a node's trials; `None` if none of them has an amplitude.
fn mean_amplitude<'m>(trials: impl Iterator<Item = &'m LineMember<'m>>, index: usize) -> Option<f64> {
    let known: Vec<f64> = trials
        .filter_map(|member| {
            // Silence shows that the line does not sound here. Without a trial, nothing is known.
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
            let row: Vec<_> = (0..forces.len()).map(|f| along_speed[grid.index(speed, f)]).collect();
            let amplitude = between(forces, &row, node % forces.len()).unwrap_or(0.0);
            amplitude.clamp(0.0, f64::from(MAX_LINE_AMPLITUDE)) as f32
        })
        .collect()
}

/// Returns the value at index `at` of an axis: the known one, or one interpolated between known ones on both sides, or
/// the nearest known one.
fn between(axis: &[f32], known: &[Option<f64>], at: usize) -> Option<f64> {
    let before = (0..=at).rev().find_map(|i| Some((i, known[i]?)));
    let after = (at..axis.len()).find_map(|i| Some((i, known[i]?)));
    match (before, after) {
        // A known value at `at` is found from both sides, with a = b.
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
