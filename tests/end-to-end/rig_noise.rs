//! A rig whose motor and sensor are heard in addition to a known texture: broadband noise and tones that follow the
//! speed, along a direction of their own.

use std::f64::consts::{PI, TAU};

use host_tools::dsp::spectrum::band_edges_hz;

use crate::support::{
    Bench, RATE_HZ, all_pole, decibels, holds, near, noise, power_between, predictor, scaled, text, wav,
};

const SECONDS: usize = 40;
const SPEEDS_MM_S: [f64; 3] = [50.0, 100.0, 200.0];
/// Third-octave bands that are compared, from 40 Hz to 2 kHz.
const BANDS: std::ops::Range<usize> = 3..21;
/// Directions of texture and motor. They are 61° apart.
const TEXTURE: [f64; 3] = [0.6, 0.0, 0.8];
const MOTOR: [f64; 3] = [0.8, 0.6, 0.0];
/// Tones of the motor: frequency per speed, Hz per mm/s, and amplitude at 100 mm/s, m/s².
const TONES: [(f64, f64); 2] = [(1.37, 0.15), (6.85, 0.08)];

/// The predictor of the texture: resonances with a bandwidth of 60 Hz.
fn surface() -> Vec<f64> {
    let radius = (-PI * 60.0 / f64::from(RATE_HZ)).exp();
    predictor(RATE_HZ, &[(120.0, radius), (700.0, radius)])
}

/// The predictor of the broadband noise.
fn hiss() -> Vec<f64> {
    vec![-0.4]
}

/// Factor by which an excitation of unit variance gives `rms`, m/s², after the filter `a`.
fn factor(a: &[f64], rms: f64) -> f64 {
    rms / power_between(a, RATE_HZ, 0.0, f64::from(RATE_HZ) / 2.0).sqrt()
}

/// RMS of the texture and of the motor's broadband noise, m/s².
fn levels(speed: f64, motor: f64) -> (f64, f64) {
    (0.4 * (speed / 100.0).sqrt(), 0.06 * motor * speed / 100.0)
}

fn through(a: &[f64], rms: f64, seed: u64) -> Vec<f64> {
    let factor = factor(a, rms);
    let signal = all_pole(a, &noise(seed, SECONDS * RATE_HZ as usize));
    scaled(&signal, factor)
}

/// Noise of a motor of this strength at `speed`.
fn motor_noise(speed: f64, motor: f64, seed: u64) -> Vec<f64> {
    let mut sum = through(&hiss(), levels(speed, motor).1, seed);
    let phases = noise(seed + 7, TONES.len());
    for ((per_speed, amplitude), phase) in TONES.into_iter().zip(phases) {
        for (sample, n) in sum.iter_mut().zip(0u32..) {
            let angle = per_speed * speed * f64::from(n) / f64::from(RATE_HZ) + phase;
            *sample += motor * amplitude * speed / 100.0 * (TAU * angle).sin();
        }
    }
    sum
}

/// The set `set`: one texture at 1 N, and only the motor at 0 N, on one axis or on three.
fn recorded(motor: f64, axes: usize) -> Bench {
    let bench = Bench::new();
    let [mut list, mut of_motor, mut of_contact] = [header(), header(), header()];
    for (speed, seed) in SPEEDS_MM_S.into_iter().zip((10..).step_by(10)) {
        let texture = through(&surface(), levels(speed, motor).0, seed);
        for (force, seed) in [(0, seed + 1), (1, seed + 2)] {
            let noise = motor_noise(speed, motor, seed);
            let axis = |index: usize| -> Vec<f64> {
                let [of_texture, of_motor] = if axes == 1 {
                    [1.0, 1.0]
                } else {
                    [TEXTURE[index], MOTOR[index]]
                };
                texture
                    .iter()
                    .zip(&noise)
                    .map(|(x, n)| f64::from(force) * of_texture * x + of_motor * n)
                    .collect()
            };
            let signals: Vec<Vec<f64>> = (0..axes).map(axis).collect();
            let signals: Vec<&[f64]> = signals.iter().map(Vec::as_slice).collect();
            bench.write(&format!("set/{speed}-{force}.wav"), wav(&signals, RATE_HZ));
            let line = format!("{speed}-{force}.wav,felt,{speed},{force}\n");
            list.push_str(&line);
            if force == 0 {
                of_motor.push_str(&format!("{speed}-0.wav,motor,{speed},0\n"));
            } else {
                of_contact.push_str(&line);
            }
        }
    }
    bench.write("set/trials.csv", list);
    bench.write("set/motor.csv", of_motor);
    bench.write("set/contact.csv", of_contact);
    bench
}

