//! Lines along a free hand's strokes. There the position is known at each sample, so a line is a sine over the position
//! however the speed changes.
//!
//! Each piece of a stroke is resampled at even positions. In the result the lines stand where a trial at the piece's
//! mean speed has them, and are sought in all pieces as in trials. A hum is smeared by this, unless the hand was
//! steady. The lines are then fitted to the samples themselves in short windows, in which speed and force hardly
//! change, and subtracted with an amplitude that is linear between the windows' middles.

use std::f64::consts::TAU;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use rayon::prelude::*;

use super::findings::{Findings, Line, NoLines};
use super::peaks::tells_lines;
use super::search::{HIGHEST_HZ, LEAST_SPEED_RATIO, LOWEST_HZ};
use super::separate::{Followed, Known, measures, narrow, range_of, relative_phase, told_apart};
use super::track::{amplitudes, at_even_places, interpolated, wave_at};
use crate::dsp::fourier::Complex;
use crate::dsp::motion_law::LevelAt;
use crate::dsp::sums::mean;
use crate::recording::freehand::LEAST_SPEED_MM_S;

const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// Longest piece, s. In a longer one the errors of an encoder add up to more of a wavelength.
const PIECE_S: f64 = 2.0;

/// Least length of a window, s: within it a hand hardly changes its speed, and a line of 20 Hz has four periods.
const WINDOW_S: f64 = 0.2;

/// Distances from a line at which the noise around it is measured, in cells of a window.
const ASIDE_CELLS: [f64; 6] = [-4.0, -3.0, -2.0, 2.0, 3.0, 4.0];

/// Least level of a line relative to the noise in its window, as a power. It stands for a line that is not there.
const LEAST_OVER_NOISE: f64 = 0.1;

/// Least weight of a window's level.
const LEAST_WEIGHT: f64 = 1e-3;

/// Ratio of a line's power to that of noise in its window above which the window counts for the range of amplitudes.
const SHOWN_OVER_NOISE: f64 = 10.0;

/// A stretch of a stroke: its samples at 5 kHz, m/s², and the speed, mm/s, and force, N, at each.
pub(crate) struct Stretch<'s> {
    pub signal: &'s [f64],
    pub motion: &'s [(f64, f64)],
}

/// The lines along strokes.
pub(crate) struct Along {
    /// The lines, or the reason that there are none.
    pub findings: Findings,
    /// The level of each line's amplitude in each window, dB re 1 m/s².
    pub levels: Vec<Vec<LevelAt>>,
    /// The signals of the stretches without the lines, m/s².
    pub rest: Vec<Vec<f64>>,
}

