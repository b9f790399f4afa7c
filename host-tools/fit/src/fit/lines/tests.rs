//! The separation on simulated surfaces: what it finds, with what certainty, and what it must not find.

use std::f64::consts::TAU;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use stylus_dsp::sums::rms;
use stylus_signals::recording::Trial;

use super::findings::NoLines;
use super::{Findings, TrialLines, separate};
use crate::fit::blocks::Part;
use crate::fit::excitation::tests::{fitted_to, written};
use crate::fit::options::Options;
use test_helpers::{near, resonant};

const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;
const SAMPLES: usize = 10_000;
const SPEEDS_MM_S: [f64; 6] = [40.0, 70.0, 100.0, 150.0, 220.0, 300.0];

/// Noise of a tool's resonance. If `band_mm` is given, a band of noise at speed over wavelength is added, which moves
/// with the speed.
fn surface_noise(generator: &mut Pcg64, speed_mm_s: f64, band_mm: Option<f64>) -> Vec<f64> {
    let mut resonator = |hz: f64, radius: f64| {
        let excitation = StandardNormal.sample_iter(&mut *generator).take(SAMPLES + 2000);
        let excitation = excitation.map(|x: f64| x * (1.0 - radius * radius));
        resonant(excitation, TAU * hz / RATE_HZ, radius).split_off(2000)
    };
    let mut sum = resonator(300.0, 0.95);
    if let Some(band_mm) = band_mm {
        // A band of 4 % of its frequency.
        let hz = speed_mm_s / band_mm;
        let radius = (-std::f64::consts::PI * 0.04 * hz / RATE_HZ).exp();
        for (sum, x) in sum.iter_mut().zip(resonator(hz, radius)) {
            *sum += 20.0 * x;
        }
    }
    sum
}

fn add_line(signal: &mut [f64], hz: f64, amplitude: f64, phase: f64) {
    for (n, x) in signal.iter_mut().enumerate() {
        *x += amplitude * (TAU * (hz * n as f64 / RATE_HZ + phase).fract()).sin();
    }
}

fn surfaces(seed: u64, speeds: &[f64], band_mm: Option<f64>) -> (Pcg64, Vec<Vec<f64>>) {
    let mut generator = Pcg64::seed_from_u64(seed);
    let signals = speeds.iter().map(|v| surface_noise(&mut generator, *v, band_mm));
    let signals = signals.collect();
    (generator, signals)
}

/// Adds a line of this wavelength, mm, and amplitude to each signal, at random phases.
fn add_lines(generator: &mut Pcg64, signals: &mut [Vec<f64>], speeds: &[f64], wavelength_mm: f64, amplitude: f64) {
    for (signal, v) in signals.iter_mut().zip(speeds) {
        add_line(signal, v / wavelength_mm, amplitude, generator.random());
    }
}

/// RMS of each signal.
fn levels(signals: &[Vec<f64>]) -> Vec<f64> {
    signals.iter().map(|signal| rms(signal)).collect()
}

/// Checks that `signals` have their `plain` levels again, to within this fraction, and that each share has a first line
/// of `amplitude`, to within `tolerance`.
fn are_plain_again(
    (signals, plain, within): (&[Vec<f64>], &[f64], f64),
    (shares, amplitude, tolerance): (&[TrialLines], f64, f64),
) {
    for ((level, plain), share) in levels(signals).iter().zip(plain).zip(shares) {
        assert!((level / plain - 1.0).abs() < within, "{level} {plain} {share:?}");
        near(share.amplitudes_m_s2[0].unwrap(), amplitude, tolerance);
    }
}

fn found(speeds: &[f64], signals: &mut [Vec<f64>]) -> (Findings, Vec<TrialLines>) {
    let ranges = signals.iter().map(|own| Part::Whole.of(own.len()));
    let ranges: Vec<_> = ranges.collect();
    let separated = separate(speeds, signals.to_vec(), &ranges);
    signals.clone_from_slice(&separated.rest);
    (separated.findings, separated.shares)
}

