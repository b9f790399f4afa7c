//! A tool held by a hand: three axes with gravity and a slow motion in addition to a known texture.

use std::f64::consts::TAU;

use crate::support::{Bench, all_pole, decibels, holds, noise, power_between, predictor, wav};
use host_tools::dsp::spectrum::{band_edges_hz, band_powers};
use host_tools::dsp::sums::mean_square;

/// Directions of texture and drift. They are 53° apart.
const TEXTURE: [f64; 3] = [0.6, 0.0, 0.8];
const DRIFT: [f64; 3] = [1.0, 0.0, 0.0];
const GRAVITY_M_S2: [f64; 3] = [0.0, -9.81, 0.0];
const SECONDS: usize = 8;
/// RMS of the texture, m/s².
const LEVEL: f64 = 0.5;

/// The predictor of the texture: resonances with a bandwidth of 60 Hz.
fn surface(rate_hz: u32) -> Vec<f64> {
    let radius = (-std::f64::consts::PI * 60.0 / f64::from(rate_hz)).exp();
    predictor(rate_hz, &[(90.0, radius), (260.0, radius)])
}

/// Three axes with the texture and a motion from 0.5 to 7.75 Hz, whose RMS is `drift` times the texture's. Returns also
/// the factor of the texture's excitation.
fn axes(rate_hz: u32, drift: f64, seed: u64) -> ([Vec<f64>; 3], f64) {
    let count = SECONDS * rate_hz as usize;
    let a = surface(rate_hz);
    let texture = all_pole(&a, &noise(seed, count));
    let factor = LEVEL / power_between(&a, rate_hz, 0.0, f64::from(rate_hz) / 2.0).sqrt();
    let tones: Vec<(f64, f64)> = noise(seed + 50, 30)
        .iter()
        .zip(0..)
        .map(|(&phase, n)| (0.5 + 0.25 * f64::from(n), phase))
        .collect();
    let scale = drift * LEVEL / (tones.len() as f64 / 2.0).sqrt();
    let motion = |n: usize| -> f64 {
        let time_s = n as f64 / f64::from(rate_hz);
        let tones = tones.iter().map(|&(hz, phase)| (TAU * (hz * time_s + phase)).sin());
        scale * tones.sum::<f64>()
    };
    let motion: Vec<f64> = (0..count).map(motion).collect();
    let axis = |index: usize| -> Vec<f64> {
        texture
            .iter()
            .zip(&motion)
            .map(|(x, slow)| TEXTURE[index] * factor * x + DRIFT[index] * slow + GRAVITY_M_S2[index])
            .collect()
    };
    (std::array::from_fn(axis), factor)
}

fn recorded(axes: &[Vec<f64>; 3], rate_hz: u32) -> Bench {
    let bench = Bench::new();
    let [x, y, z] = axes;
    let trial = ("silk", 100.0, 1.0, wav(&[x, y, z], rate_hz));
    bench.write_set("set", &[trial]);
    bench
}

/// Renders 40 s of `library`, m/s² at 5 kHz.
fn played(bench: &Bench, library: &str) -> Vec<f64> {
    bench.succeed(&format!(
        "render {library} --texture silk --speed 100 --force 1 --seconds 41 --seed 7 --out played.wav --overwrite"
    ));
    bench.samples("played.wav", 5_000).split_off(5_000)
}

/// Returns the largest error of a third-octave band that can be felt, and the error of the level, dB.
fn errors(played: &[f64], rate_hz: u32, factor: f64, share: f64) -> (f64, f64) {
    let a = surface(rate_hz);
    let power = |low: f64, high: f64| share * factor.powi(2) * power_between(&a, rate_hz, low, high);
    let highest_hz = (0.4 * f64::from(rate_hz)).min(1_000.0);
    let worst = band_powers(played, 5_000.0)
        .into_iter()
        .enumerate()
        .filter_map(|(band, found)| {
            let (low, high) = band_edges_hz(band);
            (low > 28.0 && high < highest_hz).then(|| decibels(found / power(low, high)).abs())
        });
    let half_hz = (f64::from(rate_hz) / 2.0).min(2_500.0);
    let level = decibels(mean_square(played) / power(0.0, half_hz));
    (worst.fold(0.0, f64::max), level)
}

fn holds_the_texture(rate_hz: u32, drift: f64, method: &str) {
    let (axes, factor) = axes(rate_hz, drift, 3);
    let bench = recorded(&axes, rate_hz);
    bench.succeed(&format!("fit set --out a.lib --reduce {method}"));
    // One axis contains only its own part of the texture; the other reductions keep all of it.
    let share = if method == "x" { TEXTURE[0].powi(2) } else { 1.0 };
    let (band_db, level_db) = errors(&played(&bench, "a.lib"), rate_hz, factor, share);
    let case = format!("{rate_hz} Hz, drift {drift}, {method}");
    assert!(band_db < 1.5, "{case}: {band_db} dB");
    assert!(level_db.abs() < 1.0, "{case}: {level_db} dB");
}

/// Without the filter, a drift of three times the texture's level causes errors of 12 dB in some bands.
#[test]
fn a_hands_drift_of_up_to_twenty_times_the_texture_is_not_taken_for_it() {
    for rate_hz in [1_000, 3_200, 5_000, 48_000] {
        for drift in [0.0, 0.2, 1.0, 20.0] {
            holds_the_texture(rate_hz, drift, "pca");
        }
    }
    for method in ["dft321", "x"] {
        for drift in [0.2, 3.0, 20.0] {
            holds_the_texture(3_200, drift, method);
        }
    }
}

#[test]
fn without_drift_the_fit_is_byte_for_byte_that_without_the_filter() {
    let bench = recorded(&axes(5_000, 0.0, 5).0, 5_000);
    let told = bench.told("fit set --out auto.lib");
    bench.succeed("fit set --out none.lib --high-pass none");
    assert_eq!(bench.read("auto.lib"), bench.read("none.lib"));
    assert!(!told.contains("high-passed"), "{told}");
}

#[test]
fn the_filter_is_said_with_its_reason_and_what_is_below_it_is_not_judged() {
    let (axes, _) = axes(5_000, 3.0, 4);
    let bench = recorded(&axes, 5_000);
    let told = bench.told("fit set --out a.lib --lines none");
    holds(&told, &["1 trial high-passed at 20 Hz", "89 %", "50°"]);
    holds(&told, &["--high-pass none"]);
    bench.succeed("evaluate set --library a.lib --json-out report.json");
    let trial = &bench.report("report.json")["trials"][0];
    let low_hz = trial["range"]["low_hz"].as_f64().unwrap();
    assert!(low_hz >= 25.0, "{trial}");
    let bands = trial["band_errors_db"].as_array().expect("bands");
    assert!(bands[0].is_null() && !bands[4].is_null(), "{bands:?}");
    let worst = bands.iter().filter_map(serde_json::Value::as_f64);
    let worst = worst.fold(0.0, |worst: f64, x| worst.max(x.abs()));
    assert!(worst < 4.0, "{bands:?}");
    let told = bench.told("fit set --out b.lib --high-pass none");
    holds(&told, &["fitted with slow motion", "50°"]);
    let refused = bench.fail("fit set --out c.lib --high-pass 0.5");
    holds(&refused, &["'auto', 'none' or 1 to 200 Hz"]);
}
