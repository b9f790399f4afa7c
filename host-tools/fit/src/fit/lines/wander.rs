//! Lines that wander: the search over a texture's trials, the position that a line's own phase gives in a trial, and
//! the wander's RMS and correlation length.

use std::ops::Range;

use model_format::{SAMPLE_RATE_HZ, Wander, limits};
use nalgebra::DVector;
use rayon::prelude::*;
use stylus_dsp::fourier::Complex;
use stylus_dsp::sums::{range_of, upper_median, variance};
use stylus_dsp::wide;

use super::bands::{Band, WholeSpectrum};
use super::peaks::{HIGHEST_HZ, LOWEST_HZ};
use super::search::{AtSpeed, HARMONICS, LEVEL, by_speed};
use super::track::{solved, wave, without_straight_line};

/// Natural logarithm of the probability below which a band suggests a hypothesis.
const LN_HYPOTHESIS_CHANCE: f64 = -9.0;

/// Natural logarithm of the probability below which a speed shows a line, corrected for its trials and bands.
const LN_SHOWN_CHANCE: f64 = -4.6;

/// Natural logarithm of the probability below which a trial's band is followed, once its texture has the line.
const LN_FOLLOWED_CHANCE: f64 = -4.6;

/// Least ratio of the fastest to the slowest speed at which a line shows. It is large because a band is wide.
const LEAST_SPEED_RATIO: f64 = 1.2;

/// Largest relative change of a constant frequency between quarters of a recording.
const HELD_WITHIN: f64 = 0.05;

/// Least ratio of a harmonic's amplitude to the strongest harmonic's, each in the trial where it is loudest. What is 40
/// dB below the strongest is not felt.
const LEAST_AMPLITUDE: f64 = 0.01;

/// Range of the correlation lengths that are tried, mm, and their number. The lags are the same.
const LENGTHS_MM: [f64; 2] = [0.2, 50.0];
const LENGTHS: usize = 80;

/// What a line is tied to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Carrier {
    /// Position: wavelength, mm.
    Place(f64),
    /// Time: frequency, Hz.
    Time(f64),
}

/// One trial as the search sees it.
struct BandedTrial {
    index: usize,
    speed_mm_s: f64,
    spectrum: WholeSpectrum,
    bands: Vec<Band>,
}

/// A line with harmonics that wanders.
pub(super) struct Weave {
    /// Wavelength of the fundamental, mm.
    pub wavelength_mm: f64,
    pub wander: Wander,
    /// Numbers of the harmonics that show, ascending. Each has the number of speeds that show it, and of those at which
    /// it could be seen.
    pub harmonics: Vec<(u32, (usize, usize))>,
    /// Course of each trial in which the line was followed.
    pub courses: Vec<Option<Course>>,
}

/// The line and its harmonics in one trial.
pub(super) struct Course {
    /// Position at each sample, mm, with its wander.
    pub place_mm: Vec<f64>,
    /// Factor of the line at each sample: 1, or less where its band holds less than two thirds of it. There noise
    /// cancels the line, the phase jumps, and all of the line with that phase would be noise in other bands. With no
    /// more than what the band holds, the remainder would be steadier than noise.
    pub held: Vec<f64>,
    /// Number of the harmonic whose phase gives the position.
    reference: u32,
    /// Complex amplitude of each harmonic, m/s², from the first on.
    amplitudes: Vec<Complex<f64>>,
    /// Mean square of what else is in each harmonic's band, in the units of a squared amplitude, (m/s²)².
    noises: Vec<f64>,
    /// Number of independent values in each harmonic's band.
    counts: Vec<f64>,
}

impl BandedTrial {
    fn of(index: usize, speed_mm_s: f64, signal: &[f64]) -> Option<Self> {
        let spectrum = WholeSpectrum::of(signal)?;
        let mut bands = spectrum.bands();
        bands.retain(|band| band.ln_chance < 0.0);
        Some(Self {
            index,
            speed_mm_s,
            spectrum,
            bands,
        })
    }