fn header() -> String {
    "file,texture,speed_mm_s,force_n\n".to_owned()
}

/// Power of texture and of motor at `speed` in a third-octave band, (m/s²)².
fn powers(band: usize, speed: f64, motor: f64, axes: usize) -> (f64, f64) {
    let (low, high) = band_edges_hz(band);
    let of = |a: &[f64], rms: f64| factor(a, rms).powi(2) * power_between(a, RATE_HZ, low, high);
    let (texture, hiss_rms) = levels(speed, motor);
    let tones = TONES
        .into_iter()
        .filter(|(hz, _)| (low..high).contains(&(hz * speed)))
        .map(|(_, amplitude)| (motor * amplitude * speed / 100.0).powi(2) / 2.0);
    let cos: f64 = TEXTURE.iter().zip(&MOTOR).map(|(a, b)| a * b).sum();
    let seen = if axes == 1 { 1.0 } else { cos * cos };
    let motor = of(&hiss(), hiss_rms) + tones.sum::<f64>();
    (of(&surface(), texture), seen * motor)
}

/// Errors of `library` at `speed` in each of [`BANDS`], dB.
fn errors(bench: &Bench, library: &str, speed: f64, truth: &[(f64, f64)]) -> Vec<f64> {
    bench.succeed(&format!(
        "render {library} --texture felt --speed {speed} --force 1 --seconds 61 --seed 7 --out o.wav --overwrite"
    ));
    let samples = bench.samples("o.wav", RATE_HZ).split_off(RATE_HZ as usize);
    let spectrum = host_tools::dsp::spectrum::PowerSpectrum::welch(&samples, f64::from(RATE_HZ));
    let error = |(band, (texture, _)): (usize, &(f64, f64))| {
        let (low, high) = band_edges_hz(band);
        decibels(spectrum.power_between(low, high) / texture)
    };
    BANDS.zip(truth).map(error).collect()
}

/// Options of the paper's fit, because only spectra are compared.
const PLAIN: &str = "--excitation gaussian --lines none";

fn is_the_texture_where_it_is_as_strong_as_the_motor(motor: f64, axes: usize) {
    let bench = recorded(motor, axes);
    bench.succeed(&format!("fit set --out now.lib {PLAIN}"));
    bench.succeed(&format!("fit set --out own.lib --floor subtract {PLAIN}"));
    for speed in SPEEDS_MM_S {
        let truth: Vec<_> = BANDS.map(|band| powers(band, speed, motor, axes)).collect();
        let now = errors(&bench, "now.lib", speed, &truth);
        let own = errors(&bench, "own.lib", speed, &truth);
        for (index, &(texture, noise)) in truth.iter().enumerate() {
            let over_db = decibels(texture / noise);
            let (now, own) = (now[index].abs(), own[index].abs());
            let what = format!("{motor}, {axes} axes, {speed} mm/s, band {index}: {own:.2} dB off");
            assert!(over_db < 0.0 || own < 1.0, "{what} at {over_db:.1} dB");
            assert!(own < now + 0.5, "{what}, and {now:.2} dB with the noise");
        }
    }
}

