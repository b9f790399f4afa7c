//! The direct form against float64, and the end of its stability.

use model_format::limits::MAX_ORDER;
use model_format::{CodeSpec, Coefficients, NodeSpec, OutputSample, Structure, Texture};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::direct::{
    DirectFrame, DirectState, RUN_UP_SAMPLES, SUM_FRACTION_BITS, exponent,
};
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::{self, GridPoint};
use stylus_kernel::level::rms_in_steps;
use stylus_kernel::{Frame, Levels, Playback, Synthesis};

use crate::models::{Model, fixture, library, motion, single, texture};
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
        frame.update::<Portable>(
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

/// A filter's coefficients as they are stored, and its arithmetic in one sum per sample.
struct OneSum {
    codes: Vec<i64>,
    shift: u32,
}

impl OneSum {
    /// The predictor of a texture of one node.
    fn of(texture: &Texture<'_>) -> Self {
        let Coefficients::Direct32 { exponent, codes } = texture.node(0, 0).coefficients else {
            unreachable!("asked for 32 bits");
        };
        let codes = codes.iter().map(|&code| i32::from_le_bytes(code).into());
        Self {
            codes: codes.collect(),
            shift: 31 - SUM_FRACTION_BITS - u32::from(exponent),
        }
    }

    /// The sum over the taps of `lags`, with the outputs before, newest first.
    fn products(&self, lags: impl Iterator<Item = usize>, history: &[i32]) -> i64 {
        lags.filter_map(|lag| Some(self.codes.get(lag - 1)? * i64::from(*history.get(lag - 1)?)))
            .sum()
    }

    /// The output of `excitation` and this sum of products, truncated toward zero.
    fn output(&self, products: i64, excitation: i64) -> i32 {
        let sum = excitation + (products >> self.shift);
        (sum / (1 << SUM_FRACTION_BITS)).clamp(i32::MIN.into(), i32::MAX.into()) as i32
    }
}

/// A texture of one node with `order` taps: those of H1b, damped by the power `radius` of their lag, and a long rest,
/// so that no tap is zero.
fn damped(order: usize, radius: f64) -> Vec<u8> {
    let mut model = fixture("H1b");
    let mut power = 1.0;
    for (lag, h) in model.predictor.iter_mut().enumerate() {
        power *= radius;
        *h = *h * power + 1e-3 * radius * (lag as f64).cos();
    }
    model.predictor.truncate(order);
    single(
        Structure::DirectForm32,
        model.node(Structure::DirectForm32, LOUDEST),
    )
}

fn frame_of(texture: &Texture<'_>) -> DirectFrame {
    let mut frame = DirectFrame::silent(texture);
    let point = GridPoint::locate(texture, motion(100.0, 1.0));
    frame.update::<Portable>(texture, &point, Levels::SILENT, 1);
    frame
}

/// Noise in the steps of a filter's excitation.
fn driven(noise: &mut Excitation) -> i64 {
    i64::from(noise.next_sample()) << 14
}

#[test]
fn with_constant_coefficients_every_sample_is_that_of_one_exact_sum() {
    for order in [1, 4, 5, 6, 40, 41, 42, 76, 77, 78, 150, 399, 400] {
        let bytes = damped(order, 0.97);
        let texture = texture(&bytes);
        let (frame, one_sum) = (frame_of(&texture), OneSum::of(&texture));
        let (mut state, mut noise) = (DirectState::new(), Excitation::new(order as u64));
        for sample in 0..1500 {
            let excitation = driven(&mut noise);
            let products = one_sum.products(1..=order, state.history());
            let expected = one_sum.output(products, excitation);
            let (output, _) = state.filter::<Portable>(&frame, excitation);
            assert_eq!(output, expected, "order {order}, sample {sample}");
        }
    }
}

#[test]
fn after_a_change_every_sample_is_that_of_one_exact_sum_with_the_new_coefficients() {
    let (before, after) = (damped(400, 0.97), damped(400, 0.9));
    let (before, after) = (texture(&before), texture(&after));
    assert_eq!(exponent(&before), exponent(&after), "frames of one texture");
    let frames = [frame_of(&before), frame_of(&after)];
    let one_sums = [OneSum::of(&before), OneSum::of(&after)];
    let (mut state, mut noise) = (DirectState::new(), Excitation::new(9));
    // Blocks of every length from one sample on, so that a change meets every place of the sums ahead.
    for block in 1..60 {
        let turn = block % 2;
        state.begin::<Portable>(&frames[turn]);
        for sample in 0..block {
            let excitation = driven(&mut noise);
            let products = one_sums[turn].products(1..=400, state.history());
            let expected = one_sums[turn].output(products, excitation);
            let (output, _) = state.filter::<Portable>(&frames[turn], excitation);
            assert_eq!(output, expected, "block {block}, sample {sample}");
        }
    }
}

#[test]
fn a_state_of_a_history_goes_on_as_the_one_that_it_is_of() {
    let bytes = damped(400, 0.99);
    let texture = texture(&bytes);
    let frame = frame_of(&texture);
    let (mut state, mut noise) = (DirectState::new(), Excitation::new(4));
    for sample in 0..1000 {
        if sample % 90 < 4 {
            let history = state.history().try_into().expect("all of it");
            let mut resumed = DirectState::from_history::<Portable>(history, &frame);
            let (mut played, mut same) = (state.clone(), noise.clone());
            for _ in 0..20 {
                let excitation = driven(&mut same);
                let output = played.filter::<Portable>(&frame, excitation);
                assert_eq!(resumed.filter::<Portable>(&frame, excitation), output);
            }
        }
        state.filter::<Portable>(&frame, driven(&mut noise));
    }
}

/// An all-pole model of order 40 with sharp resonances at these shares of the sample rate.
fn resonant(places: [f64; 20], pole_radius: f64) -> NodeSpec {
    let mut polynomial = vec![1.0];
    for place in places {
        let angle = core::f64::consts::TAU * place;
        let factor = [
            1.0,
            -2.0 * pole_radius * angle.cos(),
            pole_radius * pole_radius,
        ];
        let mut product = vec![0.0; polynomial.len() + 2];
        for (lag, a) in polynomial.iter().enumerate() {
            for (more, b) in factor.iter().enumerate() {
                product[lag + more] += a * b;
            }
        }
        polynomial = product;
    }
    let predictor: Vec<f64> = polynomial[1..].iter().map(|a| -a).collect();
    let mut impulse = FloatDirect::new(predictor.clone());
    let response = (0..40_000).map(|sample| impulse.filter(f64::from(u8::from(sample == 0))));
    let model = Model {
        name: "resonances".to_owned(),
        reflection: Vec::new(),
        predictor,
        error: 1.0 / response.map(|sample| sample * sample).sum::<f64>(),
    };
    model.node(Structure::DirectForm32, LOUDEST / 16.0)
}

/// A hand that goes to and fro between two nodes, with the paper's interpolation in float64, whose coefficients are all
/// new at once. Sums that mix two predictors err by as much as they say, and run to full scale where resonances are
/// sharp.
#[test]
fn a_voice_in_motion_follows_float64_however_sharp_its_resonances_are() {
    for (pole_radius, least_snr_db) in [(0.9, 110.0), (0.98, 100.0), (0.995, 90.0)] {
        let nodes = [1.0, 1.02].map(|stretch| {
            let places = core::array::from_fn(|index| (0.4 + index as f64) / 42.0 * stretch);
            resonant(places, pole_radius)
        });
        let power = nodes[0].prediction_error_power;
        let nodes = nodes.map(|node| NodeSpec {
            prediction_error_power: power,
            ..node
        });
        let bytes = library(
            Structure::DirectForm32,
            &[50.0, 100.0],
            &[1.0],
            nodes.to_vec(),
        );
        let texture = texture(&bytes);
        let mut frame = Frame::silent(&texture);
        let mut voice = Playback::from_rest(&texture, 3);
        let (mut noise, mut reference) =
            (Excitation::new(3), FloatDirect::new(vec![0.0; MAX_ORDER]));
        let (mut deviation, mut powers) = (Deviation::default(), [0.0; 2]);
        let sigma = f64::from(rms_in_steps(power, OutputSample::FRACTION_BITS))
            / f64::from(1u32 << excitation::FRACTION_BITS);
        // The level is there from the first sample on.
        frame.update::<Portable>(&texture, motion(75.0, 1.0), Levels::SILENT, 10);
        for update in 0..6000u16 {
            let along = (f64::from(update) * 0.002 * 4.0 * core::f64::consts::TAU).sin();
            let moving = motion(75.0 + 24.0 * along as f32, 1.0);
            frame.update::<Portable>(&texture, moving, frame.levels(0), 10);
            voice.begin_frame::<Portable>(&frame, 10);
            reference.set(weighted_mean(
                &texture,
                &GridPoint::locate(&texture, moving),
            ));
            for _ in 0..10 {
                let exact = reference.filter(f64::from(noise.next_sample()) * sigma);
                let output = f64::from(voice.next_sample::<Portable>(&frame).0);
                deviation.add(exact, output);
                powers[0] += exact * exact;
                powers[1] += output * output;
            }
        }
        let level_db = 10.0 * (powers[1] / powers[0]).log10();
        let snr_db = deviation.snr_db();
        println!("pole radius {pole_radius}: level {level_db:+.4} dB, SNR {snr_db:.1} dB");
        assert_eq!(voice.saturations(), 0);
        assert!(level_db.abs() < 0.01, "{pole_radius}: {level_db} dB");
        assert!(snr_db > least_snr_db, "{pole_radius}: {snr_db} dB");
    }
}

/// The model of the paper's interpolation at `point`: the weighted mean of the nodes' coefficients.
fn mean_predictor(texture: &Texture<'_>, point: &GridPoint) -> Vec<f64> {
    let exponents =
        point.nodes.iter().map(
            |&(speed, force)| match texture.node(speed, force).coefficients {
                Coefficients::Direct16 { exponent, .. }
                | Coefficients::Direct32 { exponent, .. } => exponent,
                Coefficients::Lattice { .. } => unreachable!("a direct form"),
            },
        );
    let mut exponents: Vec<u8> = exponents.collect();
    exponents.dedup();
    assert!(
        exponents.len() > 1,
        "nodes of different exponents were meant"
    );
    weighted_mean(texture, point)
}

/// The weighted mean of the coefficients of the nodes around `point`.
fn weighted_mean(texture: &Texture<'_>, point: &GridPoint) -> Vec<f64> {
    let mut predictor = vec![0.0; MAX_ORDER];
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
    }
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