    fn frequency_hz(&self, carrier: Carrier) -> f64 {
        match carrier {
            Carrier::Place(wavelength_mm) => self.speed_mm_s / wavelength_mm,
            Carrier::Time(frequency_hz) => frequency_hz,
        }
    }

    /// Returns the steadiest band around `frequency_hz`, and its log probability, corrected for the number of bands
    /// there.
    fn band_at(&self, frequency_hz: f64) -> Option<(Band, f64)> {
        let near = || {
            self.bands
                .iter()
                .filter(|band| 2.0 * (band.frequency_hz - frequency_hz).abs() <= band.width_hz())
        };
        let band = near().min_by(|a, b| a.ln_chance.total_cmp(&b.ln_chance))?;
        Some((*band, band.ln_chance + (near().count() as f64).ln()))
    }

    /// Returns the band at `frequency_hz` in which a line that other trials show is followed, if it is steady: one that
    /// shows by itself, or else one of these widths.
    fn followed(&self, frequency_hz: f64) -> Option<Band> {
        /// Half of a band's width, relative to its frequency.
        const HALF_WIDTHS: [f64; 3] = [0.1, 0.2, 0.3];
        let own = self.band_at(frequency_hz);
        let around = || {
            let bands = HALF_WIDTHS.map(|half| {
                let edges_hz = [1.0 - half, 1.0 + half].map(|ratio| ratio * frequency_hz);
                self.spectrum.band(frequency_hz, edges_hz)
            });
            let band = bands.into_iter().min_by(|a, b| a.ln_chance.total_cmp(&b.ln_chance))?;
            Some((band, band.ln_chance + (HALF_WIDTHS.len() as f64).ln()))
        };
        let is_steady = |(_, ln_chance): &(Band, f64)| *ln_chance < LN_FOLLOWED_CHANCE;
        let steady = own.filter(is_steady).or_else(|| around().filter(is_steady));
        steady.map(|(band, _)| band)
    }
}

/// Returns the number of speeds that show a line and the number of all `speeds`, if the first is at least `least` and
/// at least half of all.
fn shown(speeds: &[AtSpeed<()>], least: usize) -> Option<(usize, usize)> {
    let count = shows(speeds).count();
    (count >= least && 2 * count >= speeds.len()).then_some((count, speeds.len()))
}

fn shows(speeds: &[AtSpeed<()>]) -> impl Iterator<Item = &AtSpeed<()>> {
    speeds.iter().filter(|at| at.ln_chance() < LN_SHOWN_CHANCE)
}

/// The search over the trials of one texture.
struct Search {
    heard: Vec<BandedTrial>,
    is_one_speed: bool,
    /// Logarithm of the number of hypotheses.
    ln_hypotheses: f64,
}

impl Search {
    /// Returns minus the logarithm of the joint probability at the speeds that show `carrier`, corrected for the choice
    /// among speeds and hypotheses. `None` if this is not significant, or if these speeds are too few or too close
    /// together.
    fn evidence(&self, carrier: Carrier) -> Option<f64> {
        let chances = self.heard.iter().filter_map(|heard| {
            let hz = heard.frequency_hz(carrier);
            let ln_chance = || heard.band_at(hz).map_or(0.0, |(_, ln_chance)| ln_chance);
            let is_seen = (LOWEST_HZ..=HIGHEST_HZ).contains(&hz);
            is_seen.then(|| (heard.speed_mm_s, Some(((), ln_chance()))))
        });
        let speeds = by_speed(chances);
        shown(&speeds, if self.is_one_speed { 1 } else { 2 })?;
        let (slowest, fastest) = range_of(shows(&speeds).map(|at| at.speed_mm_s));
        let tells_place = fastest >= LEAST_SPEED_RATIO * slowest;
        if matches!(carrier, Carrier::Place(_)) && !tells_place {
            return None;
        }
        // Correction: the speeds that show the line were chosen among all of them.
        let evidence = -shows(&speeds).map(AtSpeed::ln_chance).sum::<f64>()
            - speeds.len() as f64 * std::f64::consts::LN_2
            - self.ln_hypotheses;
        (evidence > -LEVEL.ln()).then_some(evidence)
    }

