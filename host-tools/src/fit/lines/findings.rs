//! Lines of a texture and of its trials, and the reasons for having none.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

/// The lines of a texture, or the reason that there are none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Lines locked to place, the strongest first.
    pub lines: Vec<Line>,
    /// Frequencies that stay while the speed changes, Hz: hum and motors, which are no part of a surface.
    pub time_locked_hz: Vec<f64>,
    /// Scatter of the trials' speeds about those listed, as the lines tell it: standard deviation over the speed.
    #[serde(default)]
    pub speed_scatter: Option<f64>,
    /// Trials whose speed was followed through its changes.
    pub followed_trials: usize,
    /// Reason for having no lines.
    #[serde(default)]
    pub none_because: Option<NoLines>,
}

/// A line that is locked to place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Wavelength, mm.
    pub wavelength_mm: f64,
    /// Phase at place 0 of a sine, turns: relative to the fundamental for a harmonic, 0 for others.
    pub phase_turns: f64,
    /// Index of the fundamental among the lines, and the number of the harmonic.
    #[serde(default)]
    pub harmonic_of: Option<(usize, u32)>,
    /// Agreement of the trials on a harmonic's phase, 0 to 1; 1 for others.
    pub phase_agreement: f64,
    /// Speeds at which the line shows, and at which it could.
    pub shown_at_speeds: (usize, usize),
    /// Lowest and highest amplitude of a trial that shows it, m/s².
    pub amplitude_range_m_s2: (f64, f64),
}

/// A reason for having no lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoLines {
    /// They were not asked for.
    NotAskedFor,
    /// Recordings at one speed cannot tell place from time.
    OneSpeed,
    /// Nothing stands out at one wavelength.
    NothingStandsOut,
}

impl fmt::Display for NoLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotAskedFor => "not asked for",
            Self::OneSpeed => "recordings at one speed cannot tell place from time",
            Self::NothingStandsOut => {
                "nothing stands out at one wavelength over half of the speeds"
            }
        })
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.lines.is_empty() {
            match &self.none_because {
                Some(reason) => write!(f, "no lines locked to place: {reason}")?,
                None => write!(f, "no lines locked to place")?,
            }
        } else {
            write!(f, "{} line(s) locked to place:", self.lines.len())?;
            for line in &self.lines {
                let (low, high) = line.amplitude_range_m_s2;
                let (shown, all) = line.shown_at_speeds;
                write!(
                    f,
                    " {:.4} mm ({low:.3} to {high:.3} m/s², at {shown} of {all} speeds",
                    line.wavelength_mm
                )?;
                match line.harmonic_of {
                    Some((of, n)) => write!(f, ", harmonic {n} of line {})", of + 1)?,
                    None => write!(f, ")")?,
                }
            }
            if let Some(scatter) = self.speed_scatter {
                write!(
                    f,
                    "; the speeds are within {:.2} % of those listed",
                    100.0 * scatter
                )?;
            }
            if self.followed_trials > 0 {
                write!(
                    f,
                    "; changes of speed were followed in {} trial(s)",
                    self.followed_trials
                )?;
            }
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

/// A trial's share of its texture's lines.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialLines {
    /// The texture's lines. They are stored once for all of its trials, and not with each.
    #[serde(skip)]
    pub findings: Arc<Findings>,
    /// Amplitude of each line in the trial, m/s², without what noise adds to it; none where the trial cannot hold the
    /// line or was not looked at.
    pub amplitudes_m_s2: Vec<Option<f64>>,
    /// The trial's speed over the one listed, as the lines tell it.
    pub speed_ratio: Option<f64>,
}