/// Of 1000 surfaces of each kind, 0, 0 and 2 had a line. The test's level is 1e-3.
#[test]
fn surfaces_without_a_period_have_no_lines_even_if_bands_of_noise_move_with_the_speed() {
    for band_mm in [None, Some(0.5), Some(2.0)] {
        for seed in 0..8 {
            let (_, mut signals) = surfaces(seed, &SPEEDS_MM_S, band_mm);
            let (findings, _) = found(&SPEEDS_MM_S, &mut signals);
            assert!(findings.lines.is_empty(), "{band_mm:?} {seed}: {findings}");
        }
    }
}

/// Of 50 surfaces, all lines 10 dB below the total noise were found, 8 of those at 16 dB, and none at 18 dB.
#[test]
fn a_line_ten_decibels_below_the_noise_is_found() {
    for seed in 0..5 {
        let (mut generator, mut signals) = surfaces(seed, &SPEEDS_MM_S, None);
        for (signal, v) in signals.iter_mut().zip(SPEEDS_MM_S) {
            let amplitude = rms(signal) * (2.0f64 / 10.0).sqrt();
            add_line(signal, v / 0.7, amplitude, generator.random());
        }
        let (findings, _) = found(&SPEEDS_MM_S, &mut signals);
        let is_it = |line: &super::Line| (line.wavelength_mm / 0.7 - 1.0).abs() < 1e-3;
        assert!(findings.lines.iter().any(is_it), "{seed}: {findings}");
    }
}

#[test]
fn a_weave_is_found_with_its_harmonics_and_nothing_is_left_of_it() {
    let (mut generator, mut signals) = surfaces(7, &SPEEDS_MM_S, None);
    let plain = levels(&signals);
    for (signal, v) in signals.iter_mut().zip(SPEEDS_MM_S) {
        let start: f64 = generator.random();
        for (n, amplitude, phase) in [(1.0, 1.0, 0.0), (2.0, 0.5, 0.3), (3.0, 0.25, 0.8)] {
            add_line(signal, n * v / 0.85, amplitude, n * start + phase);
        }
    }
    let (findings, shares) = found(&SPEEDS_MM_S, &mut signals);
    assert_eq!(findings.lines.len(), 3);
    for (line, n, phase) in [(0, 1.0, 0.0), (1, 2.0, 0.3), (2, 3.0, 0.8)] {
        let line = &findings.lines[line];
        near(line.wavelength_mm * n / 0.85, 1.0, 1e-4);
        assert!((line.phase_turns - phase).abs() < 0.02, "{line:?}");
    }
    are_plain_again((&signals, &plain, 0.01), (&shares, 1.0, 0.05));
}

#[test]
fn at_one_speed_a_steady_band_is_a_line_of_time() {
    let speeds = [100.0, 100.0];
    let (mut generator, mut signals) = surfaces(3, &speeds, None);
    let plain = levels(&signals);
    for signal in &mut signals {
        // A resonance that stick-slip drives: its phase wanders by 1.2 rad, with a correlation time of 40 ms.
        let wander = gaussian_process(&mut generator, 1.2, 4.0);
        for (n, x) in signal.iter_mut().enumerate() {
            let time_s = n as f64 / RATE_HZ;
            *x += (TAU * 117.0 * time_s + wander(100.0 * time_s)).sin();
        }
    }
    let (findings, shares) = found(&speeds, &mut signals);
    assert_eq!(findings.lines.len(), 1, "{findings}");
    assert!((findings.lines[0].wavelength_mm * 117.0 / 100.0 - 1.0).abs() < 0.01);
    assert_eq!(findings.wanders[0].clock_mm_s, 100.0);
    are_plain_again((&signals, &plain, 0.05), (&shares, 1.0, 0.05));
}