    /// Returns the carrier with the most evidence, or, if it may be a harmonic of a longer wavelength (lower frequency)
    /// that is acceptable too, that one. Harmonics of a line at `known_mm` are excluded.
    fn best(&self, known_mm: &[f64]) -> Option<Carrier> {
        let strong = |heard: &BandedTrial| {
            let speed = heard.speed_mm_s;
            let bands = heard.bands.iter().filter(|b| b.ln_chance < LN_HYPOTHESIS_CHANCE);
            let hz: Vec<f64> = bands.map(|band| band.frequency_hz).collect();
            hz.into_iter().flat_map(move |hz| {
                let place = (speed > 0.0).then_some(Carrier::Place(speed / hz));
                [place, Some(Carrier::Time(hz))].into_iter().flatten()
            })
        };
        let is_new = |carrier: &Carrier| match carrier {
            Carrier::Place(mm) => known_mm.iter().all(|known| {
                let ratio = known / mm;
                (ratio / ratio.round().max(1.0) - 1.0).abs() > 0.02
            }),
            Carrier::Time(_) => true,
        };
        let hypotheses: Vec<Carrier> = self.heard.iter().flat_map(strong).filter(is_new).collect();
        let judged = hypotheses.into_par_iter();
        let judged = judged.filter_map(|carrier| Some((carrier, self.evidence(carrier)?)));
        let (best, _) = judged.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let longer = |n: u32| match best {
            Carrier::Place(mm) => Carrier::Place(f64::from(n) * mm),
            Carrier::Time(hz) => Carrier::Time(hz / f64::from(n)),
        };
        let fundamental = (2..=4).rev().map(longer);
        let fundamental = fundamental.filter(is_new);
        let mut acceptable = fundamental.filter(|&carrier| self.evidence(carrier).is_some());
        Some(acceptable.next().unwrap_or(best))
    }
}

/// Finds the line in `signals` with the most evidence that has a steady amplitude and irregular spacing (wander) and is
/// no harmonic of a line at `known_mm`. Amplitudes are measured within `ranges`.
///
/// Recordings at one speed cannot distinguish position from time. A line of constant frequency is therefore returned
/// too, with the speed at which it was recorded.
///
/// # Errors
/// The frequency of a steady band that stays the same while the speed changes, Hz; `None` if there is no such band and
/// no line.
pub(super) fn find(
    speeds_mm_s: &[f64],
    signals: &[Vec<f64>],
    ranges: &[Vec<Range<usize>>],
    is_one_speed: bool,
    known_mm: &[f64],
) -> Result<Weave, Option<f64>> {
    let pairs: Vec<_> = speeds_mm_s.iter().zip(signals).enumerate().collect();
    let heard: Vec<BandedTrial> = pairs
        .into_par_iter()
        .filter(|(_, (speed, _))| **speed > 0.0)
        .filter_map(|(index, (speed, signal))| BandedTrial::of(index, *speed, signal))
        .collect();
    let bands: usize = heard.iter().map(|heard| heard.bands.len()).sum();
    let search = Search {
        heard,
        is_one_speed,
        ln_hypotheses: (2.0 * bands.max(1) as f64).ln(),
    };
    let carrier = search.best(known_mm).ok_or(None)?;
    let clock_mm_s = match carrier {
        Carrier::Place(_) => 0.0,
        Carrier::Time(hz) if !is_one_speed => return Err(Some(hz)),
        Carrier::Time(_) => search.heard[0].speed_mm_s,
    };
    let (courses, wavelength_mm) = courses(&search.heard, carrier, signals, ranges).ok_or(None)?;
    let harmonics = harmonics(&courses, speeds_mm_s, if is_one_speed { 1 } else { 2 });
    let paths = courses.iter().flatten().map(|course| &course.place_mm[..]);
    let paths: Vec<&[f64]> = paths.collect();
    let (rms_mm, correlation_mm) = wander_of(&paths, wavelength_mm).ok_or(None)?;
    if harmonics.is_empty() {
        return Err(None);
    }
    Ok(Weave {
        wavelength_mm,
        wander: Wander {
            rms_mm: rms_mm.min(f64::from(limits::MAX_WANDER_SLOPE) * correlation_mm) as f32,
            correlation_mm: correlation_mm as f32,
            clock_mm_s: clock_mm_s as f32,
        },
        harmonics,
        courses,
    })
}

