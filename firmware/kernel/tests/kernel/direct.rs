//! The direct form against float64, and the end of its stability.

use model_format::limits::MAX_ORDER;
use model_format::{CodeSpec, Coefficients, OutputSample, Structure, Texture};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::direct::{DirectFrame, DirectState, RUN_UP_SAMPLES};
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::{self, GridPoint};
use stylus_kernel::level::rms_in_steps;
use stylus_kernel::{Levels, Synthesis};

use crate::models::{fixture, library, motion, single, texture};
use crate::reference::{Deviation, FloatDirect};

/// The power at which a step of the history is a step of the output, so that the output shows the filter itself: an RMS
/// of an eighth of full scale.
const LOUDEST: f32 = 65_536.0;

#[test]
fn thirty_two_bits_are_90_db_from_float64_with_the_same_coefficients() {
    for name in ["H1a", "H2a"] {
        let node = fixture(name).node(Structure::DirectForm32, LOUDEST);
        let CodeSpec::Direct32 { exponent, codes } = &node.codes else {
            unreachable!("asked for 32 bits");
        };
        let scale = 2f64.powi(i32::from(*exponent) - 31);
        let mut reference = FloatDirect::new(codes.iter().map(|&h| f64::from(h) * scale).collect());
        let sigma = f64::from(rms_in_steps(
            node.prediction_error_power,
            OutputSample::FRACTION_BITS,
        ));
        let excitation_unit = f64::from(1u32 << excitation::FRACTION_BITS);

        let bytes = single(Structure::DirectForm32, node);
        let texture = texture(&bytes);
        let mut frame = DirectFrame::silent(&texture);
        frame.update(
            &texture,
            &GridPoint::locate(&texture, motion(100.0, 1.0)),
            Levels::SILENT,
            1,
        );
        let (mut state, mut noise) = (DirectState::new(), Excitation::new(3));
        let mut deviation = Deviation::default();
        for _ in 0..60_000 {
            let excitation = noise.next_sample();
            let (output, saturated) = state.next_sample::<Portable>(&frame, excitation, 0);
            assert!(!saturated, "{name}");
            let exact = reference.filter(f64::from(excitation) / excitation_unit * sigma);
            deviation.add(exact, f64::from(output.0));
        }
        println!("{name}: SNR {:.1} dB", deviation.snr_db());
        assert!(
            deviation.snr_db() >= 90.0,
            "{name}: SNR {} dB",
            deviation.snr_db()
        );
    }
}

/// The model of the paper's interpolation at `point`: the weighted mean of the nodes' coefficients.
fn mean_predictor(texture: &Texture<'_>, point: &GridPoint) -> Vec<f64> {
    let mut predictor = vec![0.0; MAX_ORDER];
    let mut exponents = Vec::new();
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        let (exponent, fraction_bits, codes): (_, _, Vec<f64>) =
            match texture.node(speed, force).coefficients {
                Coefficients::Direct16 { exponent, codes } => (
                    exponent,
                    15,
                    codes
                        .iter()
                        .map(|&code| f64::from(i16::from_le_bytes(code)))
                        .collect(),
                ),
                Coefficients::Direct32 { exponent, codes } => (
                    exponent,
                    31,
                    codes
                        .iter()
                        .map(|&code| f64::from(i32::from_le_bytes(code)))
                        .collect(),
                ),
                Coefficients::Lattice { .. } => unreachable!("a direct form"),
            };
        let scale = 2f64.powi(i32::from(exponent) - fraction_bits) * f64::from(weight)
            / f64::from(grid::ONE);
        for (h, code) in predictor.iter_mut().zip(codes) {
            *h += code * scale;
        }
        exponents.push(exponent);
    }
    exponents.dedup();
    assert!(
        exponents.len() > 1,
        "nodes of different exponents were meant"
    );
    predictor
}

