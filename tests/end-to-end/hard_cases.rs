//! Hard cases on the device's kernel: the lattice keeps its bounds.

use std::sync::OnceLock;

use host_tools::evaluation::stress;
use host_tools::evaluation::stress::models::fixtures;
use host_tools::evaluation::stress::{Outcome, cases};
use serde_json::Value;

fn outcomes() -> &'static [Outcome] {
    static OUTCOMES: OnceLock<Vec<Outcome>> = OnceLock::new();
    OUTCOMES.get_or_init(|| stress::run(&cases::suite(cases::Length::Short), || ()).unwrap())
}

fn assert_all_hold(outcomes: &[Outcome]) {
    for outcome in outcomes {
        let broken = outcome.broken();
        assert!(broken.is_empty(), "{}: {broken:?}", outcome.case);
    }
    assert!(outcomes.len() > 20, "{}", outcomes.len());
}

#[test]
fn the_lattice_holds_its_promises_in_every_hard_case() {
    assert_all_hold(outcomes());
    // No exception is made for the six models of order 400.
    for outcome in outcomes().iter().filter(|o| o.case.starts_with('H')) {
        assert!(
            !outcome.is_narrow() && outcome.is_within_common_limits(),
            "{}",
            outcome.case
        );
        assert!(outcome.snr_db.unwrap() >= 108.0 && outcome.spectrum_db <= 0.05);
    }
}

/// Takes a quarter of an hour on two cores:
/// `cargo test --locked --release -p host-tools --test end-to-end hard_cases:: -- --ignored`.
#[test]
#[ignore = "takes a quarter of an hour"]
fn the_lattice_holds_its_promises_over_a_hundred_million_samples() {
    let outcomes = stress::run(&cases::suite(cases::Length::Long), || ()).unwrap();
    let marathon = outcomes.iter().filter(|o| o.case.contains("part"));
    assert_eq!(marathon.map(|o| o.samples).sum::<usize>(), 100_000_000);
    assert_all_hold(&outcomes);
}

#[test]
fn the_models_are_those_of_the_fixtures() {
    const FIXTURES: &str = include_str!("../fixtures/levinson-order-400.json");
    let file: Value = serde_json::from_str(FIXTURES).unwrap();
    let cases = file["cases"].as_array().unwrap();
    for (model, case) in fixtures().iter().zip(cases) {
        assert_eq!(model.name, case["name"]);
        let exact: Vec<f64> = case["k"]
            .as_array()
            .unwrap()
            .iter()
            .map(|k| k.as_f64().unwrap())
            .collect();
        assert_eq!(model.reflection.len(), exact.len());
        for (stage, (k, exact)) in model.reflection.iter().zip(exact).enumerate() {
            // H4's equations have a condition number of 1e10, and the formula in float64 differs from the fixture in
            // the last digits.
            assert!(
                (k - exact).abs() < 1e-4,
                "{}, stage {}",
                model.name,
                stage + 1
            );
        }
    }
}
