//! Properties of the whole choice of an excitation, from recordings to the parts of a texture.

use std::path::Path;

use model_format::{Library, MillimetresPerSecond, Newton, NodeSpec, SAMPLE_RATE_HZ, limits};
use proptest::prelude::*;
use stylus_dsp::autocorrelation::Autocorrelation;
use stylus_dsp::linear_prediction::{Prediction, corrected};
use stylus_dsp::model::Model;
use stylus_dsp::sums::mean_square;
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::render;
use stylus_signals::recording::{RecordingSet, Trial, resample};
use stylus_support::float_wav::float_wav;

use super::evidence::Evidence;
use super::texture::{Axes, Choice, Chosen};
use super::trace::Trace;
use crate::fit::excitation::texture::ExcitationReport;
use crate::fit::options::{ExcitationChoice, Options, Order};
use crate::fit::trial::Signal;
use crate::fit::{Fit, fit};
use crate::scene::with_scenes;
use crate::texture::grid::Grid;
use crate::texture::quantise::nodes;
use test_helpers::{near, noise, resonant};

/// Returns `excitation` filtered to the power spectrum of a surface, with an RMS of 1: two resonances, one of them
/// narrow.
pub(super) fn filtered(excitation: &[f64], hz: f64) -> Vec<f64> {
    let angle = std::f64::consts::TAU * hz / f64::from(SAMPLE_RATE_HZ);
    let signal = resonant(resonant(excitation.iter().copied(), angle, 0.9), 3.0 * angle, 0.98);
    let rms = mean_square(&signal).sqrt();
    signal.iter().map(|x| x / rms).collect()
}

/// Returns heavy-tailed noise with a steady level: the product of a Gaussian and its magnitude.
pub(super) fn impulsive(seed: u64, samples: usize) -> Vec<f64> {
    noise(seed, samples).iter().map(|x| x * x.abs()).collect()
}

/// Returns Gaussian noise whose level goes up and down by `depth_db` every 1.5 s.
pub(super) fn swelling(seed: u64, samples: usize, depth_db: f64) -> Vec<f64> {
    let level = |n: usize| {
        let angle = std::f64::consts::TAU * n as f64 / 7500.0;
        10f64.powf(depth_db / 20.0 * angle.sin())
    };
    noise(seed, samples)
        .iter()
        .enumerate()
        .map(|(n, x)| x * level(n))
        .collect()
}

/// Returns noise with louder bursts that have a spectrum of their own.
pub(super) fn bursting(seed: u64, samples: usize) -> Vec<f64> {
    let (calm, lively) = (noise(seed, samples), noise(!seed, samples));
    let is_burst = |n: usize| n % 1103 < 300 || n % 1777 < 250;
    let sample = |n: usize| match n {
        1.. if is_burst(n) => 3.0 * (lively[n] + 0.9 * lively[n - 1]),
        _ => calm[n],
    };
    (0..samples).map(sample).collect()
}

pub(super) fn trace(samples: &[f64], order: usize) -> Trace {
    trace_of_rate(samples, order, 5000.0)
}

/// Returns the node of a texture that was recorded once.
pub(super) fn node_of(samples: &[f64], order: usize) -> NodeSpec {
    let lags = corrected(Autocorrelation::of(samples, order).lags);
    let model = Model::new(Prediction::levinson_durbin(&lags, order).reflection, lags[0]);
    let grid = Grid::new(vec![100.0], vec![1.0], vec![model]);
    nodes("test", &grid).unwrap().remove(0)
}

fn trace_of_rate(samples: &[f64], order: usize, source_rate_hz: f64) -> Trace {
    trace_of_one(samples, order, source_rate_hz, 1)
}

/// Returns the trace of one of the `trials` of a texture.
fn trace_of_one(samples: &[f64], order: usize, source_rate_hz: f64, trials: usize) -> Trace {
    let node = node_of(samples, order);
    let signal = Signal {
        samples: samples.to_vec(),
        source_rate_hz,
        cut_hz: None,
        flaws: Vec::new(),
        direction: Vec::new(),
        stretches: Vec::new(),
    };
    Trace::of(&signal, (0, 0), &node.codes, &[], trials).unwrap()
}

/// Returns the choice for a grid of these speeds and forces.
fn choice<'a>(speeds_mm_s: &'a [f32], forces_n: &'a [f32], options: &'a Options) -> Choice<'a> {
    Choice {
        name: "test",
        axes: Axes { speeds_mm_s, forces_n },
        options,
        room: limits::MAX_LIBRARY_BYTES,
    }
}