/// Finds the lines of one texture along `stretches` and subtracts them. Each stretch moves in one direction.
pub(crate) fn along(stretches: &[Stretch<'_>]) -> Along {
    let mut rest: Vec<Vec<f64>> = stretches.iter().map(|own| own.signal.to_vec()).collect();
    let mut pieces: Vec<Piece<'_>> = (stretches.iter().zip(&mut rest))
        .flat_map(|(stretch, rest)| Piece::of_stretch(stretch, rest))
        .collect();
    let (findings, levels) = separate(&mut pieces);
    Along { findings, levels, rest }
}

/// Finds the lines and subtracts them. Returns them with their levels in the windows.
fn separate(pieces: &mut [Piece<'_>]) -> (Findings, Vec<Vec<LevelAt>>) {
    let none = |time_locked_hz, reason| {
        let findings = Findings {
            time_locked_hz,
            none_because: Some(reason),
            ..Findings::default()
        };
        (findings, Vec::new())
    };
    let speeds_mm_s: Vec<f64> = pieces.iter().map(|piece| piece.speed_mm_s).collect();
    let Some((slowest, fastest)) = (speeds_mm_s.iter().copied())
        .map(|speed| (speed, speed))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    else {
        return none(Vec::new(), NoLines::NothingSearched);
    };
    if fastest < LEAST_SPEED_RATIO * slowest {
        return none(Vec::new(), NoLines::OneSpeed);
    }
    let even: Vec<Vec<f64>> = pieces.par_iter().map(Piece::at_even_places).collect();
    let (known, time_locked_hz) = narrow(&speeds_mm_s, &even);
    if known.is_empty() {
        return none(time_locked_hz, NoLines::NothingStandsOut);
    }
    let measures = measures(&speeds_mm_s, &even, &known);
    let wavelengths_mm = &measures.wavelengths_mm;
    let windows: Vec<Vec<Window>> = (pieces.par_iter_mut().zip(&measures.speed_ratios))
        .map(|(piece, ratio)| piece.separate(ratio.unwrap_or(1.0), wavelengths_mm))
        .collect();
    let windows = windows.concat();
    let lines = (0..known.len()).map(|index| line_of(index, &known[index], wavelengths_mm[index], &windows));
    let findings = Findings {
        lines: lines.collect(),
        time_locked_hz,
        ..Findings::default()
    };
    let levels = |line: usize| windows.iter().filter_map(move |window| window.level(line)).collect();
    (findings, (0..known.len()).map(levels).collect())
}

/// Returns the line `index` of the `known` ones, as the `windows` show it.
fn line_of(index: usize, known: &Known, wavelength_mm: f64, windows: &[Window]) -> Line {
    let (phase_turns, phase_agreement) = known.harmonic_of.map_or((0.0, 1.0), |(of, number)| {
        let own = |window: &Window, line: usize| window.lines[line].map(|own| own.amplitude);
        let pairs = windows.iter().filter_map(|w| Some((own(w, of)?, own(w, index)?)));
        relative_phase(pairs, number)
    });
    let own = windows.iter().filter_map(|window| window.lines[index]);
    let shown = own.filter(|own| own.clean_power() > SHOWN_OVER_NOISE * own.noise);
    Line {
        wavelength_mm,
        phase_turns,
        harmonic_of: known.harmonic_of,
        phase_agreement,
        shown_at_speeds: known.found.speeds,
        amplitude_range_m_s2: range_of(shown.map(|own| own.clean_power().sqrt())),
        wander: None,
    }
}

/// A part of a stretch in which lines are sought.
struct Piece<'s> {
    /// Samples of the piece, m/s²; without the lines, once these are separated.
    signal: &'s mut [f64],
    motion: &'s [(f64, f64)],
    /// Position at each sample, mm.
    place_mm: Vec<f64>,
    /// Mean speed, mm/s.
    speed_mm_s: f64,
}

impl<'s> Piece<'s> {
    /// Returns the equal pieces of a `stretch` that are long enough. Their samples are those of `rest`.
    fn of_stretch(stretch: &Stretch<'s>, rest: &'s mut [f64]) -> Vec<Self> {
        let count = rest.len().div_ceil((PIECE_S * RATE_HZ) as usize).max(1);
        let length = rest.len().div_ceil(count).max(1);
        let parts = rest.chunks_mut(length).zip(stretch.motion.chunks(length));
        let pieces = parts.filter(|(signal, _)| tells_lines(signal));
        pieces.map(|(signal, motion)| Self::of(signal, motion)).collect()
    }

    fn of(signal: &'s mut [f64], motion: &'s [(f64, f64)]) -> Self {
        let mut at_mm = 0.0;
        let place_mm: Vec<f64> = (motion.iter())
            .map(|(speed, _)| {
                // Positions ascend, also where the hand comes to rest.
                at_mm += speed.max(LEAST_SPEED_MM_S) / RATE_HZ;
                at_mm
            })
            .collect();
        Self {
            speed_mm_s: at_mm / motion.len() as f64 * RATE_HZ,
            signal,
            motion,
            place_mm,
        }
    }

    /// Returns the samples at as many even positions.
    fn at_even_places(&self) -> Vec<f64> {
        let first = self.place_mm[0];
        let places: Vec<f64> = self.place_mm.iter().map(|place| place - first).collect();
        let last = places.len() - 1;
        at_even_places(self.signal, &places, places[last] / last as f64)
    }

    /// Subtracts the lines. `ratio` is that of the actual speed to the recorded one. Returns what the windows hold of
    /// the lines.
    fn separate(&mut self, ratio: f64, wavelengths_mm: &[f64]) -> Vec<Window> {
        self.place_mm.iter_mut().for_each(|place| *place *= ratio);
        let held = told_apart(ratio * self.speed_mm_s, self.signal.len(), wavelengths_mm);
        let held_mm: Vec<f64> = held.iter().map(|&line| wavelengths_mm[line]).collect();
        let whole = std::slice::from_ref(&(0..self.signal.len())).to_vec();
        let place_mm = std::mem::take(&mut self.place_mm);
        self.place_mm = Followed::of(self.signal, &whole, place_mm, &held_mm).place_mm;
        let count = (self.signal.len() / (WINDOW_S * RATE_HZ) as usize).max(1);
        let border = |window: usize| window * self.signal.len() / count;
        let windows: Vec<Window> = (0..count)
            .map(|window| self.window(border(window)..border(window + 1), wavelengths_mm))
            .collect();
        let middles: Vec<f64> = (0..count).map(|n| 0.5 * (border(n) + border(n + 1)) as f64).collect();
        for (line, wavelength_mm) in wavelengths_mm.iter().enumerate() {
            let subtracted = windows.iter().map(|window| {
                window.lines[line].map_or(Complex::default(), |own| own.amplitude * own.subtracted_share())
            });
            let (re, im): (Vec<f64>, Vec<f64>) = subtracted.map(|amplitude| (amplitude.re, amplitude.im)).unzip();
            let waves = wave_at(&self.place_mm, *wavelength_mm);
            for (n, (x, wave)) in self.signal.iter_mut().zip(waves).enumerate() {
                let at = (n as f64).clamp(middles[0], middles[count - 1]);
                let amplitude = Complex::new(interpolated(&middles, &re, at), interpolated(&middles, &im, at));
                *x -= (amplitude * wave).re;
            }
        }
        windows
    }

    /// Fits the lines to the samples in `range`.
    fn window(&self, range: Range<usize>, wavelengths_mm: &[f64]) -> Window {
        let (signal, place_mm) = (&self.signal[range.clone()], &self.place_mm[range.clone()]);
        let (speeds, forces): (Vec<f64>, Vec<f64>) = self.motion[range].iter().copied().unzip();
        let moved_mm = place_mm[place_mm.len() - 1] - place_mm[0];
        let own_mm_s = moved_mm / (place_mm.len() - 1).max(1) as f64 * RATE_HZ;
        let held = told_apart(own_mm_s, signal.len(), wavelengths_mm);
        let held = held
            .into_iter()
            .filter(|&line| own_mm_s > LOWEST_HZ * wavelengths_mm[line]);
        let held: Vec<usize> = held.collect();
        let waves: Vec<_> = held
            .iter()
            .map(|&line| wave_at(place_mm, wavelengths_mm[line]))
            .collect();
        let fit = amplitudes(signal, std::slice::from_ref(&(0..signal.len())), &waves);
        let mut rest = signal.to_vec();
        for (amplitude, wave) in fit.iter().zip(&waves) {
            super::track::subtract(&mut rest, *amplitude, wave);
        }
        let mut lines = vec![None; wavelengths_mm.len()];
        for ((&line, amplitude), wave) in held.iter().zip(&fit).zip(&waves) {
            lines[line] = Some(InWindow {
                amplitude: *amplitude,
                noise: noise_beside(&rest, wave, own_mm_s / wavelengths_mm[line]),
            });
        }
        Window {
            speed_mm_s: mean(&speeds).max(LEAST_SPEED_MM_S),
            force_n: mean(&forces),
            lines,
        }
    }
}

/// Returns the mean squared amplitude, (m/s²)², of what is beside the line with this `wave`, at about `frequency_hz`,
/// in the `rest` of a window.
fn noise_beside(rest: &[f64], wave: &[Complex<f64>], frequency_hz: f64) -> f64 {
    let cell_hz = RATE_HZ / rest.len() as f64;
    let inside = |cells: &&f64| (LOWEST_HZ..HIGHEST_HZ).contains(&(frequency_hz + **cells * cell_hz));
    let beside = ASIDE_CELLS.iter().filter(inside).map(|cells| {
        let step = Complex::cis(-TAU * cells / rest.len() as f64);
        let mut turn = Complex::new(1.0, 0.0);
        let terms = rest.iter().zip(wave).map(|(x, wave)| {
            turn *= step;
            *x * wave.conj() * turn
        });
        (2.0 / rest.len() as f64 * terms.sum::<Complex<f64>>()).norm_sqr()
    });
    mean(&beside.collect::<Vec<_>>()).max(f64::MIN_POSITIVE)
}

/// What a window holds of one line.
#[derive(Clone, Copy)]
struct InWindow {
    /// Complex amplitude, m/s².
    amplitude: Complex<f64>,
    /// Mean squared amplitude of noise, (m/s²)².
    noise: f64,
}

impl InWindow {
    /// Squared amplitude without the contribution of noise, (m/s²)².
    fn clean_power(&self) -> f64 {
        (self.amplitude.norm_sqr() - self.noise).max(LEAST_OVER_NOISE * self.noise)
    }

    /// Share of the amplitude that is subtracted. As much stays as noise would have there.
    fn subtracted_share(&self) -> f64 {
        1.0 - (self.noise / self.amplitude.norm_sqr().max(f64::MIN_POSITIVE))
            .sqrt()
            .min(1.0)
    }
}

/// What is known of the lines in a window.
#[derive(Clone)]
struct Window {
    speed_mm_s: f64,
    force_n: f64,
    /// Each line; `None` where the window cannot hold it.
    lines: Vec<Option<InWindow>>,
}

impl Window {
    /// Returns the level of `line`. A window weighs more the clearer it shows the line.
    fn level(&self, line: usize) -> Option<LevelAt> {
        let own = self.lines[line]?;
        let clean = own.clean_power();
        Some(LevelAt {
            speed_mm_s: self.speed_mm_s,
            force_n: self.force_n,
            level_db: 10.0 * clean.log10(),
            weight: (clean / (clean + own.noise)).powi(2).max(LEAST_WEIGHT),
        })
    }
}