/// The highest frequency is 2200 Hz. A band's peak may lie below it and the frequency of its phase above.
#[test]
fn a_steady_band_at_the_highest_frequency_adds_nothing_and_is_no_fault() {
    for step in 0..24 {
        let speeds = [100.0, 100.0];
        let (mut generator, mut signals) = surfaces(step, &speeds, None);
        for signal in &mut signals {
            let wander = gaussian_process(&mut generator, 1.2, 4.0);
            for (n, x) in signal.iter_mut().enumerate() {
                let time_s = n as f64 / RATE_HZ;
                *x += (TAU * (2194.0 + 0.5 * step as f64) * time_s + wander(100.0 * time_s)).sin();
            }
        }
        let before = levels(&signals);
        found(&speeds, &mut signals);
        for (before, rest) in before.iter().zip(levels(&signals)) {
            assert!(rest < 1.01 * before, "{step}: {before}, {rest}");
        }
    }
}

/// A Gaussian process of RMS `rms` and correlation length `length`: a sum of cosines whose wave numbers are drawn from
/// its spectrum.
fn gaussian_process(generator: &mut Pcg64, rms: f64, length: f64) -> impl Fn(f64) -> f64 + use<> {
    const TERMS: usize = 200;
    let terms: Vec<(f64, f64)> = (0..TERMS)
        .map(|_| {
            let number: f64 = StandardNormal.sample(generator);
            (number / length, TAU * generator.random::<f64>())
        })
        .collect();
    move |x| {
        let sum: f64 = terms.iter().map(|(q, phase)| (q * x + phase).cos()).sum();
        rms * (2.0 / TERMS as f64).sqrt() * sum
    }
}

/// Adds a weave of 0.7 mm and its second harmonic to trials over one surface, whose threads wander.
fn add_weave(generator: &mut Pcg64, signals: &mut [Vec<f64>], amplitude: f64, rms_rad: f64, length_mm: f64) {
    let wander = gaussian_process(generator, rms_rad, length_mm);
    for (signal, v) in signals.iter_mut().zip(SPEEDS_MM_S) {
        let start_mm = 500.0 * generator.random::<f64>();
        for (n, x) in signal.iter_mut().enumerate() {
            let place_mm = start_mm + v * n as f64 / RATE_HZ;
            let phase = TAU * place_mm / 0.7 + wander(place_mm);
            *x += amplitude * (phase.sin() + 0.4 * (2.0 * phase + 1.0).sin());
        }
    }
}

/// Of 20 surfaces with a line as strong as the noise, all lines were found at 1.5 rad over 1.5 to 6 mm. Of lines 5 dB
/// weaker, 10, 20 and 20 were found over 1.5, 3 and 6 mm. At 3 rad over 1.5 mm the line is as wide as its frequency,
/// and 1 was found.
#[test]
fn a_weave_of_uneven_threads_is_found_with_its_wander_its_harmonic_and_its_amplitude() {
    for (seed, rms_rad, length_mm) in [(1, 1.5, 3.0), (2, 1.5, 6.0), (3, 2.5, 8.0), (4, 0.8, 2.0)] {
        let (mut generator, mut signals) = surfaces(seed, &SPEEDS_MM_S, None);
        let plain = levels(&signals);
        let amplitude = 3.0 * plain[0];
        add_weave(&mut generator, &mut signals, amplitude, rms_rad, length_mm);
        let (findings, shares) = found(&SPEEDS_MM_S, &mut signals);
        let numbers: Vec<_> = findings.lines.iter().map(|l| l.harmonic_of).collect();
        assert_eq!(numbers, [None, Some((0, 2))], "{findings}");
        near(findings.lines[0].wavelength_mm / 0.7, 1.0, 0.01);
        assert!((findings.lines[1].phase_turns - 1.0 / TAU).abs() < 0.03);
        let wander = findings.wanders[0];
        let off = |found: f64, right: f64| (found / right - 1.0).abs();
        let worst = |values: &dyn Fn(usize) -> f64| (0..plain.len()).map(values).fold(0.0, f64::max);
        let amplitude_of = |at: usize, line: usize| shares[at].amplitudes_m_s2[line].unwrap();
        let errors = [
            off(TAU * f64::from(wander.rms_mm) / 0.7, rms_rad),
            off(f64::from(wander.correlation_mm), length_mm),
            worst(&|at| off(rms(&signals[at]), plain[at])),
            worst(&|at| off(amplitude_of(at, 0), amplitude)),
            worst(&|at| off(amplitude_of(at, 1), 0.4 * amplitude)),
        ];
        let bounds = [0.2, 0.2, 0.1, 0.05, 0.2];
        for (error, bound) in errors.iter().zip(bounds) {
            assert!(*error < bound, "{rms_rad} rad, {length_mm} mm: {errors:.3?}");
        }
    }
}