/// Returns the course of each trial that follows `carrier`, and the wavelength of its fundamental, mm: the median over
/// these trials. `None` if no trial follows it.
fn courses(
    heard: &[BandedTrial],
    carrier: Carrier,
    signals: &[Vec<f64>],
    ranges: &[Vec<Range<usize>>],
) -> Option<(Vec<Option<Course>>, f64)> {
    let course = |heard: &BandedTrial| {
        let (signal, ranges) = (&signals[heard.index], &ranges[heard.index]);
        let (course, wavelength_mm) = course_of(heard, carrier, signal, ranges)?;
        Some((heard.index, course, wavelength_mm))
    };
    let followed: Vec<(usize, Course, f64)> = heard.par_iter().filter_map(course).collect();
    let wavelengths: Vec<f64> = followed.iter().map(|(.., mm)| *mm).collect();
    let wavelength_mm = upper_median(&wavelengths)?;
    let mut courses: Vec<Option<Course>> = signals.iter().map(|_| None).collect();
    for (index, mut course, own_mm) in followed {
        // Each course was measured in wavelengths of its own trial.
        let scale = wavelength_mm / own_mm;
        course.place_mm.iter_mut().for_each(|place| *place *= scale);
        courses[index] = Some(course);
    }
    Some((courses, wavelength_mm))
}

/// Returns the harmonics that at least `least` speeds show, ascending. Each has the number of speeds that show it, and
/// of those at which it could be seen.
fn harmonics(courses: &[Option<Course>], speeds_mm_s: &[f64], least: usize) -> Vec<(u32, (usize, usize))> {
    let loudest = |harmonic: u32| {
        let told = courses.iter().flatten();
        told.filter_map(|course| Some(course.amplitude(harmonic)?.1))
            .fold(0.0, f64::max)
    };
    let least_amplitude = LEAST_AMPLITUDE * (1..=HARMONICS).map(loudest).fold(0.0, f64::max);
    (1..=HARMONICS)
        .filter(|&harmonic| loudest(harmonic) >= least_amplitude)
        .filter_map(|harmonic| {
            let told = courses.iter().zip(speeds_mm_s);
            let chances =
                told.filter_map(|(course, speed)| Some((*speed, Some(((), course.as_ref()?.ln_chance(harmonic)?)))));
            Some((harmonic, shown(&by_speed(chances), least)?))
        })
        .collect()
}

/// Returns the course of a trial, and the wavelength of its fundamental, mm. The position comes from the steady band at
/// one of the first four harmonics of `carrier`; of these bands, the one that leaves the most power in step with its
/// position is used, because a phase that slips leaves little. `None` if no band is steady, or if a carrier of constant
/// frequency does not hold it.
fn course_of(heard: &BandedTrial, carrier: Carrier, signal: &[f64], ranges: &[Range<usize>]) -> Option<(Course, f64)> {
    let bands = (1..=4).filter_map(|harmonic| {
        let hz = f64::from(harmonic) * heard.frequency_hz(carrier);
        let band = (LOWEST_HZ..=HIGHEST_HZ).contains(&hz).then(|| heard.followed(hz))?;
        Some((harmonic, band?))
    });
    let told = bands.map(|(reference, band)| {
        let turns = heard.spectrum.envelope(band.edges_hz).turns(signal.len());
        let of_fundamental = |turns: f64| turns / f64::from(reference);
        let turns: Vec<f64> = turns.into_iter().map(of_fundamental).collect();
        let wave = wave(turns.iter().copied());
        LineFundamental {
            reference,
            band,
            turns,
            in_step: in_step(signal, ranges, &wave),
            wave,
        }
    });
    let is_of_time = matches!(carrier, Carrier::Time(_));
    let told = told.filter(|told| !is_of_time || holds(&told.turns));
    // Each harmonic is measured independently of the others.
    let power = |told: &LineFundamental| told.in_step.iter().map(Complex::norm_sqr).sum::<f64>();
    let told = told.max_by(|a, b| power(a).total_cmp(&power(b)))?;
    Some(course_by(heard, &told, signal, ranges))
}