#[test]
fn bands_are_the_textures_where_it_is_as_strong_as_the_motor_and_nowhere_worse() {
    for motor in [0.3, 1.0] {
        is_the_texture_where_it_is_as_strong_as_the_motor(motor, 1);
    }
    is_the_texture_where_it_is_as_strong_as_the_motor(0.6, 3);
}

#[test]
fn the_rigs_share_is_told_by_speed_and_band_and_changes_no_byte() {
    let bench = recorded(1.0, 1);
    let output = bench.run("fit set --out note.lib");
    let words = &["the rig's own noise is half or more of", "--floor subtract"];
    holds(&text(&output.stderr), words);
    let words = "the rig's share of each third octave's power";
    holds(&text(&output.stdout), &[words]);
    bench.succeed("fit set --out none.lib --floor none");
    assert_eq!(bench.read("note.lib"), bench.read("none.lib"));
    let report = bench.json("fit set --out note.lib --json");
    for trial in report["trials"]
        .as_array()
        .expect("trials")
        .iter()
        .filter(|trial| trial["force_n"] == 1.0)
    {
        let speed = trial["speed_mm_s"].as_f64().expect("a speed");
        for band in BANDS {
            let (texture, noise) = powers(band, speed, 1.0, 1);
            let told = trial["floor_shares"][band].as_f64().expect("a share");
            near(told, noise / (texture + noise), 0.12);
        }
    }
}

#[test]
fn a_motors_tone_is_a_line_of_the_texture_only_while_it_is_not_taken_off() {
    let bench = recorded(1.0, 1);
    let lines = |options: &str| {
        let fit = "fit set --out a.lib --excitation gaussian --json";
        let report = bench.json(&format!("{fit} {options}"));
        report["lines"][0]["findings"]["lines"].as_array().map_or(0, Vec::len)
    };
    assert!(lines("") > 0, "the motor's tones are locked to its speed");
    assert_eq!(lines("--floor subtract"), 0);
}

#[test]
fn what_is_fitted_without_the_noise_is_judged_without_it() {
    let bench = recorded(1.0, 1);
    bench.succeed(&format!("fit set --out own.lib --floor subtract {PLAIN}"));
    let evaluate = "evaluate set --library own.lib --json-out f.json --overwrite";
    let said = bench.succeed(evaluate);
    let words = "noise is taken off the recordings as it was for the fit";
    holds(&said, &[words, "spectrum as near"]);
    // Without this, the motor's noise in the recordings would put many bands 3 dB off.
    let off = &bench.report("f.json")["textures"][0]["mean_band_error_db"];
    assert!(off.as_f64().expect("an error") < 1.0, "{off}");
    // The noise in other takes is not known, so they are compared as they are.
    bench.write("other/trials.csv", header() + "100-1.wav,felt,100,1\n");
    let other = through(&surface(), 0.4, 77);
    bench.write("other/100-1.wav", wav(&[&other], RATE_HZ));
    let said = bench.succeed("evaluate set --library own.lib --takes other");
    holds(&said, &["the recordings that judge it have it"]);
}

#[test]
fn recordings_that_are_named_do_what_trials_at_no_force_do() {
    let bench = recorded(1.0, 3);
    let read = |name: &str| bench.read(name);
    let quick = "--floor subtract --order 40";
    bench.succeed(&format!("fit set --out own.lib {quick}"));
    let named = format!("fit set/contact.csv --floor-recording set/motor.csv {quick} --out");
    bench.succeed(&format!("{named} named.lib"));
    assert_eq!(read("own.lib"), read("named.lib"));
    // The blocks that are used for judging are fitted in the same way.
    bench.succeed("evaluate set/contact.csv --library named.lib");
    bench.write("mono.wav", wav(&[&noise(1, 20_000)], RATE_HZ));
    let fit = format!("fit set/contact.csv --out a.lib {quick}");
    bench.refuse_each(&format!(
        "{fit} | 'felt' | no trial in motion at 0 N | --floor-recording
        {fit} --floor-recording mono.wav | mono.wav | 1 channel | have 3"
    ));
}