/// Checks that the search reports what stays at `frequency_hz` and leaves it in `signals`.
fn named_and_left(signals: &mut [Vec<f64>], frequency_hz: f64, tolerance_hz: f64) {
    let before = signals.to_vec();
    let (findings, _) = found(&SPEEDS_MM_S, signals);
    assert!(findings.lines.is_empty(), "{findings}");
    let is_near = |hz: &f64| (hz - frequency_hz).abs() < tolerance_hz;
    assert!(findings.time_locked_hz.iter().any(is_near), "{findings}");
    assert_eq!(signals, before);
}

#[test]
fn a_steady_band_that_stays_while_the_speed_changes_is_named_and_left_in_the_noise() {
    let (mut generator, mut signals) = surfaces(17, &SPEEDS_MM_S, None);
    let wander = gaussian_process(&mut generator, 1.5, 0.03);
    for signal in &mut signals {
        for (n, x) in signal.iter_mut().enumerate() {
            let time_s = n as f64 / RATE_HZ;
            *x += (TAU * 90.0 * time_s + wander(time_s)).sin();
        }
    }
    named_and_left(&mut signals, 90.0, 5.0);
}

#[test]
fn what_stays_while_the_speed_changes_is_not_taken() {
    let (mut generator, mut signals) = surfaces(11, &SPEEDS_MM_S, None);
    for signal in &mut signals {
        for (n, amplitude) in [(1.0, 2.0), (2.0, 0.6), (3.0, 1.0), (6.0, 0.3)] {
            add_line(signal, n * 50.0, amplitude, generator.random());
        }
    }
    named_and_left(&mut signals, 50.0, 0.1);
}

#[test]
fn a_line_at_one_speed_alone_is_not_taken() {
    let (_, mut signals) = surfaces(12, &SPEEDS_MM_S, None);
    add_line(&mut signals[3], 213.0, 5.0, 0.0);
    let (findings, _) = found(&SPEEDS_MM_S, &mut signals);
    assert!(findings.lines.is_empty(), "{findings}");
}

#[test]
fn two_lines_a_percent_apart_are_two_lines() {
    let (mut generator, mut signals) = surfaces(13, &SPEEDS_MM_S, None);
    for wavelength in [0.5, 0.505] {
        add_lines(&mut generator, &mut signals, &SPEEDS_MM_S, wavelength, 2.0);
    }
    let (findings, shares) = found(&SPEEDS_MM_S, &mut signals);
    assert_eq!(findings.lines.len(), 2, "{findings}");
    for (line, wavelength) in findings.lines.iter().zip([0.505, 0.5]) {
        near(line.wavelength_mm / wavelength, 1.0, 5e-4);
        assert!(line.harmonic_of.is_none());
    }
    // The trials that are long enough to separate the lines by about four cells or more.
    for share in &shares[2..] {
        for amplitude in &share.amplitudes_m_s2 {
            assert!((amplitude.unwrap() / 2.0 - 1.0).abs() < 0.1, "{share:?}");
        }
    }
}

#[test]
fn speeds_that_are_all_wrong_by_one_factor_keep_their_lines_and_a_single_wrong_one_loses_only_its_own() {
    let (mut generator, mut signals) = surfaces(14, &SPEEDS_MM_S, None);
    add_lines(&mut generator, &mut signals, &SPEEDS_MM_S, 0.8, 1.0);
    let tenfold: Vec<f64> = SPEEDS_MM_S.iter().map(|v| 10.0 * v).collect();
    let (findings, _) = found(&tenfold, &mut signals.clone());
    near(findings.lines[0].wavelength_mm / 8.0, 1.0, 1e-4);
    let mut one_wrong = SPEEDS_MM_S;
    one_wrong[2] = 1000.0;
    let (findings, shares) = found(&one_wrong, &mut signals);
    near(findings.lines[0].wavelength_mm / 0.8, 1.0, 1e-4);
    assert_eq!(findings.lines[0].shown_at_speeds.0, 5);
    assert!(shares[2].amplitudes_m_s2[0].is_none_or(|a| a < 0.2), "{:?}", shares[2]);
}

