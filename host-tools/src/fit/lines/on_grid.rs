//! Lines of trials as a part of a texture: an amplitude for each node.

use model_format::limits::{MAX_LINE_AMPLITUDE, MAX_WAVELENGTH_MM, MIN_WAVELENGTH_MM};
use model_format::{LineSpec, LinesSpec};

use crate::texture::grid::Grid;

use super::findings::TrialLines;

/// A trial of a grid, as far as its lines need it.
pub struct LineMember<'a> {
    /// Speed of its node, mm/s.
    pub speed_mm_s: f64,
    /// Force of its node, N.
    pub force_n: f64,
    /// True if the trial was found silent.
    pub is_silent: bool,
    /// Its share of the texture's lines.
    pub lines: &'a TrialLines,
}

/// Lines with an amplitude per node of `grid`, from the trials that made it; `None` if there are no lines.
///
/// A node that no trial tells of, because none was recorded or because the line is above the frequencies that can be
/// recorded there, has what lies between its neighbours of the same force, or the nearest of them, or that of the
/// nearest force. Above those frequencies the device fades a line out by itself.
pub fn lines_on(grid: &Grid, members: &[LineMember<'_>]) -> Option<LinesSpec> {
    let findings = &members.first()?.lines.findings;
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
            })
        })
        .collect();
    (!lines.is_empty()).then_some(LinesSpec { lines })
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
