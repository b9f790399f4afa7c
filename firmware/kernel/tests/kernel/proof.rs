//! The proof of direct forms, against the step-down recursion and against what is known of models.

use model_format::limits::MAX_ORDER;
use model_format::{CodeSpec, Library, NodeFlags, NodeSpec, Structure, Texture, encode};
use proptest::prelude::*;
use stylus_kernel::direct::exponent;
use stylus_kernel::proof::{
    Cause, CellProof, Proof, Refusal, UNIT_BITS, checks_per_cell, is_needed, margin_byte,
};

use crate::models::{fixture, fixtures, library, spec, texture};

const DIRECT: [Structure; 2] = [Structure::DirectForm16, Structure::DirectForm32];

/// A node of 32 bits with these predictor coefficients.
fn node(predictor: &[f64]) -> NodeSpec {
    let sum: f64 = predictor.iter().map(|h| h.abs()).sum();
    let exponent = (sum.log2().floor() + 1.0).max(0.0) as u8;
    let code = |h: &f64| (h * 2f64.powi(31 - i32::from(exponent))).round() as i32;
    NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.5,
        flags: NodeFlags::NONE,
        codes: CodeSpec::Direct32 {
            exponent,
            codes: predictor.iter().map(code).collect(),
        },
    }
}

/// A library of one row of nodes along the speed axis.
fn row(predictors: &[Vec<f64>]) -> Vec<u8> {
    let speeds: Vec<f32> = (1..=predictors.len()).map(|speed| speed as f32).collect();
    let nodes = predictors.iter().map(|predictor| node(predictor)).collect();
    library(Structure::DirectForm32, &speeds, &[1.0], nodes)
}

/// The predictor of these reflection coefficients, by the step-up recursion.
fn step_up(reflection: &[f64]) -> Vec<f64> {
    let mut a: Vec<f64> = Vec::new();
    for &k in reflection {
        let turned: Vec<f64> = a.iter().rev().copied().collect();
        for (a, turned) in a.iter_mut().zip(turned) {
            *a += k * turned;
        }
        a.push(k);
    }
    a.iter().map(|a| -a).collect()
}

/// Returns whether 1/A is stable, by the step-down recursion in f64.
fn is_stable(predictor: &[f64]) -> bool {
    let mut a: Vec<f64> = predictor.iter().map(|h| -h).collect();
    while let Some(k) = a.pop() {
        if k.abs() >= 1.0 {
            return false;
        }
        let turned: Vec<f64> = a.iter().rev().copied().collect();
        for (a, turned) in a.iter_mut().zip(turned) {
            *a = (*a - k * turned) / (1.0 - k * k);
        }
    }
    true
}

/// The predictor with these pairs of poles: radius and angle, rad.
fn with_poles(poles: &[(f64, f64)]) -> Vec<f64> {
    let mut a = vec![1.0];
    for (radius, angle) in poles {
        let factor = [1.0, -2.0 * radius * angle.cos(), radius * radius];
        let mut product = vec![0.0; a.len() + 2];
        for (i, a) in a.iter().enumerate() {
            for (j, b) in factor.iter().enumerate() {
                product[i + j] += a * b;
            }
        }
        a = product;
    }
    a[1..].iter().map(|a| -a).collect()
}