#[test]
fn a_line_is_followed_through_a_speed_that_wanders() {
    let (mut generator, mut signals) = surfaces(15, &SPEEDS_MM_S, None);
    let plain = levels(&signals);
    for (signal, v) in signals.iter_mut().zip(SPEEDS_MM_S) {
        let (start, slow): (f64, f64) = (generator.random(), generator.random());
        for (n, x) in signal.iter_mut().enumerate() {
            let time_s = n as f64 / RATE_HZ;
            // A deviation of 0.3 % of the speed, once in 1.25 s.
            let wander = 0.003 * v / (TAU * 0.8) * (TAU * (0.8 * time_s + slow)).sin();
            let place = v * time_s + wander;
            *x += 3.0 * (TAU * (place / 0.6 + start)).sin();
            *x += 1.5 * (TAU * (2.0 * (place / 0.6 + start) + 0.4)).sin();
        }
    }
    let (findings, shares) = found(&SPEEDS_MM_S, &mut signals);
    assert_eq!(findings.lines.len(), 2, "{findings}");
    near(findings.lines[0].wavelength_mm / 0.6, 1.0, 1e-3);
    assert!(findings.followed_trials >= 3, "{findings}");
    are_plain_again((&signals, &plain, 0.05), (&shares, 3.0, 0.18));
}

/// Twelve trials at four nominal speeds, each measured within 6 % of its nominal one. There is one weave, which the
/// nominal speeds miss.
#[test]
fn measured_speeds_keep_a_weave_that_nominal_ones_lose() {
    let nominal: Vec<f64> = (0..12).map(|n| [40.0, 60.0, 90.0, 135.0][n / 3]).collect();
    let mut generator = Pcg64::seed_from_u64(29);
    let measured: Vec<f64> = nominal
        .iter()
        .map(|v| v * (1.0 + 0.12 * (generator.random::<f64>() - 0.5)))
        .collect();
    let (_, mut signals) = surfaces(30, &measured, None);
    add_lines(&mut generator, &mut signals, &measured, 0.8, 1.0);
    let (by_nominal, _) = found(&nominal, &mut signals.clone());
    let (by_measured, _) = found(&measured, &mut signals);
    assert_eq!(by_measured.lines.len(), 1, "{by_measured}");
    near(by_measured.lines[0].wavelength_mm / 0.8, 1.0, 1e-3);
    let is_whole = |f: &Findings| f.lines.len() == 1 && f.lines[0].shown_at_speeds.0 == f.lines[0].shown_at_speeds.1;
    assert!(is_whole(&by_measured), "{by_nominal}");
    assert!(!is_whole(&by_nominal), "{by_nominal}");
}

#[test]
fn speeds_known_to_a_percent_alone_are_told_by_the_line() {
    let (mut generator, mut signals) = surfaces(16, &SPEEDS_MM_S, None);
    let errors: Vec<f64> = SPEEDS_MM_S
        .iter()
        .map(|_| 0.02 * generator.random::<f64>() - 0.01)
        .collect();
    for ((signal, v), error) in signals.iter_mut().zip(SPEEDS_MM_S).zip(&errors) {
        add_line(signal, v * (1.0 + error) / 0.4, 4.0, generator.random());
    }
    let (findings, shares) = found(&SPEEDS_MM_S, &mut signals);
    assert_eq!(findings.lines.len(), 1, "{findings}");
    near(findings.lines[0].wavelength_mm / 0.4, 1.0, 0.01);
    assert!(findings.speed_scatter.unwrap() > 1e-3);
    let base = shares[0].speed_ratio.unwrap() / (1.0 + errors[0]);
    for (share, error) in shares.iter().zip(&errors) {
        assert!((share.speed_ratio.unwrap() / (1.0 + error) / base - 1.0).abs() < 1e-3);
    }
}

