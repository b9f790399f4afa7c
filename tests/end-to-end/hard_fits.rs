//! Signals that break a fit.

use std::f64::consts::TAU;

use crate::support::{Bench, RATE_HZ, all_pole, holds, json, noise, scaled, wav};
use host_tools::dsp::sums::rms;

const SAMPLES: usize = 10_000;
const ORDER: usize = 400;

fn tone(frequency_hz: f64) -> Vec<f64> {
    let step = TAU * frequency_hz / f64::from(RATE_HZ);
    (0..SAMPLES).map(|n| (step * n as f64).sin()).collect()
}

/// Noise through four equal pole pairs, with a steep slope above 200 Hz.
fn low_passed() -> Vec<f64> {
    let (radius, angle) = (0.85f64, TAU * 120.0 / f64::from(RATE_HZ));
    let pair = [-2.0 * radius * angle.cos(), radius * radius];
    let mut signal = noise(8, SAMPLES);
    for _ in 0..4 {
        signal = all_pole(&pair, &signal);
    }
    scaled(&signal, rms(&signal).recip())
}

/// The signals, each with the verdict or warning that the command must report, if any.
fn signals() -> Vec<(&'static str, Vec<f64>, Option<&'static str>)> {
    let broadband = noise(5, SAMPLES);
    let hum = tone(50.0).into_iter().zip(&broadband);
    let hum = hum.map(|(hum, x)| 1e-3 * x + hum).collect();
    let clipped = tone(100.0).into_iter().map(|x| (3.0 * x).clamp(-1.0, 1.0)).collect();
    let drift = (0..SAMPLES).map(|n| n as f64 / SAMPLES as f64 - 0.3);
    let lifted = broadband.iter().map(|x| x + 50.0).collect();
    vec![
        ("zero", vec![0.0; SAMPLES], Some("silent")),
        ("constant", vec![9.81; SAMPLES], Some("silent")),
        ("60 Hz tone", tone(60.0), Some("hum")),
        ("low-passed", low_passed(), None),
        ("drift", drift.collect(), Some("drifting")),
        ("clipped", clipped, Some("clipped")),
        ("large mean", lifted, Some("was removed")),
        ("3 samples", vec![1.0, -2.0, 0.5], Some("too short")),
        ("100 samples", broadband[..100].to_vec(), Some("too short")),
        ("hum", hum, Some("hum")),
    ]
}

/// Fits every signal with the command at the paper's order. The result is a library without NaN, and the command
/// reports what is wrong.
#[test]
fn every_signal_becomes_a_library_and_what_is_wrong_with_it_is_said() {
    let bench = Bench::new();
    let trials = signals()
        .into_iter()
        .map(|(name, signal, _)| (name, 100.0, 1.0, wav(&[&signal], RATE_HZ)));
    bench.write_set("set", &trials.collect::<Vec<_>>());
    let report = bench.succeed("fit set --out a.lib --order 400 --high-pass none --json");
    // What is not there is null, as a figure that is no number would be.
    let absent = ["speed_scatter", "harmonic_of", "none_because"].map(|key| format!("\"{key}\": null"));
    let numbers = absent
        .iter()
        .fold(report.clone(), |report, absent| report.replace(absent, ""));
    assert!(!numbers.contains("NaN") && !numbers.contains("null"), "{numbers}");
    let report = json(&report);
    let warnings = report["warnings"].to_string();
    for (index, (name, signal, said)) in signals().iter().enumerate() {
        let verdicts = report["trials"][index]["verdicts"].to_string();
        let quoted = format!("'{name}'");
        let own_warnings = warnings
            .split('"')
            .filter(|line| line.contains(&quoted))
            .collect::<String>();
        match said {
            Some(said) => holds(&(verdicts + &own_warnings), &[said]),
            None => assert_eq!(verdicts, "[]", "{name}"),
        }
        let texture = &report["textures"][index];
        assert_eq!(texture["name"], *name);
        let order = texture["orders"][2].as_u64().unwrap() as usize;
        assert!(order < signal.len(), "{name}: order {order}");
        if *said == Some("silent") {
            assert_eq!(order, 0, "{name}");
            assert_eq!(texture["silent_nodes"], 1, "{name}");
        } else {
            // A recursion that stopped below the requested order is reported.
            let is_told = own_warnings.contains("lower order");
            assert_eq!(order < ORDER, is_told, "{name}: order {order}");
        }
    }
    // The library must be readable.
    bench.succeed("inspect a.lib");
}

/// A list of trials of the texture `felt` at these speeds and forces, none of them silent.
fn felt(trials: &[(f64, f64)]) -> Bench {
    let bench = Bench::new();
    let trials = (0..).zip(trials).map(|(seed, &(speed, force))| {
        let signal = all_pole(&[-0.6, 0.5], &noise(seed, SAMPLES));
        ("felt", speed, force, wav(&[&signal], RATE_HZ))
    });
    bench.write_set("set", &trials.collect::<Vec<_>>());
    bench
}

/// With a silent node, interpolation of the power would make light touch too loud.
#[test]
fn trials_at_rest_or_without_contact_are_left_out_with_a_note() {
    let bench = felt(&[(0.0, 0.5), (100.0, 0.0), (100.0, 0.5), (200.0, 0.5)]);
    let report = bench.json("fit set --out felt.lib --json");
    let message = &report["warnings"][0];
    holds(message, &["'felt': 2 trials at speed 0 or force 0"]);
    let used = report["trials"].as_array().unwrap().iter();
    let used: Vec<bool> = used.map(|trial| trial["used"].as_bool().unwrap()).collect();
    assert_eq!(used, [false, false, true, true]);
}

#[test]
fn a_texture_of_trials_at_rest_or_without_contact_is_refused_with_the_remedy() {
    let refused = felt(&[(0.0, 0.5), (100.0, 0.0)]).refuse("fit set --out felt.lib");
    holds(&refused, &["'felt'", "0.05 N"]);
}