/// Least |A| on the unit circle: by a fine grid, and by ever finer ones around its least points.
///
/// Next to a pole |A| is a V whose tip lies between the points of any one grid.
fn least(predictor: &[f64]) -> f64 {
    let at = |omega: f64| {
        let (mut re, mut im) = (1.0, 0.0);
        for (h, i) in predictor.iter().zip(1..) {
            re -= h * (omega * f64::from(i)).cos();
            im += h * (omega * f64::from(i)).sin();
        }
        f64::hypot(re, im)
    };
    let points = 20_000;
    let step = std::f64::consts::PI / f64::from(points);
    let values: Vec<f64> = (-1..=points + 1).map(|i| at(f64::from(i) * step)).collect();
    let tips = (0..=points).filter(|&i| {
        let [before, value, after] = [0, 1, 2].map(|beside| values[i as usize + beside]);
        value <= before && value <= after
    });
    let refined = tips.map(|tip| {
        let (mut omega, mut step, mut value) = (f64::from(tip) * step, step, f64::INFINITY);
        while step > 1e-12 {
            step /= 8.0;
            let beside = (-8..=8).map(|i| omega + f64::from(i) * step);
            (omega, value) = beside
                .map(|omega| (omega, at(omega)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .expect("there are points");
        }
        value
    });
    refined.fold(f64::INFINITY, f64::min)
}

/// The margin of the first cell, and the number of parts that were tried.
fn margin(texture: Texture<'_>) -> (Result<f64, Cause>, u32) {
    let mut proof = CellProof::new(texture, 0, 0);
    let unit = 2f64.powi(exponent(&texture) as i32 - UNIT_BITS as i32);
    let outcome = loop {
        match proof.step() {
            Ok(true) => {}
            Ok(false) => break Ok(proof.margin() as f64 * unit),
            Err(refusal) => break Err(refusal.cause),
        }
    };
    (outcome, proof.checks())
}

/// The whole proof of a library, in steps; the progress never goes back.
fn prove(library: Library<'_>) -> Result<(), Refusal> {
    let mut proof = Proof::new(library);
    let mut before = 0;
    while proof.step()? {
        assert!(proof.permille() >= before && proof.permille() <= 1000);
        before = proof.permille();
    }
    assert!(before == 1000 || !is_needed(&library));
    Ok(())
}

/// The verdict on a row of nodes that claims nothing.
fn verdict(predictors: &[Vec<f64>]) -> Result<(), Cause> {
    let bytes = row(predictors);
    let library = Library::decode_uncertified(&bytes).expect("it is a library");
    prove(library).map_err(|refusal| refusal.cause)
}

#[test]
fn all_fixtures_are_proved_where_the_step_down_recursion_finds_them_stable() {
    for model in fixtures() {
        for structure in DIRECT {
            let bytes = library(structure, &[1.0], &[1.0], vec![model.node(structure, 1.0)]);
            let texture = texture(&bytes);
            let (found, checks) = margin(texture);
            println!("{} {structure}: {found:?}, {checks} parts", model.name);
            let limit = checks_per_cell(MAX_ORDER);
            assert!(
                checks < limit / 4,
                "{} {structure}: {checks} parts",
                model.name
            );
        }
    }
}

#[test]
fn fixtures_that_are_stable_alone_and_not_together_are_refused() {
    for (a, b) in [("H1a", "H1b"), ("H2a", "H2b")] {
        for structure in DIRECT {
            let nodes = [a, b].map(|name| fixture(name).node(structure, 1.0));
            let bytes = library(structure, &[1.0, 2.0], &[1.0], nodes.to_vec());
            let refusal = prove(Library::decode_uncertified(&bytes).unwrap()).unwrap_err();
            assert_eq!(refusal.cause, Cause::OnCircle, "{a} {b}");
        }
    }
}

#[test]
fn the_known_pair_of_order_three_is_refused_at_its_frequency() {
    let pair = [vec![2.7, -2.43, 0.729], vec![-2.7, -2.43, -0.729]];
    let bytes = row(&pair);
    let refusal = prove(Library::decode_uncertified(&bytes).unwrap()).unwrap_err();
    // Three times the angle of (1 - 0.9 e^(-jω)) / (1 + 0.9 e^(-jω)) is half a turn: tan 60° = 1.8 sin ω / 0.19.
    let expected = (3f64.sqrt() * 0.19 / 1.8).asin() / std::f64::consts::TAU;
    let found = f64::from(refusal.frequency) / 2f64.powi(32);
    assert!((found - expected).abs() < 0.02, "{found} for {expected}");
    assert_eq!((refusal.texture, refusal.speed, refusal.force), (0, 0, 0));
    for alone in pair {
        assert_eq!(verdict(&[alone]), Ok(()));
    }
}

#[test]
fn an_unstable_node_is_refused_though_it_is_never_zero_on_the_circle() {
    for unstable in [
        vec![2.5, -1.0],
        vec![0.0, -4.0],
        vec![1.5],
        vec![-1.5],
        vec![0.0, 4.0],
        vec![0.0, 0.0, 1.2],
    ] {
        assert!(!is_stable(&unstable));
        assert_eq!(verdict(&[unstable]), Err(Cause::Outside));
    }
}

#[test]
fn a_pole_on_the_circle_is_refused() {
    for predictor in [
        vec![1.0],
        vec![-1.0],
        with_poles(&[(1.0, 0.7)]),
        with_poles(&[(0.5, 1.0), (1.0, 2.0)]),
    ] {
        assert_eq!(verdict(&[predictor]), Err(Cause::OnCircle));
    }
}

#[test]
fn poles_next_to_the_circle_are_told_apart() {
    let around = |radius: f64| {
        [
            with_poles(&[(radius, 1.0)]),
            with_poles(&[(radius, 0.1)]),
            with_poles(&[(radius, 3.1)]),
            with_poles(&[(0.9, 0.5), (radius, 1.0), (0.8, 2.0)]),
        ]
    };
    for predictor in around(0.99999) {
        assert_eq!(verdict(&[predictor]), Ok(()), "inside");
    }
    for predictor in around(1.00001) {
        assert!(verdict(&[predictor]).is_err(), "outside");
    }
}

/// The least |A| of this node lies between the points of a grid of 200 000.
#[test]
fn the_margin_of_a_pole_next_to_the_circle_is_half_of_the_least_value_or_more() {
    let predictor = step_up(&[0.0, 0.971_287, -0.850_066, -0.988_394, -0.940_203]);
    let bytes = row(std::slice::from_ref(&predictor));
    let (least, margin) = (least(&predictor), margin(texture(&bytes)).0.unwrap());
    assert!(
        margin <= least && margin >= 0.4 * least,
        "{margin} of {least}"
    );
}

/// A comb of 200 pairs of poles, one node of the highest order: 1 + r⁴⁰⁰ z⁻⁴⁰⁰.
#[test]
fn two_hundred_resonances_at_the_circle_are_proved_or_refused_by_their_radius() {
    let comb = |radius: f64| {
        let mut predictor = vec![0.0; MAX_ORDER];
        predictor[MAX_ORDER - 1] = -radius.powi(MAX_ORDER as i32);
        predictor
    };
    assert_eq!(verdict(&[comb(0.99999)]), Ok(()));
    assert_eq!(verdict(&[comb(1.0)]), Err(Cause::OnCircle));
    assert_eq!(verdict(&[comb(1.000_01)]), Err(Cause::Outside));
}

#[test]
fn poles_that_zeros_of_no_node_cancel_and_every_exponent_are_proved() {
    // The same filter at every exponent that has room for its codes.
    for exponent in 1..=10u8 {
        let codes = vec![
            (1.9 * 0.95 * 2f64.powi(31 - i32::from(exponent))) as i32,
            -(0.9025 * 2f64.powi(31 - i32::from(exponent))) as i32,
        ];
        let mut spec_node = node(&[]);
        spec_node.codes = CodeSpec::Direct32 { exponent, codes };
        let bytes = library(Structure::DirectForm32, &[1.0], &[1.0], vec![spec_node]);
        assert!(margin(texture(&bytes)).0.is_ok(), "exponent {exponent}");
    }
}

#[test]
fn a_claim_that_was_found_is_verified_and_the_next_is_not_for_long() {
    let nodes: Vec<Vec<f64>> = (0..4)
        .map(|speed| with_poles(&[(0.97, 0.5 + 0.02 * f64::from(speed)), (0.9, 2.0)]))
        .collect();
    let bytes = row(&nodes);
    let texture = texture(&bytes);
    let exponent = exponent(&texture);
    let found: Vec<u8> = (0..3)
        .map(|cell| margin_byte(CellProof::new(texture, cell, 0).run().unwrap(), exponent))
        .collect();
    let claimed = |margins: Vec<u8>| {
        let speeds: Vec<f32> = (1..=4).map(|speed| speed as f32).collect();
        let nodes = nodes.iter().map(|predictor| node(predictor)).collect();
        let mut spec = spec(Structure::DirectForm32, &speeds, &[1.0], nodes);
        spec.cell_margins = margins;
        let bytes = encode(&[spec]).unwrap();
        prove(Library::decode(&bytes).unwrap())
    };
    assert_eq!(claimed(found.clone()), Ok(()));
    for cell in 0..3 {
        let mut margins = found.clone();
        // A factor of four is more than any bound gives away.
        margins[cell] -= 8;
        let refusal = claimed(margins).unwrap_err();
        assert_eq!((refusal.speed, refusal.cause), (cell, Cause::Margin));
    }
}

#[test]
fn lattices_need_no_proof() {
    let model = fixture("H3");
    let node = model.node(Structure::NormalisedLattice, 1.0);
    let bytes = library(Structure::NormalisedLattice, &[1.0], &[1.0], vec![node]);
    let library = Library::decode(&bytes).unwrap();
    assert!(!is_needed(&library));
    assert_eq!(prove(library), Ok(()));
}

fn reflections() -> impl Strategy<Value = Vec<f64>> {
    prop_oneof![
        prop::collection::vec(-0.98f64..0.98, 0..8),
        prop::collection::vec(-1.02f64..1.02, 0..8),
        prop::collection::vec(-0.3f64..0.3, 0..60),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Against the step-down recursion at many weights: what is proved is stable at all of them.
    #[test]
    fn what_is_proved_is_stable_at_all_weights(reflections in prop::collection::vec(reflections(), 1..=4)) {
        let predictors: Vec<Vec<f64>> = reflections.iter().map(|k| step_up(k)).collect();
        prop_assume!(predictors.iter().all(|h| h.iter().map(|h| h.abs()).sum::<f64>() < 900.0));
        let order = predictors.iter().map(Vec::len).max().unwrap_or(0);
        let (speeds, forces): (&[f32], &[f32]) = match predictors.len() {
            4 => (&[1.0, 2.0], &[1.0, 2.0]),
            3 => (&[1.0, 2.0, 3.0], &[1.0]),
            2 => (&[1.0], &[1.0, 2.0]),
            _ => (&[1.0], &[1.0]),
        };
        let nodes = predictors.iter().map(|predictor| node(predictor)).collect();
        let bytes = library(Structure::DirectForm32, speeds, forces, nodes);
        let found = prove(Library::decode_uncertified(&bytes).unwrap());
        let cells: Vec<Vec<usize>> = match predictors.len() {
            4 => vec![vec![0, 1, 2, 3]],
            3 => vec![vec![0, 1], vec![1, 2]],
            count => vec![(0..count).collect()],
        };
        let mut all_stable = true;
        for cell in cells {
            for step in 0..200u32 {
                let weights: Vec<f64> = match cell.len() {
                    4 => {
                        let (s, f) = (f64::from(step % 15) / 14.0, f64::from(step / 15) / 13.0);
                        vec![(1.0 - s) * (1.0 - f), (1.0 - s) * f, s * (1.0 - f), s * f]
                    }
                    2 => vec![1.0 - f64::from(step) / 199.0, f64::from(step) / 199.0],
                    _ => vec![1.0],
                };
                let mut mean = vec![0.0; order];
                for (&node, weight) in cell.iter().zip(weights) {
                    for (sum, h) in mean.iter_mut().zip(&predictors[node]) {
                        *sum += weight * h;
                    }
                }
                all_stable &= is_stable(&mean);
            }
        }
        if found.is_ok() {
            prop_assert!(all_stable);
        }
    }

    /// A node alone is proved if it is stable with room for the rounding of its coefficients.
    #[test]
    fn a_stable_node_alone_is_proved_and_its_margin_is_true(k in reflections()) {
        let predictor = step_up(&k);
        prop_assume!(predictor.iter().map(|h| h.abs()).sum::<f64>() < 900.0);
        let bytes = row(std::slice::from_ref(&predictor));
        let texture = texture(&bytes);
        let found = margin(texture).0;
        if is_stable(&predictor) {
            let least = least(&predictor[..]);
            let unit = 2f64.powi(exponent(&texture) as i32 - UNIT_BITS as i32);
            let allowance = (46_500.0 + 512.0 * predictor.len() as f64) * unit;
            if let Ok(margin) = found {
                prop_assert!(margin <= least * (1.0 + 1e-6), "{margin} of {least}");
                prop_assert!(margin >= 0.4 * least - 2.0 * allowance, "{margin} of {least}");
            } else {
                prop_assert!(least < 3.0 * allowance, "{found:?} for {least}");
            }
        } else {
            prop_assert!(found.is_err());
        }
    }

    /// Any codes at all: a proof ends, without a panic or an overflow.
    #[test]
    fn any_codes_end_in_a_verdict(
        codes in prop::collection::vec(prop_oneof![any::<i16>(), -40i16..40, Just(i16::MIN), Just(0)], 1..=400),
        exponents in prop::array::uniform4(0u8..=10), silent in any::<bool>(),
    ) {
        let node = |exponent: u8| {
            let mut codes = codes.clone();
            let most = (1u64 << 25 >> exponent) as i64;
            let mut sum = 0;
            for code in &mut codes {
                sum += i64::from(code.unsigned_abs());
                if sum > most {
                    *code = 0;
                }
            }
            NodeSpec { codes: CodeSpec::Direct16 { exponent, codes }, ..node(&[]) }
        };
        let mut nodes: Vec<NodeSpec> = exponents.map(node).to_vec();
        if silent {
            nodes[0].codes = CodeSpec::Direct16 { exponent: 0, codes: Vec::new() };
        }
        let bytes = library(Structure::DirectForm16, &[1.0, 2.0], &[1.0, 2.0], nodes);
        let _ = prove(Library::decode_uncertified(&bytes).unwrap());
    }
}
