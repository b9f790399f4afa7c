//! What the users of the list and of its player rely on: the models of order 400 and the recursions that make them,
//! compared with 60-digit arithmetic; the player and its filter, compared with the product's synthesis and with wider
//! integers.

use model_format::{CodeSpec, Library, MillimetresPerSecond, Newton, NodeSpec, TextureSpec, encode};
use proptest::prelude::*;
use serde_json::Value;
use stylus_dsp::linear_prediction::{Prediction, error_share, step_down, step_up};
use stylus_hard_cases::{Filter, Lattice, any_at_end, energy, fixtures};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::{Motion, Synthesis};

const FIXTURES: &str = include_str!("../../../tests/fixtures/levinson-order-400.json");

#[test]
fn the_models_are_those_of_the_fixtures() {
    for (model, case) in fixtures().iter().zip(fixture_cases()) {
        assert_eq!(model.name, case["name"]);
        // H4's equations have a condition number of 1e10, so the formula in float64 differs from the fixture in the
        // last digits.
        let difference = largest_difference(&model.reflection, &numbers(&case, "k"));
        assert!(difference < 1e-4, "{}", model.name);
    }
}

fn fixture_cases() -> Vec<Value> {
    let fixtures: Value = serde_json::from_str(FIXTURES).unwrap();
    fixtures["cases"].as_array().unwrap().clone()
}

fn numbers(case: &Value, field: &str) -> Vec<f64> {
    case[field]
        .as_array()
        .expect(field)
        .iter()
        .map(|value| value.as_f64().unwrap())
        .collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Tolerance of a case. Round-off grows with the condition number of the normal equations: about 2e4 for H1, 1e6 for
/// H2, 1e10 for H4.
fn tolerance(name: &str) -> f64 {
    match name {
        "H1a" | "H1b" => 1e-12,
        "H2a" | "H2b" => 1e-10,
        "H3" => 1e-7,
        _ => 1e-5,
    }
}

#[test]
fn reflection_coefficients_and_error_agree_with_sixty_digits() {
    for case in fixture_cases() {
        let name = case["name"].as_str().unwrap();
        let prediction = Prediction::levinson_durbin(&numbers(&case, "r"), 400);
        assert_eq!(prediction.max_order(), 400, "{name}");
        let difference = largest_difference(&prediction.reflection, &numbers(&case, "k"));
        assert!(difference <= tolerance(name), "{name}: {difference}");
        let exact = case["error_over_r0"].as_f64().unwrap();
        let error = prediction.error_power[400];
        let off = (error / exact - 1.0).abs();
        assert!(off <= 1e3 * tolerance(name), "{name}: {off}");
    }
}

#[test]
fn stepping_up_the_exact_reflection_coefficients_gives_the_exact_predictor() {
    for case in fixture_cases() {
        let name = case["name"].as_str().unwrap();
        let (k, a) = (numbers(&case, "k"), numbers(&case, "a"));
        let stepped = step_up(&k);
        let scale = a.iter().fold(1.0, |scale: f64, a| scale.max(a.abs()));
        let difference = largest_difference(&stepped, &a[1..]);
        assert!(difference <= 1e-9 * scale, "{name}: {difference}");
        let exact = case["error_over_r0"].as_f64().unwrap();
        assert!((error_share(&k) / exact - 1.0).abs() < 1e-6, "{name}");
    }
}

#[test]
fn the_mean_of_stable_predictors_is_not_stable_for_the_pairs_that_are_known() {
    let cases = fixture_cases();
    let predictor = |name: &str| {
        let case = cases.iter().find(|case| case["name"] == name).unwrap();
        numbers(case, "a")[1..].to_vec()
    };
    for (a, b) in [("H1a", "H1b"), ("H2a", "H2b")] {
        let (a, b) = (predictor(a), predictor(b));
        let mean: Vec<f64> = a.iter().zip(&b).map(|(a, b)| f64::midpoint(*a, *b)).collect();
        assert!(step_down(&a).is_some() && step_down(&b).is_some());
        assert!(step_down(&mean).is_none());
    }
}

/// The stressed filter and the played one give the same bits.
#[test]
fn a_lattice_and_a_synthesis_play_the_same() {
    let models = fixtures();
    let node = |index: usize| {
        let code = |k: &f64| (k.asin() / model_format::THETA_STEP_RAD).round() as i16;
        let codes = models[index].reflection.iter().map(code).collect();
        NodeSpec::new(4.0, CodeSpec::lattice(codes))
    };
    let nodes = [0, 1, 3, 0].map(node).to_vec();
    let spec = TextureSpec::new("hard", &[100.0, 200.0], &[0.5, 1.0], nodes);
    let bytes = encode(&[spec]).unwrap();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let mut synthesis: Synthesis<'_> = Synthesis::from_rest(texture, 5);
    let mut lattice = Lattice::<Portable>::new(&texture);
    let (mut noise, mut left) = (Excitation::new(5), 0);
    for n in 0..2000u16 {
        let speed = MillimetresPerSecond(f32::from(n % 97) * 3.0);
        let motion = Motion::new(speed, Newton(f32::from(n % 31) / 25.0)).unwrap();
        // In one sample, and in ramps that are cut short.
        let samples = if n < 1000 { 1 } else { 10 };
        synthesis.follow(motion, samples);
        lattice.follow(&texture, motion, left, samples);
        left = samples;
        for _ in 0..samples.min(7) {
            left -= 1;
            let played = lattice.sample(noise.next_sample(), left).0;
            assert_eq!(played, synthesis.next_sample(), "step {n}");
        }
    }
}

proptest! {
    #[test]
    fn energy_is_the_exact_sum_of_squares_and_ends_are_found(
        signals in prop::collection::vec(prop_oneof![any::<i32>(), Just(i32::MIN), Just(i32::MAX)], 0..800),
    ) {
        let exact: u128 = signals.iter().map(|&signal| u128::from(signal.unsigned_abs()).pow(2)).sum();
        prop_assert_eq!(energy(&signals), exact);
        let at_end = signals.iter().any(|&signal| signal == i32::MIN || signal == i32::MAX);
        prop_assert_eq!(any_at_end(&signals), at_end);
    }
}