/// The fundamental of a line, derived from a band at one of its harmonics.
struct LineFundamental {
    /// Number of the harmonic.
    reference: u32,
    band: Band,
    /// Phase of the fundamental at each sample, turns.
    turns: Vec<f64>,
    /// The fundamental's wave.
    wave: Vec<Complex<f64>>,
    /// Sums of the signal in step with each harmonic.
    in_step: [Complex<f64>; HARMONICS as usize],
}

/// Number of samples that are processed side by side.
const LANES: usize = 4;

/// Returns Σ x(n) w(n)⁻ᵏ over the `ranges` of the signal x, for a fundamental of this `wave` w and k = 1 ... N.
fn in_step<const N: usize>(signal: &[f64], ranges: &[Range<usize>], wave: &[Complex<f64>]) -> [Complex<f64>; N] {
    let mut sums = [[Complex::<f64>::default(); LANES]; N];
    wide(
        #[inline(always)]
        || {
            for range in ranges {
                let samples = signal[range.clone()].chunks(LANES);
                let waves = wave[range.clone()].chunks(LANES);
                for (samples, waves) in samples.zip(waves) {
                    // Lanes beyond the last samples of a range stay zero.
                    let mut turned = [Complex::default(); LANES];
                    let mut steps = [Complex::default(); LANES];
                    for (lane, (sample, wave)) in samples.iter().zip(waves).enumerate() {
                        (turned[lane], steps[lane]) = (Complex::from(*sample), wave.conj());
                    }
                    for sums in &mut sums {
                        for lane in 0..LANES {
                            turned[lane] *= steps[lane];
                            sums[lane] += turned[lane];
                        }
                    }
                }
            }
        },
    );
    sums.map(|sums| sums.into_iter().sum())
}

/// Returns the complex amplitude of each of `count` harmonics of a fundamental. Products of their waves are waves too,
/// so that few sums give all of the normal equations.
fn amplitudes_of(told: &LineFundamental, count: usize, ranges: &[Range<usize>]) -> Vec<Complex<f64>> {
    let ones = vec![1.0; told.wave.len()];
    let powers: [_; 2 * HARMONICS as usize] = in_step(&ones, ranges, &told.wave);
    let samples: usize = ranges.iter().map(ExactSizeIterator::len).sum();
    let power = |k: usize| {
        k.checked_sub(1)
            .map_or(Complex::from(samples as f64), |at| powers[at].conj())
    };
    let product = |i: usize, j: usize| {
        let (sum, difference) = (power(i / 2 + j / 2 + 2), power(i / 2 - j / 2));
        0.5 * match (i % 2, j % 2) {
            (0, 0) => difference.re + sum.re,
            (0, _) => difference.im - sum.im,
            (_, 0) => -difference.im - sum.im,
            _ => difference.re - sum.re,
        }
    };
    let right = told.in_step[..count].iter().flat_map(|sum| [sum.re, sum.im]);
    solved(ones.len(), product, &DVector::from_iterator(2 * count, right))
}