#[test]
fn silence_constants_and_trials_too_short_have_no_lines() {
    for samples in [0, 1, 3, 999, 1000, 1001] {
        for value in [0.0, 1.0, f64::MIN_POSITIVE] {
            let mut signals = vec![vec![value; samples]; 3];
            let (findings, _) = found(&[50.0, 100.0, 200.0], &mut signals);
            assert!(findings.lines.is_empty(), "{samples} of {value}: {findings}");
        }
    }
    assert!(separate(&[], Vec::new(), &[]).shares.is_empty());
}

/// Trials at two speeds of a surface with a line, in which the tool is at rest in these parts, s.
fn with_rests(folder: &std::path::Path, rests: &[Range<f64>]) -> Vec<Trial> {
    let speeds = [90.0, 45.0];
    let (_, mut signals) = surfaces(11, &speeds, None);
    let trials = signals.iter_mut().zip(speeds).map(|(signal, speed)| {
        let amplitude = rms(signal);
        add_line(signal, speed / 0.85, amplitude, 0.2);
        for (n, x) in signal.iter_mut().enumerate() {
            let time_s = n as f64 / RATE_HZ;
            let is_at_rest = rests.iter().any(|rest| rest.contains(&time_s));
            *x *= if is_at_rest { 1e-4 } else { 1.0 };
        }
        written(folder, &speed.to_string(), std::slice::from_ref(signal), speed, 1.0)
    });
    trials.collect()
}

#[test]
fn a_line_is_found_in_trials_that_begin_pause_or_end_at_rest_and_taken_out_of_all_stretches() {
    let folder = tempfile::tempdir().unwrap();
    let of_rests = |rests: &[Range<f64>]| {
        let (mut fit, _) = fitted_to(with_rests(folder.path(), rests), &Options::default());
        (fit.textures.remove(0), fit.trials[0].cut_s)
    };
    let (whole, _) = of_rests(&[]);
    for rests in [&[0.0..0.4, 1.6..2.0][..], &[0.9..1.1]] {
        let (texture, cut_s) = of_rests(rests);
        assert!(cut_s > 0.15);
        let [line] = &texture.lines.lines[..] else {
            panic!("{rests:?}: {}", texture.lines);
        };
        near(line.wavelength_mm / 0.85, 1.0, 2e-3);
        assert_eq!(line.shown_at_speeds, (2, 2));
        for (model, own) in texture.grid.models.iter().zip(&whole.grid.models) {
            // With the line, half of the power would be in the models.
            near(model.output_power / own.output_power, 1.0, 0.15);
        }
    }
}

#[test]
fn the_reason_for_having_no_lines_is_the_one_that_holds() {
    let because = |speeds: &[f64], signals: &[Vec<f64>]| found(speeds, &mut signals.to_vec()).0.none_because;
    let (_, signals) = surfaces(4, &[50.0, 100.0, 200.0], None);
    let noise = Some(NoLines::NothingStandsOut);
    assert_eq!(because(&[50.0, 100.0, 200.0], &signals), noise);
    assert_eq!(because(&[100.0; 3], &signals), Some(NoLines::OneSpeed));
    let short: Vec<Vec<f64>> = signals.iter().map(|own| own[..900].to_vec()).collect();
    for unsearched in [&short[..], &vec![vec![0.0; SAMPLES]; 3], &[]] {
        assert_eq!(
            because(&[50.0, 100.0, 200.0][..unsearched.len()], unsearched),
            Some(NoLines::NothingSearched)
        );
    }
    // All at one speed but one, which is too short to be searched.
    let mixed = [signals[0].clone(), signals[1].clone(), short[2].clone()];
    assert_eq!(because(&[50.0, 50.0, 200.0], &mixed), Some(NoLines::OneSpeed));
}