pub(super) fn chosen(trace: Trace, options: &Options) -> Chosen {
    choice(&[100.0], &[1.0], options).made(&[trace])
}

/// Returns whether the automatic choice uses recorded snippets.
fn automatic(samples: &[f64]) -> bool {
    let Chosen { parts, .. } = chosen(trace(samples, 40), &Options::default());
    parts.excitation.is_some()
}

/// Recordings of 0.5 to 4 s with one resonance at different frequencies.
#[test]
fn at_most_two_of_a_hundred_gaussian_recordings_are_taken_for_something_else() {
    const OF_LENGTH: u64 = 100;
    for samples in [2_500, 5_000, 10_000, 20_000] {
        let is_told = |seed: &u64| {
            let signal = filtered(&noise(*seed, samples), 40.0 + 5.0 * *seed as f64);
            !trace(&signal, 40).evidence.is_gaussian()
        };
        let told = (0..OF_LENGTH).filter(is_told).count();
        println!("{told} of {OF_LENGTH} of {samples} samples");
        assert!(told <= 2, "{told} of {samples} samples");
    }
}

/// Each trial has fewer stretches of noise to be compared with, and a codebook of six decides by all of them.
#[test]
fn none_of_a_hundred_textures_of_many_gaussian_recordings_is_taken_for_something_else() {
    let is_told = |texture: &u64| {
        let of = |trial: u64| {
            let signal = filtered(&noise(100 * texture + trial, 2_500), 40.0 + 5.0 * *texture as f64);
            trace_of_one(&signal, 40, 5000.0, 24).evidence
        };
        !Evidence::of_all((0..6).map(of)).is_gaussian()
    };
    assert_eq!((0..100).filter(is_told).count(), 0);
}

#[test]
fn what_a_recording_does_not_hold_is_not_judged() {
    let mut residual = noise(5, 20_000);
    // A hum that comes and goes.
    for (n, x) in residual.iter_mut().enumerate().filter(|(n, _)| n / 2500 % 2 == 0) {
        *x += (std::f64::consts::TAU * 40.0 * n as f64 / 5000.0).sin();
    }
    let is_gaussian = |from_hz: f64| Evidence::of(&residual, &[], &[], &(from_hz..f64::INFINITY), 1).is_gaussian();
    assert!(!is_gaussian(0.0) && is_gaussian(65.0));
}

#[test]
fn seconds_too_few_for_a_small_difference_are_said_to_be_few() {
    let scores = [1.0; 3];
    let said = |seconds| Evidence { scores, seconds }.to_string().contains("few");
    assert!(said(0.95) && !said(2.05));
}

#[test]
fn what_no_hand_feels_is_gaussian_however_many_trials_show_it_and_what_one_trial_shows_is_not() {
    let of_all = |scores: [f64; 3], trials: usize| {
        let trial = Evidence { scores, seconds: 2.0 };
        Evidence::of_all(std::iter::repeat_n(trial, trials)).is_gaussian()
    };
    let of = |score: f64, trials: usize| of_all([0.0, score, 0.0], trials);
    assert!([1, 2, 3, 10, 1000].iter().all(|&trials| of(-1.9, trials)));
    assert!(of(3.4, 1) && !of(3.6, 1) && !of(-2.6, 2) && !of(2.1, 4) && !of(2.1, 1000));
    assert!(of_all([2.3; 3], 1) && !of_all([2.4, 2.4, -2.4], 1));
}

/// The residual of a white signal is no louder than the signal, so the bound on loudness does not find the event.
#[test]
fn one_event_in_white_noise_is_not_what_a_texture_does() {
    const EVENTS: u64 = 50;
    let is_told = |seed: &u64| {
        let (at, peak) = (1_000 + 350 * *seed as usize, 3.0 + 0.7 * *seed as f64);
        let mut signal = noise(*seed, 20_000);
        for (x, wild) in signal[at..at + 12].iter_mut().zip(noise(!seed, 12)) {
            *x = peak * wild.clamp(-1.0, 1.0);
        }
        automatic(&signal)
    };
    let told = (0..EVENTS).filter(is_told).count();
    assert!(told <= 1, "{told} of {EVENTS}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn impulsive_textures_get_snippets(seed: u64, hz in 40.0f64..300.0) {
        // The filter's ringing makes milder impulses Gaussian.
        let impulses: Vec<f64> = noise(seed, 20_000).iter().map(|x| x.powi(5)).collect();
        prop_assert!(automatic(&filtered(&impulses, hz)));
    }

    #[test]
    fn textures_of_changing_level_get_snippets(seed: u64, hz in 40.0f64..600.0) {
        prop_assert!(automatic(&filtered(&swelling(seed, 20_000, 6.0), hz)));
    }

    /// Noise with louder bursts that have a spectrum of their own.
    #[test]
    fn textures_whose_bursts_have_a_spectrum_of_their_own_get_snippets(seed: u64) {
        prop_assert!(automatic(&bursting(seed, 40_000)));
    }
}

