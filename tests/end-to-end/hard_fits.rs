//! Signals that break a fit.

use std::f64::consts::TAU;

use crate::support::{Bench, RATE_HZ, all_pole, holds, noise, wav};
use host_tools::dsp::autocorrelation::Autocorrelation;
use host_tools::dsp::linear_prediction::{Prediction, corrected, step_up};
use serde_json::Value;

const SAMPLES: usize = 10_000;
const ORDER: usize = 400;

fn tone(frequency_hz: f64) -> Vec<f64> {
    let step = TAU * frequency_hz / f64::from(RATE_HZ);
    (0..SAMPLES).map(|n| (step * n as f64).sin()).collect()
}

/// Noise through four equal pole pairs: steep above 200 Hz.
fn low_passed() -> Vec<f64> {
    let (radius, angle) = (0.85f64, TAU * 120.0 / f64::from(RATE_HZ));
    let pair = [-2.0 * radius * angle.cos(), radius * radius];
    let mut signal = noise(8, SAMPLES);
    for _ in 0..4 {
        signal = all_pole(&pair, &signal);
    }
    let power = signal.iter().map(|x| x * x).sum::<f64>() / SAMPLES as f64;
    signal.iter().map(|x| x / power.sqrt()).collect()
}

/// The rows of the table, each with the verdict or warning that the command must report, if any.
fn signals() -> Vec<(&'static str, Vec<f64>, Option<&'static str>)> {
    let broadband = noise(5, SAMPLES);
    let hum: Vec<f64> = broadband
        .iter()
        .zip(tone(50.0))
        .map(|(x, hum)| 1e-3 * x + hum)
        .collect();
    let clipped = tone(100.0)
        .iter()
        .map(|x| (3.0 * x).clamp(-1.0, 1.0))
        .collect();
    let drift = (0..SAMPLES)
        .map(|n| n as f64 / SAMPLES as f64 - 0.3)
        .collect();
    vec![
        ("zero", vec![0.0; SAMPLES], Some("silent")),
        ("constant", vec![9.81; SAMPLES], Some("silent")),
        ("60 Hz tone", tone(60.0), Some("hum")),
        ("low-passed", low_passed(), None),
        ("drift", drift, Some("drifting")),
        ("clipped", clipped, Some("clipped")),
        (
            "large mean",
            broadband.iter().map(|x| x + 50.0).collect(),
            Some("was removed"),
        ),
        ("3 samples", vec![1.0, -2.0, 0.5], Some("too short")),
        ("100 samples", broadband[..100].to_vec(), Some("too short")),
        ("hum", hum, Some("hum")),
    ]
}

/// Without the white-noise correction and the stop at the last sound order, several of these give |k| above one.
#[test]
fn the_products_own_models_are_stable_with_and_without_a_taper() {
    for (name, signal, _) in signals() {
        let mean = signal.iter().sum::<f64>() / signal.len() as f64;
        let step = TAU / signal.len() as f64;
        // Rectangular and Hann's.
        for depth in [0.0, 0.5] {
            let window = |n: i32| 1.0 - depth - depth * (step * f64::from(n)).cos();
            let tapered = (0..).zip(&signal).map(|(n, x)| (x - mean) * window(n));
            let lags = Autocorrelation::of(&tapered.collect::<Vec<_>>(), ORDER).lags;
            let prediction = Prediction::levinson_durbin(&corrected(lags), ORDER);
            let (reflection, error) = (&prediction.reflection, &prediction.error_power);
            assert!(reflection.iter().all(|k| k.abs() < 1.0), "{name}");
            assert!(error.iter().all(|e| e.is_finite() && *e >= 0.0), "{name}");
            assert!(step_up(reflection).iter().all(|a| a.is_finite()), "{name}");
        }
    }
}

