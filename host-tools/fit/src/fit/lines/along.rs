//! Lines along a free hand's strokes. There the position is known at each sample, so a line is a sine over the position
//! however the speed changes.
//!
//! Each piece of a stroke is freed of its level's dependence on the motion, and resampled at even positions. There the
//! lines stand where a trial at the piece's mean speed has them, and are sought in all pieces as in trials: narrow
//! ones, and one that wanders. A hum is smeared by this, unless the hand was steady.
//!
//! The lines are then fitted to the samples themselves in short windows, in which speed and force hardly change, and
//! subtracted with an amplitude that is linear between the windows' middles.

use std::f64::consts::TAU;
use std::ops::Range;

use model_format::{SAMPLE_RATE_HZ, limits};
use rayon::prelude::*;
use stylus_dsp::fourier::Complex;
use stylus_dsp::motion_law::{LevelAt, MotionLaw};
use stylus_dsp::sums::{mean, range_of, rms};
use stylus_signals::recording::freehand::{LEAST_FORCE_N, LEAST_SPEED_MM_S};

use super::findings::{Findings, Line, NoLines};
use super::peaks::{HIGHEST_HZ, LOWEST_HZ, tells_lines};
use super::search::LEAST_SPEED_RATIO;
use super::separate::{Followed, Known, Measures, WANDERING_OVER_NARROW, measures, narrow, relative_phase, told_apart};
use super::track::{amplitudes, at_even_places, interpolated, subtract, wave_at};
use super::wander::{Weave, find};

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
    let pieces: Vec<Piece<'_>> = (stretches.iter().enumerate())
        .flat_map(|(index, stretch)| Piece::of_stretch(index, stretch))
        .collect();
    let (findings, separated) = match sought(&pieces) {
        Ok(found) => found,
        Err(findings) => (findings, Vec::new()),
    };
    let mut rest: Vec<Vec<f64>> = stretches.iter().map(|own| own.signal.to_vec()).collect();
    for (piece, own) in pieces.iter().zip(&separated) {
        rest[piece.stretch][piece.range.clone()].copy_from_slice(&own.rest);
    }
    let windows = || separated.iter().flat_map(|own| &own.windows);
    let levels = |line: usize| windows().filter_map(move |window| window.level(line)).collect();
    Along {
        levels: (0..findings.lines.len()).map(levels).collect(),
        findings,
        rest,
    }
}