/// 3200 Hz is a common rate of accelerometers. The residual above half the rate comes from the conversion's filter and
/// not from the texture.
#[test]
fn recordings_of_low_rates_get_what_those_of_high_ones_do() {
    for rate_hz in [1000, 2000, 3200] {
        for seed in 0..4 {
            let of = |signal: Vec<f64>| {
                let low = resample(&[signal], 5000, rate_hz);
                let samples = resample(&low, rate_hz, 5000).remove(0);
                let trace = trace_of_rate(&samples, 40, f64::from(rate_hz));
                chosen(trace, &Options::default()).parts.excitation.is_some()
            };
            let found = [
                of(filtered(&noise(seed, 20_000), 150.0)),
                of(filtered(&impulsive(seed, 20_000), 150.0)),
                of(filtered(&swelling(seed, 20_000, 6.0), 150.0)),
            ];
            assert!(!found[0], "{rate_hz} {seed}");
            // In a band of 450 Hz, these impulses become nearly Gaussian noise, which four seconds may not distinguish
            // from noise.
            assert!(found[1] || rate_hz == 1000, "{rate_hz} {seed}");
            assert!(found[2], "{rate_hz} {seed}");
        }
    }
}

#[test]
fn what_is_asked_for_needs_no_test_and_what_is_not_stays_out() {
    for signal in [
        filtered(&noise(3, 20_000), 100.0),
        filtered(&impulsive(1, 20_000), 100.0),
    ] {
        for excitation in [ExcitationChoice::Gaussian, ExcitationChoice::Snippets] {
            let options = Options {
                excitation,
                ..Options::default()
            };
            let Chosen { parts, report, .. } = chosen(trace(&signal, 40), &options);
            assert_eq!(parts.excitation.is_some(), excitation == ExcitationChoice::Snippets);
            assert!(report.source.contains("as asked for"), "{report:?}");
        }
    }
}

#[test]
fn octaves_of_speed_have_codebooks_of_their_own_and_calm_ones_none_and_all_have_room() {
    let traces: Vec<Trace> = (0..12)
        .flat_map(|speed| (0..6).map(move |force| (speed, force)))
        .map(|at| {
            let seed = (at.0 * 8 + at.1) as u64;
            let own = match at.0 {
                0 => noise(seed, 10_000),
                _ => impulsive(seed, 10_000),
            };
            let own = trace(&filtered(&own, 100.0), 40);
            Trace { at, ..own }
        })
        .collect();
    let axis: Vec<f32> = (1..=12).map(|n| 10.0 * n as f32).collect();
    let options = Options::default();
    let Chosen { parts, report, .. } = choice(&axis, &axis[..6], &options).made(&traces);
    let excitation = parts.excitation.unwrap();
    // Four ranges, each with a ratio of 1.86: to 18, to 34, to 64 and to 120 mm/s.
    let numbers: Vec<u8> = excitation.of_nodes.iter().copied().step_by(6).collect();
    assert_eq!(numbers, [0, 1, 1, 2, 2, 2, 3, 3, 3, 3, 3, 3], "{report:?}");
    assert_eq!(report.codebooks[0].speeds_mm_s, [20.0, 30.0]);
    let bytes = excitation.codebooks.iter().map(|c| c.blocks.len() + 7).sum::<usize>() + 1 + 72;
    assert!(bytes <= limits::MAX_EXCITATION_BYTES, "{bytes}");
}

/// The third moment of a codebook whose trials' waves point to one side, on axes whose largest component changes from
/// one trial to the next.
#[test]
fn waves_of_all_trials_point_to_the_same_side() {
    let folder = tempfile::tempdir().unwrap();
    let wave = |seed| -> Vec<f64> { noise(seed, 15_000).iter().map(|x| x.powi(2) - 1.0).collect() };
    let trial = |seed: u64, axes: [f64; 2]| {
        let wave = wave(seed);
        let axes = axes.map(|share| wave.iter().map(|x| share * x).collect::<Vec<f64>>());
        written(folder.path(), &seed.to_string(), &axes, 100.0, seed as f64)
    };
    let trials = vec![trial(1, [0.8, -0.6]), trial(2, [0.6, -0.8])];
    let (_, bytes) = fitted_to(trials, &forced(ExcitationChoice::Snippets));
    let library = Library::decode(&bytes).unwrap();
    let codebook = library.textures().next().unwrap().excitation().unwrap().codebooks()[0];
    let samples: Vec<f64> = (0..codebook.samples()).map(|n| f64::from(codebook.share(n))).collect();
    let (first, second) = samples.split_at(samples.len() / 2);
    let skewness = |samples: &[f64]| {
        let third = samples.iter().map(|x| x.powi(3)).sum::<f64>() / samples.len() as f64;
        third / mean_square(samples).powf(1.5)
    };
    assert!(
        skewness(first) * skewness(second) > 1.0,
        "{} {}",
        skewness(first),
        skewness(second)
    );
}