/// Every row through the command, at the paper's order: it gives a library without NaN, and names what is wrong.
#[test]
fn every_signal_becomes_a_library_and_what_is_wrong_with_it_is_said() {
    let bench = Bench::new();
    let mut list = String::from("file,texture,speed_mm_s,force_n\n");
    for (name, signal, _) in signals() {
        let file = name.replace(' ', "-");
        bench.write(&format!("set/{file}.wav"), wav(&[&signal], RATE_HZ));
        list.push_str(&format!("{file}.wav,{name},100,1\n"));
    }
    bench.write("set/trials.csv", list);
    let report = bench.succeed("fit set --out a.lib --order 400 --high-pass none --json");
    let numbers = report.replace("\"speed_scatter\": null", "");
    assert!(!numbers.contains("NaN") && !numbers.contains("null"));
    let report: Value = serde_json::from_str(&report).unwrap();
    let warnings = report["warnings"].to_string();
    for (index, (name, signal, said)) in signals().iter().enumerate() {
        let verdicts = report["trials"][index]["verdicts"].to_string();
        let own_warnings: Vec<&str> = warnings
            .split('"')
            .filter(|line| line.contains(&format!("'{name}'")))
            .collect();
        match said {
            Some(said) => assert!(
                verdicts.contains(said) || own_warnings.concat().contains(said),
                "{name}: {verdicts}"
            ),
            None => assert_eq!(verdicts, "[]", "{name}"),
        }
        let texture = &report["textures"][index];
        assert_eq!(texture["name"], *name);
        let order = texture["orders"][2].as_u64().unwrap() as usize;
        if signal.len() < ORDER {
            assert!(order < signal.len(), "{name}: order {order}");
            assert!(
                own_warnings.concat().contains("lower order"),
                "{name}: {warnings}"
            );
        }
        if *said == Some("silent") {
            assert_eq!(
                (order, &texture["silent_nodes"]),
                (0, &Value::from(1)),
                "{name}"
            );
        } else {
            // A recursion that stopped below the requested order is reported.
            let lowered = order < ORDER;
            assert_eq!(
                lowered,
                own_warnings.concat().contains("lower order"),
                "{name}: order {order}"
            );
        }
    }
    // The library can be read.
    bench.succeed("inspect a.lib");
}

/// A list of trials of texture `felt`, each of them at a speed and a force, all of them sounding.
fn felt(trials: &[(f64, f64)]) -> Bench {
    let bench = Bench::new();
    let mut list = String::from("file,texture,speed_mm_s,force_n\n");
    for (seed, (speed, force)) in (0..).zip(trials) {
        let signal = all_pole(&[-0.6, 0.5], &noise(seed, SAMPLES));
        bench.write(&format!("set/{seed}.wav"), wav(&[&signal], RATE_HZ));
        list.push_str(&format!("{seed}.wav,felt,{speed},{force}\n"));
    }
    bench.write("set/trials.csv", list);
    bench
}

/// A silent node between which power is interpolated would make light touch too loud.
#[test]
fn trials_at_rest_or_without_contact_are_left_out_with_a_note() {
    let bench = felt(&[(0.0, 0.5), (100.0, 0.0), (100.0, 0.5), (200.0, 0.5)]);
    let output = bench.run("fit set --out felt.lib --json");
    assert!(output.status.success());
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let message = report["warnings"][0].as_str().unwrap();
    holds(&message, &["'felt': 2 trials at speed 0 or force 0"]);
    let library = std::fs::read(bench.path("felt.lib")).unwrap();
    let library = model_format::Library::decode(&library).unwrap();
    let texture = library.textures().next().unwrap();
    let speeds: Vec<_> = texture.speed_axis().values().collect();
    assert_eq!(
        (speeds.len(), texture.force_axis().values().count()),
        (2, 1)
    );
    let used = report["trials"].as_array().unwrap().iter();
    let used: Vec<bool> = used.map(|trial| trial["used"].as_bool().unwrap()).collect();
    assert_eq!(used, [false, false, true, true]);
}

#[test]
fn a_texture_of_trials_at_rest_or_without_contact_is_refused_with_the_remedy() {
    let refused = felt(&[(0.0, 0.5), (100.0, 0.0)]).refuse("fit set --out felt.lib");
    holds(&refused, &["'felt'", "0.05 N"]);
}