/// Returns whether the frequency is nearly the same in all quarters of a recording.
fn holds(turns: &[f64]) -> bool {
    let quarters = turns.chunks_exact((turns.len() / 4).max(1)).take(4);
    let (low, high) = range_of(quarters.map(|part| part[part.len() - 1] - part[0]));
    high < (1.0 + HELD_WITHIN) * low
}

/// Returns the course of a trial from its line's fundamental `told`, and the fundamental's wavelength, mm.
fn course_by(heard: &BandedTrial, told: &LineFundamental, signal: &[f64], ranges: &[Range<usize>]) -> (Course, f64) {
    let LineFundamental {
        reference, band, turns, ..
    } = told;
    let reference = *reference;
    let times: Vec<f64> = (0..turns.len()).map(|n| n as f64).collect();
    let straight = without_straight_line(&times, turns);
    let last = turns.len() - 1;
    let per_sample = ((turns[last] - straight[last]) - (turns[0] - straight[0])) / last as f64;
    // The listed speed is taken to be right on average; the phase's deviations from it are wander.
    let speed = heard.speed_mm_s / f64::from(SAMPLE_RATE_HZ);
    let wavelength_mm = speed / per_sample;
    let hz = per_sample * f64::from(SAMPLE_RATE_HZ);
    let count = ((HIGHEST_HZ / hz) as u32).min(HARMONICS);
    let amplitudes = amplitudes_of(told, count as usize, ranges);
    // A line whose measured frequency is just beyond the highest has no amplitude, and nothing of it is subtracted.
    let loudest = amplitudes
        .get(reference as usize - 1)
        .map_or(0.0, |a| a.norm_sqr().sqrt());
    let magnitudes = heard.spectrum.envelope(band.edges_hz).magnitudes(signal.len());
    let seconds = signal.len() as f64 / f64::from(SAMPLE_RATE_HZ);
    let half_hz = 0.5 * band.width_hz() / f64::from(reference);
    let (mut noises, mut counts) = (Vec::new(), Vec::new());
    for (n, amplitude) in (1..=count).map(f64::from).zip(&amplitudes) {
        let edges = [n * hz - n * half_hz, n * hz + n * half_hz];
        let envelope = heard.spectrum.envelope(edges);
        let is_fitted = |at: f64| ranges.iter().any(|range| range.contains(&(at as usize)));
        let values = envelope.middle().filter(|(at, _)| is_fitted(*at));
        let (sum, lengths, values) = values.fold((0.0, 0.0, 0.0), |(sum, lengths, values), (_, z)| {
            // The values are far from the limits of a double's range; the norm's own method would take ten times as
            // long.
            let power = z.norm_sqr();
            (sum + power, lengths + power.sqrt(), values + 1.0)
        });
        let mean_square = sum / f64::max(values, 1.0);
        noises.push(if n == f64::from(reference) {
            // The position follows this harmonic's phase, and so the noise at right angles to it. Only half of the
            // noise shows.
            2.0 * (mean_square - (lengths / f64::max(values, 1.0)).powi(2)).max(0.0)
        } else {
            (mean_square - amplitude.norm_sqr()).max(0.0)
        });
        // Independent values: bandwidth times duration.
        counts.push((2.0 * n * half_hz * seconds).max(2.0));
    }
    let course = Course {
        place_mm: turns.iter().map(|turns| turns * wavelength_mm).collect(),
        held: magnitudes
            .iter()
            .map(|magnitude| (magnitude / (loudest / 1.5).max(f64::MIN_POSITIVE)).min(1.0))
            .collect(),
        reference,
        amplitudes,
        noises,
        counts,
    };
    (course, wavelength_mm)
}

impl Course {
    /// Returns the logarithm of the probability that noise in the band of `harmonic` has so much of its power in step
    /// with the position; `None` if the trial cannot hold the harmonic.
    fn ln_chance(&self, harmonic: u32) -> Option<f64> {
        let at = harmonic as usize - 1;
        let power = self.amplitudes.get(at)?.norm_sqr();
        let rest = self.noises[at] / (power + self.noises[at]).max(f64::MIN_POSITIVE);
        // For independent complex values. The reference is in step by construction; its envelope was tested instead.
        Some(if harmonic == self.reference {
            f64::NEG_INFINITY
        } else {
            (self.counts[at] - 1.0) * rest.max(f64::MIN_POSITIVE).ln()
        })
    }