/// Writes these axes to a folder and returns the trial.
pub(in crate::fit) fn written(folder: &Path, name: &str, axes: &[Vec<f64>], speed_mm_s: f64, force_n: f64) -> Trial {
    let file = folder.join(format!("{name}.wav"));
    let samples = (0..axes[0].len()).flat_map(|n| axes.iter().map(move |axis| axis[n]));
    let bytes = float_wav(axes.len(), SAMPLE_RATE_HZ, samples).unwrap();
    std::fs::write(&file, bytes).unwrap();
    Trial::of(file, "surface", speed_mm_s, force_n)
}

fn fitted(name: &str, samples: &[f64], options: &Options) -> (Fit, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let trial = written(folder.path(), name, &[samples.to_vec()], 100.0, 1.0);
    fitted_to(vec![trial], options)
}

/// Returns a fit to these trials, and its library.
pub(in crate::fit) fn fitted_to(trials: Vec<Trial>, options: &Options) -> (Fit, Vec<u8>) {
    let set = RecordingSet {
        trials,
        is_listed: true,
    };
    let fit = fit(&set, options, |_| ()).unwrap();
    let bytes = fit.library().unwrap();
    (fit, bytes)
}

/// Returns the RMS of 60 s of the first texture, m/s².
fn level(bytes: &[u8]) -> f64 {
    let library = Library::decode(bytes).unwrap();
    let texture = library.textures().next().unwrap();
    let motion = MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
    let rendered = render(texture, &motion, 60.0, 3).unwrap();
    assert_eq!(rendered.saturations, 0);
    mean_square(&rendered.accelerations_m_s2()).sqrt()
}

pub(super) fn forced(excitation: ExcitationChoice) -> Options {
    Options {
        excitation,
        order: Order::Fixed(60),
        ..Options::default()
    }
}

fn account(fit: &Fit) -> &ExcitationReport {
    fit.textures[0].excitation.as_ref().unwrap()
}