/// Returns the lines along `pieces`, and each piece without them.
///
/// # Errors
/// The findings that give the reason for having no lines.
fn sought(pieces: &[Piece<'_>]) -> Result<(Findings, Vec<Separated>), Findings> {
    let none = |time_locked_hz, reason| Findings {
        time_locked_hz,
        none_because: Some(reason),
        ..Findings::default()
    };
    let speeds_mm_s: Vec<f64> = pieces.iter().map(|piece| piece.speed_mm_s).collect();
    let (slowest, fastest) = range_of(speeds_mm_s.iter().copied());
    if pieces.is_empty() {
        return Err(none(Vec::new(), NoLines::NothingSearched));
    }
    if fastest < LEAST_SPEED_RATIO * slowest {
        return Err(none(Vec::new(), NoLines::OneSpeed));
    }
    let windows: Vec<LevelAt> = pieces.iter().flat_map(Piece::levels).collect();
    let Some(law) = MotionLaw::of(&windows) else {
        return Err(none(Vec::new(), NoLines::NothingSearched));
    };
    let even: Vec<Vec<f64>> = pieces
        .par_iter()
        .map(|piece| piece.levelled_at_even_places(&law))
        .collect();
    let (known, mut time_locked_hz) = narrow(&speeds_mm_s, &even);
    let narrow = (!known.is_empty()).then(|| with_narrow(pieces, &even, &known, &speeds_mm_s));
    let ranges: Vec<_> = even
        .iter()
        .map(|even| std::iter::once(0..even.len()).collect())
        .collect();
    let wandering = find(&speeds_mm_s, &even, &ranges, false, &[]);
    let wandering = wandering.map(|weave| with_weave(pieces, &weave));
    time_locked_hz.extend(wandering.as_ref().err().copied().flatten());
    // A narrow line holds only a part of a line that wanders.
    let least = narrow
        .as_ref()
        .map_or(0.0, |(_, own)| WANDERING_OVER_NARROW * power(own));
    let wandering = wandering.ok().filter(|(_, own)| power(own) > least);
    let Some((mut findings, separated)) = wandering.or(narrow) else {
        return Err(none(time_locked_hz, NoLines::NothingStandsOut));
    };
    findings.time_locked_hz = time_locked_hz;
    Ok((findings, separated))
}

/// Power of all lines in all windows: the sum of their squared amplitudes, (m/s²)².
fn power(separated: &[Separated]) -> f64 {
    let windows = separated.iter().flat_map(|own| &own.windows);
    let lines = windows.flat_map(|window| window.lines.iter().flatten());
    lines.map(InWindow::clean_power).sum()
}

/// Separates the `known` narrow lines, which were found in the `even` samples of `pieces`.
fn with_narrow(
    pieces: &[Piece<'_>],
    even: &[Vec<f64>],
    known: &[Known],
    speeds_mm_s: &[f64],
) -> (Findings, Vec<Separated>) {
    let Measures {
        wavelengths_mm,
        speed_ratios,
        ..
    } = measures(speeds_mm_s, even, known);
    let separated: Vec<Separated> = (pieces.par_iter().zip(&speed_ratios))
        .map(|(piece, ratio)| {
            let ratio = ratio.unwrap_or(1.0);
            let place_mm = piece.place_mm.iter().map(|place| ratio * place).collect();
            let held = told_apart(ratio * piece.speed_mm_s, piece.signal.len(), &wavelengths_mm);
            let held_mm: Vec<f64> = held.into_iter().map(|line| wavelengths_mm[line]).collect();
            let whole = 0..piece.signal.len();
            let followed = Followed::of(piece.signal, std::slice::from_ref(&whole), place_mm, &held_mm);
            piece.separated(&followed.place_mm, &wavelengths_mm)
        })
        .collect();
    let lines = known.iter().enumerate().map(|(index, line)| Line {
        wavelength_mm: wavelengths_mm[index],
        harmonic_of: line.harmonic_of,
        shown_at_speeds: line.found.speeds,
        ..as_shown(index, line.harmonic_of, &separated)
    });
    let findings = Findings {
        lines: lines.collect(),
        ..Findings::default()
    };
    (findings, separated)
}

/// Separates a line that wanders, with its harmonics. A piece in which it was not followed stays as it is.
fn with_weave(pieces: &[Piece<'_>], weave: &Weave) -> (Findings, Vec<Separated>) {
    let of_number = |&(number, _): &(u32, _)| weave.wavelength_mm / f64::from(number);
    let wavelengths_mm: Vec<f64> = weave.harmonics.iter().take(limits::MAX_LINES).map(of_number).collect();
    let separated: Vec<Separated> = (pieces.par_iter().zip(&weave.courses))
        .map(|(piece, course)| match course {
            Some(course) => piece.separated(&piece.at_samples(&course.place_mm), &wavelengths_mm),
            None => Separated {
                windows: Vec::new(),
                rest: piece.signal.to_vec(),
            },
        })
        .collect();
    let lines = (weave.harmonics.iter().zip(&wavelengths_mm).enumerate()).map(|(index, (harmonic, wavelength_mm))| {
        let harmonic_of = (index > 0 && weave.harmonics[0].0 == 1).then_some((0, harmonic.0));
        Line {
            wavelength_mm: *wavelength_mm,
            harmonic_of,
            shown_at_speeds: harmonic.1,
            wander: Some(0),
            ..as_shown(index, harmonic_of, &separated)
        }
    });
    let findings = Findings {
        lines: lines.collect(),
        wanders: vec![weave.wander],
        ..Findings::default()
    };
    (findings, separated)
}

/// Returns the phase and the amplitudes of line `index`, of which it is a harmonic, as the windows show them.
fn as_shown(index: usize, harmonic_of: Option<(usize, u32)>, separated: &[Separated]) -> Line {
    let windows = || separated.iter().flat_map(|own| &own.windows);
    let (phase_turns, phase_agreement) = harmonic_of.map_or((0.0, 1.0), |(of, number)| {
        let own = |window: &Window, line: usize| window.lines[line].map(|own| own.amplitude);
        relative_phase(windows().filter_map(|w| Some((own(w, of)?, own(w, index)?))), number)
    });
    let own = windows().filter_map(|window| window.lines[index]);
    let shown = own.filter(|own| own.clean_power() > SHOWN_OVER_NOISE * own.noise);
    Line {
        wavelength_mm: 0.0,
        phase_turns,
        harmonic_of,
        phase_agreement,
        shown_at_speeds: (0, 0),
        amplitude_range_m_s2: range_of(shown.map(|own| own.clean_power().sqrt())),
        wander: None,
    }
}

/// A part of a stretch in which lines are sought.
struct Piece<'s> {
    /// Index of the stretch.
    stretch: usize,
    /// Samples of the stretch that are the piece's.
    range: Range<usize>,
    signal: &'s [f64],
    motion: &'s [(f64, f64)],
    /// Position at each sample, mm, from 0 on.
    place_mm: Vec<f64>,
    /// Mean speed, mm/s.
    speed_mm_s: f64,
}

/// A piece without the lines.
struct Separated {
    windows: Vec<Window>,
    /// The samples without the lines, m/s².
    rest: Vec<f64>,
}

impl<'s> Piece<'s> {
    /// Returns the equal pieces of a `stretch` that are long enough.
    fn of_stretch(index: usize, stretch: &Stretch<'s>) -> Vec<Self> {
        let samples = stretch.signal.len();
        let count = samples.div_ceil((PIECE_S * RATE_HZ) as usize).max(1);
        let border = |piece: usize| piece * samples / count;
        let ranges = (0..count).map(|piece| border(piece)..border(piece + 1));
        let pieces = ranges.filter(|range| tells_lines(&stretch.signal[range.clone()]));
        pieces.map(|range| Self::of(index, stretch, range)).collect()
    }

    fn of(index: usize, stretch: &Stretch<'s>, range: Range<usize>) -> Self {
        let motion = &stretch.motion[range.clone()];
        let mut at_mm = 0.0;
        let mut place_mm = Vec::with_capacity(motion.len());
        for (speed, _) in motion {
            place_mm.push(at_mm);
            // Positions ascend, also where the hand comes to rest.
            at_mm += speed.max(LEAST_SPEED_MM_S) / RATE_HZ;
        }
        Self {
            stretch: index,
            signal: &stretch.signal[range.clone()],
            range,
            motion,
            speed_mm_s: at_mm / motion.len() as f64 * RATE_HZ,
            place_mm,
        }
    }

    /// Distance of even positions, mm.
    fn step_mm(&self) -> f64 {
        let last = self.place_mm.len() - 1;
        self.place_mm[last] / last as f64
    }

    /// Returns the motion at sample `n`: speed, mm/s, and force, N, both above zero.
    fn motion_at(&self, n: usize) -> (f64, f64) {
        let (speed, force) = self.motion[n];
        (speed.max(LEAST_SPEED_MM_S), force.max(LEAST_FORCE_N))
    }

    /// Returns the level of the samples in windows, dB re 1 m/s².
    fn levels(&self) -> Vec<LevelAt> {
        let windows = self.signal.chunks_exact((WINDOW_S * RATE_HZ) as usize).enumerate();
        let level = |(index, own): (usize, &[f64])| {
            let (speed_mm_s, force_n) = self.motion_at(index * own.len() + own.len() / 2);
            let level_db = 20.0 * rms(own).log10();
            level_db.is_finite().then_some(LevelAt {
                speed_mm_s,
                force_n,
                level_db,
                weight: 1.0,
            })
        };
        windows.filter_map(level).collect()
    }

    /// Returns the samples at as many even positions, without the dependence of their level on the motion. A line that
    /// grows with the speed would otherwise be wider than it is, and a steady one look like noise.
    fn levelled_at_even_places(&self, law: &MotionLaw) -> Vec<f64> {
        let levelled = self.signal.iter().enumerate().map(|(n, x)| {
            let (speed, force) = self.motion_at(n);
            x * 10f64.powf(-law.level_db(speed, force) / 20.0)
        });
        at_even_places(&levelled.collect::<Vec<_>>(), &self.place_mm, self.step_mm())
    }

    /// Returns the values at the piece's own samples of what is given at the even positions.
    fn at_samples(&self, at_even: &[f64]) -> Vec<f64> {
        let last = at_even.len() - 1;
        let value = |place: &f64| {
            let at = place / self.step_mm();
            let before = (at as usize).min(last - 1);
            at_even[before] + (at - before as f64) * (at_even[before + 1] - at_even[before])
        };
        self.place_mm.iter().map(value).collect()
    }

    /// Separates the lines, with the position `place_mm` at each sample.
    fn separated(&self, place_mm: &[f64], wavelengths_mm: &[f64]) -> Separated {
        let count = (self.signal.len() / (WINDOW_S * RATE_HZ) as usize).max(1);
        let border = |window: usize| window * self.signal.len() / count;
        let windows: Vec<Window> = (0..count)
            .map(|window| self.window(border(window)..border(window + 1), place_mm, wavelengths_mm))
            .collect();
        let middles: Vec<f64> = (0..count).map(|n| 0.5 * (border(n) + border(n + 1)) as f64).collect();
        let mut rest = self.signal.to_vec();
        for (line, wavelength_mm) in wavelengths_mm.iter().enumerate() {
            let subtracted = windows.iter().map(|window| {
                window.lines[line].map_or(Complex::default(), |own| own.amplitude * own.subtracted_share())
            });
            let (re, im): (Vec<f64>, Vec<f64>) = subtracted.map(|amplitude| (amplitude.re, amplitude.im)).unzip();
            let waves = wave_at(place_mm, *wavelength_mm);
            for (n, (x, wave)) in rest.iter_mut().zip(waves).enumerate() {
                let at = (n as f64).clamp(middles[0], middles[count - 1]);
                let amplitude = Complex::new(interpolated(&middles, &re, at), interpolated(&middles, &im, at));
                *x -= (amplitude * wave).re;
            }
        }
        Separated { windows, rest }
    }

    /// Fits the lines to the samples in `range`.
    fn window(&self, range: Range<usize>, place_mm: &[f64], wavelengths_mm: &[f64]) -> Window {
        let (signal, place_mm) = (&self.signal[range.clone()], &place_mm[range.clone()]);
        let (speeds, forces): (Vec<f64>, Vec<f64>) = range.map(|n| self.motion_at(n)).unzip();
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
            subtract(&mut rest, *amplitude, wave);
        }
        let mut lines = vec![None; wavelengths_mm.len()];
        for ((&line, amplitude), wave) in held.iter().zip(&fit).zip(&waves) {
            lines[line] = Some(InWindow {
                amplitude: *amplitude,
                noise: noise_beside(&rest, wave, own_mm_s / wavelengths_mm[line]),
            });
        }
        Window {
            speed_mm_s: mean(&speeds),
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