    /// Returns the fitted complex amplitude of `harmonic`, its magnitude without the contribution of noise, and the
    /// fraction of the fitted amplitude that stays in the signal, so that the remainder has no hole in its noise.
    /// `None` if the trial cannot hold the harmonic.
    pub(super) fn amplitude(&self, harmonic: u32) -> Option<(Complex<f64>, f64, f64)> {
        let at = harmonic as usize - 1;
        let amplitude = *self.amplitudes.get(at)?;
        let fitted = amplitude.norm_sqr().max(f64::MIN_POSITIVE);
        let share = if harmonic == self.reference {
            0.5
        } else {
            self.counts[at].recip()
        };
        let noise = (share * self.noises[at] / fitted).min(1.0);
        Some((amplitude, (fitted * (1.0 - noise)).sqrt(), noise.sqrt()))
    }
}

/// Returns the RMS σ and the correlation length ℓ of the wander of these `paths` about straight courses, mm: those
/// whose structure function 2 σ² (1 - exp(-Δ² / 2ℓ²)) has the least relative errors.
fn wander_of(paths: &[&[f64]], wavelength_mm: f64) -> Option<(f64, f64)> {
    let [shortest, longest] = LENGTHS_MM;
    let step = (longest / shortest).ln() / (LENGTHS - 1) as f64;
    let lengths: Vec<f64> = (0..LENGTHS).map(|n| shortest * (step * n as f64).exp()).collect();
    let functions: Vec<Vec<Option<f64>>> = paths
        .par_iter()
        .map(|path| {
            // A lag is a distance. At a nearly even speed it corresponds to a number of samples, which needs no search.
            let per_sample = (path[path.len() - 1] - path[0]) / (path.len() - 1) as f64;
            let of_lag = |lag_mm: &f64| {
                let lag = (lag_mm / per_sample).round() as usize;
                let is_held = lag >= 1 && lag <= path.len() / 3 && *lag_mm > 0.3 * wavelength_mm;
                is_held.then(|| {
                    let ways = path.iter().zip(&path[lag..]).map(|(a, b)| b - a);
                    variance(&ways.collect::<Vec<f64>>())
                })
            };
            lengths.iter().map(of_lag).collect()
        })
        .collect();
    let points: Vec<(f64, f64)> = lengths
        .iter()
        .enumerate()
        .filter_map(|(at, lag_mm)| {
            let values: Vec<f64> = functions.iter().filter_map(|f| f[at]).collect();
            // More than half of the trials must reach this lag, because the few longest paths would have another mean.
            let is_known = 2 * values.len() > functions.len();
            let middle = upper_median(&values).filter(|_| is_known)?;
            Some((*lag_mm, middle.max(f64::MIN_POSITIVE)))
        })
        .collect();
    // For each length the best power has a closed form, so that only lengths are searched.
    let fits = lengths.iter().map(|length_mm| {
        let shape = |lag_mm: f64| 2.0 * (1.0 - (-0.5 * (lag_mm / length_mm).powi(2)).exp());
        let ratios = || points.iter().map(|(lag, value)| shape(*lag) / value);
        let (sum, squares) = ratios().fold((0.0, 0.0), |(a, b), r| (a + r, b + r * r));
        let power = sum / f64::max(squares, f64::MIN_POSITIVE);
        let error: f64 = ratios().map(|r| (1.0 - power * r).powi(2)).sum();
        (error, power.sqrt(), *length_mm)
    });
    let (_, rms_mm, length_mm) = fits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (points.len() > 4 && rms_mm > 0.0).then_some((rms_mm, length_mm))
}