/// Bad input of all kinds gives a library that decodes and is that of a plain fit, or no louder than its model and no
/// softer than the level that is stored.
#[test]
fn bad_recordings_are_fitted_without_a_fault_and_at_their_level() {
    let mut impulse = vec![0.0; 12_000];
    impulse[6000] = 5.0;
    let mut impulse_in_noise: Vec<f64> = noise(4, 12_000).iter().map(|x| 1e-2 * x).collect();
    impulse_in_noise[6000] += 5.0;
    let square: Vec<f64> = (0..12_000).map(|n| if n / 50 % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let tone: Vec<f64> = (0..12_000).map(|n| (0.3 * f64::from(n)).sin()).collect();
    let mut half_silent = filtered(&impulsive(7, 12_000), 90.0);
    half_silent[..7000].fill(0.0);
    let cases: [(&str, Vec<f64>); 7] = [
        ("silence", vec![0.0; 12_000]),
        ("square", square),
        ("tone", tone),
        ("impulse", impulse),
        ("impulse-in-noise", impulse_in_noise),
        ("half-silent", half_silent),
        ("short", filtered(&impulsive(8, 900), 90.0)),
    ];
    for (name, samples) in &cases {
        let fitted = |excitation| fitted(name, samples, &forced(excitation));
        let (plain, plain_bytes) = fitted(ExcitationChoice::Gaussian);
        let model = f64::from(plain.textures[0].nodes[0].output_power);
        for excitation in [ExcitationChoice::Auto, ExcitationChoice::Snippets] {
            let (fit, bytes) = fitted(excitation);
            if fit.textures[0].grid.parts.excitation.is_none() {
                assert_eq!(bytes, plain_bytes, "{name} {excitation:?}");
                continue;
            }
            // A node whose loudest moments are too loud is softer than its model.
            let stored = f64::from(fit.textures[0].nodes[0].output_power);
            let [over_model_db, over_stored_db] =
                [model, stored].map(|power| 10.0 * (level(&bytes).powi(2) / power).log10());
            assert!(
                over_model_db < 1.0 && over_stored_db > -1.0,
                "{name} {excitation:?}: {over_model_db} dB, {over_stored_db} dB"
            );
        }
    }
}

#[test]
fn a_recording_too_short_for_a_codebook_is_said_to_be_and_gets_gaussian_noise() {
    let options = forced(ExcitationChoice::Snippets);
    for samples in [900, 3000, 3900] {
        let (fit, _) = fitted("short", &filtered(&impulsive(8, samples), 90.0), &options);
        assert_eq!(fit.textures[0].grid.parts.excitation, None);
        assert!(
            account(&fit).source.contains("too short for a codebook"),
            "{:?}",
            account(&fit)
        );
    }
    let (fit, _) = fitted("enough", &filtered(&impulsive(8, 6000), 90.0), &options);
    assert!(fit.textures[0].grid.parts.excitation.is_some(), "{:?}", account(&fit));
}

#[test]
fn clipped_peaks_are_not_taken_and_of_repeated_values_each_once() {
    let options = forced(ExcitationChoice::Snippets);
    let sound = filtered(&impulsive(9, 30_000), 90.0);
    let limit = 0.5 * sound[..15_000].iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    let clipped: Vec<f64> = sound.iter().map(|x| x.clamp(-limit, limit)).collect();
    let folder = tempfile::tempdir().unwrap();
    let trial = written(folder.path(), "clipped", std::slice::from_ref(&clipped), 100.0, 1.0);
    let signal = crate::fit::signal(&trial, options.conditioning).unwrap();
    let at_limit: Vec<usize> = (0..15_000).filter(|&n| clipped[n].abs() >= limit).collect();
    let in_runs = at_limit.windows(3).filter(|run| run[2] - run[0] == 2).map(|run| run[1]);
    let mut runs = 0;
    for n in in_runs {
        runs += 1;
        assert!(
            signal.flaws.iter().any(|flaw| flaw.contains(&n)),
            "sample {n} is clipped"
        );
    }
    assert!(runs > 5, "{runs}");
    // The filter's ringing makes milder impulses Gaussian.
    let impulses: Vec<f64> = noise(9, 30_000).iter().map(|x| x.powi(5)).collect();
    let held: Vec<f64> = filtered(&impulses, 90.0).into_iter().flat_map(|x| [x; 2]).collect();
    let (fit, _) = fitted("held", &held, &options);
    assert!(fit.textures[0].grid.parts.excitation.is_some());
    assert!(!account(&fit).evidence.is_gaussian());
}

/// The spectrum falls from 8 Hz on, as that of a finger's pressure does. If what little is left below the cut is made
/// as loud as the rest, it bursts, and the bound on loudness lowers everything.
#[test]
fn what_the_filter_against_slow_motion_removes_is_played_as_steady_noise() {
    for seed in 0..3 {
        let mut last = 0.0;
        let falling = |x: f64| {
            last = 0.99 * last + x;
            last
        };
        let signal: Vec<f64> = noise(seed, 32_000).into_iter().map(falling).collect();
        let [plain, recorded] = [ExcitationChoice::Gaussian, ExcitationChoice::Snippets]
            .map(|excitation| fitted("falling", &signal, &forced(excitation)));
        assert!(recorded.0.trials[0].high_pass_hz.is_some());
        assert_eq!(account(&recorded.0).lowered_db, None, "{:?}", account(&recorded.0));
        near(level(&recorded.1) / level(&plain.1), 1.0, 0.1);
    }
}

/// The library of a texture that needs no parts is that of a plain fit, bit for bit; one that needs them keeps them.
#[test]
fn parts_cost_nothing_where_they_are_not_needed_and_go_with_the_texture_where_they_are() {
    let [plain, automatic] = [ExcitationChoice::Gaussian, ExcitationChoice::Auto].map(forced);
    let calm = filtered(&noise(10, 12_000), 90.0);
    let of = |options| fitted("calm", &calm, options).1;
    assert_eq!(of(&plain), of(&automatic));
    let lively: Vec<f64> = impulsive(11, 24_000)
        .into_iter()
        .zip(swelling(12, 24_000, 8.0))
        .map(|(a, b)| a * b)
        .collect();
    let (fit, bytes) = fitted("lively", &filtered(&lively, 90.0), &automatic);
    assert!(fit.textures[0].grid.parts.excitation.is_some(), "{:?}", account(&fit));
    let library = Library::decode(&bytes).unwrap();
    assert_eq!(with_scenes(&library, &[]).unwrap(), bytes);
    near(level(&bytes), 1.0, 0.1);
}
