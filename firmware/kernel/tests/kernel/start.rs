//! Beginnings: no voice begins in an empty state or at a level other than its own.
//!
//! Levels are means over many seeds. The exact level is the node's output power.

use model_format::{NodeSpec, TextureSpec, encode};
use stylus_hard_cases::resonance;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer};

use crate::fed::{decibels, mean_square};
use crate::models::{
    at, block, fixture, lattice, lifted, motion, moving, player, rotation, side_by_side, texture, texture_of,
};

/// Blocks of the first 20 ms.
const FIRST_BLOCKS: usize = 10;

/// Largest deviation of the mean level in that time, dB. The ramp of the first block accounts for 0.3 dB of it.
const WITHIN_DB: f64 = 0.5;

/// A resonance of this pole radius at `hz`, with an RMS of 1 m/s².
fn line(hz: f64, radius: f64) -> NodeSpec {
    lattice(&resonance(radius, hz).reflection)
}

/// A texture that is played, and the number of seeds and the power for its test.
struct Case {
    name: String,
    spec: TextureSpec,
    /// Seeds whose mean level has a standard deviation of at most 0.1 dB.
    seeds: u64,
    power: f64,
}

/// Resonances, a broadband texture, and a model of order 400.
fn cases() -> Vec<Case> {
    let cases = [
        ("line of radius 0.9995", line(200.0, 0.9995), 4000),
        // Its θ has 16 bits, but the radius of a line needs some more.
        ("line of radius 0.9999", line(200.0, 0.9999), 4000),
        ("broadband", line(300.0, 0.3), 100),
        ("order 400", fixture("H3").node(4.0), 500),
    ];
    let case = |(name, node, seeds): (&str, NodeSpec, u64)| Case {
        name: name.to_owned(),
        spec: texture_of("test", &node),
        seeds,
        power: f64::from(node.output_power),
    };
    cases.map(case).into()
}

/// Samples of the first 20 ms at `interaction`.
fn first_samples(player: &mut ScenePlayer<'_>, interaction: Interaction) -> Vec<f64> {
    let mut samples = block(player, interaction);
    for _ in 1..FIRST_BLOCKS {
        samples.extend(block(player, interaction));
    }
    samples
}

/// The deviation of the mean level of `first` over the case's seeds, dB.
fn deviation_db(case: &Case, first: impl Fn(u64) -> Vec<f64>) -> f64 {
    let sum: f64 = (0..case.seeds).map(|seed| mean_square(&first(seed))).sum();
    decibels(sum / case.seeds as f64 / case.power)
}

fn assert_within(name: &str, deviation_db: f64) {
    assert!(deviation_db.abs() < WITHIN_DB, "{name}: {deviation_db} dB");
}

#[test]
fn a_texture_is_at_its_level_in_its_first_20_ms() {
    for case in cases() {
        let bytes = encode(std::slice::from_ref(&case.spec)).expect("a valid library");
        let played = deviation_db(&case, |seed| {
            let plan = Plan::of_texture(texture(&bytes));
            first_samples(&mut ScenePlayer::new(plan, seed), at(0.0, moving()))
        });
        assert_within(&case.name, played);
    }
}

/// The lattice was left at another motion, with other coefficients and another level.
#[test]
fn a_lattice_comes_down_at_its_level_wherever_it_was_left() {
    let quiet = line(700.0, 0.999);
    let loud = line(90.0, 0.9995);
    let mut spec = texture_of("test", &quiet);
    spec.nodes[3] = NodeSpec {
        output_power: 16.0,
        ..loud
    };
    let bytes = encode(&[spec.clone()]).expect("a valid library");
    let case = Case {
        name: "lattice, from one motion to another".to_owned(),
        spec,
        seeds: 4000,
        power: 16.0,
    };
    let again = deviation_db(&case, |seed| {
        let mut player = ScenePlayer::new(Plan::of_texture(texture(&bytes)), seed);
        first_samples(&mut player, at(0.0, motion(50.0, 0.5)));
        block(&mut player, lifted());
        block(&mut player, lifted());
        first_samples(&mut player, at(0.0, motion(100.0, 1.0)))
    });
    assert_within(&case.name, again);
}

/// A library of the case's texture, a lattice and another lattice.
fn among_others(case: &Case) -> Vec<u8> {
    let other = |name: &str| {
        let node = line(500.0, 0.9);
        texture_of(name, &node)
    };
    let textures = [case.spec.clone(), other("second"), other("third")];
    encode(&textures).expect("a valid library")
}

/// Three surfaces share two slots, so that at each entry the surface's texture has lost its slot.
#[test]
fn a_texture_is_at_its_level_at_each_entry_of_its_region() {
    let scene = side_by_side(&[0, 1, 2], 0.0);
    for case in cases() {
        let bytes = among_others(&case);
        let entered = deviation_db(&case, |seed| {
            let mut player = player(&bytes, &scene, seed);
            let mut all = Vec::new();
            for _ in 0..2 {
                for other in [150.0, 250.0] {
                    for _ in 0..5 {
                        block(&mut player, at(other, moving()));
                    }
                }
                while !player.block().stages().is_empty() {
                    block(&mut player, Interaction::new(moving(), 250.0, false).expect("finite"));
                }
                all.extend(first_samples(&mut player, at(50.0, moving())));
            }
            all
        });
        assert_within(&case.name, entered);
    }
}

/// For many seeds, after thirty samples with changing rotations: every signal has unit variance, neighbours are
/// uncorrelated, and none came near full scale.
#[test]
fn the_drawn_state_of_a_lattice_is_white_and_stays_so_whatever_its_coefficients() {
    const STAGES: usize = 40;
    const SEEDS: u64 = 4000;
    let unit = f64::from(1u32 << 28);
    let mut squares = [0.0; STAGES];
    let mut neighbours = [0.0; STAGES - 1];
    let mut largest = 0;
    for seed in 0..SEEDS {
        let mut source = Excitation::new(seed);
        let mut state = LatticeState::stationary(STAGES, &mut source);
        assert!(state.backward(400)[STAGES..].iter().all(|&g| g == 0));
        for sample in 0..30i32 {
            let codes = (0..STAGES as i32).map(|stage| (9_973 * (stage + 1) * (sample % 7 + 1)) as i16);
            let rotations: Vec<Rotation> = codes.map(rotation).collect();
            state.filter::<Portable>(&rotations, source.next_sample());
            let loudest = state.backward(STAGES).iter().map(|g| g.unsigned_abs()).max();
            largest = largest.max(loudest.expect("some stages"));
        }
        let signals: Vec<f64> = state.backward(STAGES).iter().map(|&g| f64::from(g) / unit).collect();
        for (square, signal) in squares.iter_mut().zip(&signals) {
            *square += signal * signal;
        }
        for (product, pair) in neighbours.iter_mut().zip(signals.windows(2)) {
            *product += pair[0] * pair[1];
        }
    }
    // Five standard deviations of the means of squares and of products.
    let deviation = 1.0 / (SEEDS as f64).sqrt();
    for (stage, square) in squares.iter().enumerate() {
        let variance = square / SEEDS as f64;
        assert!(
            (variance - 1.0).abs() < 5.0 * 2f64.sqrt() * deviation,
            "stage {stage}: {variance}"
        );
    }
    for (stage, product) in neighbours.iter().enumerate() {
        let correlation = product / SEEDS as f64;
        assert!(correlation.abs() < 5.0 * deviation, "stage {stage}: {correlation}");
    }
    assert!(largest < 7 << 28, "{largest}");
}