/// Four different nodes, between which the direct form is stable.
#[test]
fn between_nodes_the_coefficients_are_the_weighted_mean() {
    for structure in [Structure::DirectForm32, Structure::DirectForm16] {
        let damped = |radius: f64| {
            let mut model = fixture("H1b");
            let mut power = 1.0;
            for h in &mut model.predictor {
                power *= radius;
                *h *= power;
            }
            model.node(structure, LOUDEST)
        };
        let nodes = [0.97, 0.3, 1.0, 0.5].map(damped).to_vec();
        let bytes = library(structure, &[50.0, 100.0], &[0.5, 1.0], nodes);
        let texture = texture(&bytes);
        let moving = motion(80.0, 0.6);
        let mut reference = FloatDirect::new(mean_predictor(
            &texture,
            &GridPoint::locate(&texture, moving),
        ));
        let power = texture.node(0, 0).prediction_error_power;
        let sigma = f64::from(rms_in_steps(power, OutputSample::FRACTION_BITS));

        let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 3);
        synthesis.follow(moving, 1);
        let mut noise = Excitation::new(3);
        let mut deviation = Deviation::default();
        for sample in 0..20_000 + RUN_UP_SAMPLES {
            let excitation =
                f64::from(noise.next_sample()) / f64::from(1u32 << excitation::FRACTION_BITS);
            let filtered = reference.filter(excitation * sigma);
            if sample >= RUN_UP_SAMPLES {
                deviation.add(filtered, f64::from(synthesis.next_sample().0));
            }
        }
        assert_eq!(synthesis.saturations(), 0);
        let snr_db = deviation.snr_db();
        println!("between nodes, {structure}: SNR {snr_db:.1} dB");
        assert!(snr_db >= 120.0, "{structure}: SNR {snr_db} dB");
    }
}

/// Level of a texture of one node, dB relative to the node's power, over 20 s.
fn level_db(structure: Structure, name: &str) -> f64 {
    const POWER: f32 = 4.0;
    let bytes = single(structure, fixture(name).node(structure, POWER));
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 4);
    synthesis.follow(motion(100.0, 1.0), 1);
    let mut power = 0.0;
    for _ in 0..100_000 {
        power += f64::from(synthesis.next_sample().metres_per_second_squared().0).powi(2);
    }
    assert_eq!(synthesis.saturations(), 0, "{name}");
    10.0 * (power / 100_000.0 / f64::from(POWER)).log10()
}

/// Coefficients of 16 bits move the poles of steep models, so that only the flatter ones keep their level.
#[test]
fn sixteen_bits_keep_the_level_of_models_that_are_not_steep() {
    for name in ["H1a", "H1b", "H2b"] {
        let level_db = level_db(Structure::DirectForm16, name);
        println!("{name}: {level_db:+.2} dB");
        assert!(level_db.abs() < 1.0, "{name}: level {level_db} dB");
    }
}

/// The steepest model is unstable in 16 bits: it saturates and goes on.
#[test]
fn sixteen_bits_survive_a_model_that_they_make_unstable() {
    let structure = Structure::DirectForm16;
    let bytes = single(structure, fixture("H4").node(structure, LOUDEST));
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 5);
    synthesis.follow(motion(100.0, 1.0), 1);
    for _ in 0..20_000 {
        synthesis.next_sample();
    }
    assert!(synthesis.saturations() > 0);
}

/// Number of saturated samples in 10 s: half of the time between the nodes at 100 and 200 mm/s, the rest on the way
/// from one to the other.
fn saturations_between(structure: Structure, low: &str, high: &str) -> u32 {
    let nodes = [low, high]
        .map(|name| fixture(name).node(structure, 1.0))
        .to_vec();
    let bytes = library(structure, &[100.0, 200.0], &[1.0], nodes);
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 6);
    for update in 0..5000u16 {
        let speed = match update {
            0..2500 => 150.0,
            _ => 150.0 + 50.0 * (f32::from(update) / 40.0).sin(),
        };
        synthesis.follow(motion(speed, 1.0), 10);
        for _ in 0..10 {
            synthesis.next_sample();
        }
    }
    synthesis.saturations()
}

#[test]
fn between_two_stable_nodes_the_direct_form_saturates_and_the_lattice_does_not() {
    for (low, high) in [("H1a", "H1b"), ("H2a", "H2b")] {
        for structure in [Structure::DirectForm16, Structure::DirectForm32] {
            let saturations = saturations_between(structure, low, high);
            println!("{low}/{high}, {structure}: {saturations} of 50 000");
            assert!(
                saturations > 1000,
                "{low}/{high}, {structure}: {saturations}"
            );
        }
        assert_eq!(
            saturations_between(Structure::NormalisedLattice, low, high),
            0
        );
    }
}
