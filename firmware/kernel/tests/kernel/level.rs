//! Laws of the level between nodes and below the grid, compared with their definitions in floating point.

use model_format::{FadeLaw, Laws, LevelLaw, NodeSpec, TextureSpec, encode};
use proptest::prelude::*;
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::level::{rms_at, rms_in_steps};

use crate::models::{fixtures, motion, spec, texture};

/// Binary digits of the lattice's gain and of the direct form's finest and coarsest history.
const BITS: [u32; 3] = [20, 23, 40];

const SPEEDS: [f32; 3] = [40.0, 100.0, 250.0];
const FORCES: [f32; 2] = [0.5, 2.0];

/// A fraction of the highest power that a texture may have with its number of digits.
fn share() -> impl Strategy<Value = f32> {
    prop_oneof![6 => (-12.0f32..0.0).prop_map(|exponent| 10f32.powf(exponent)), 1 => Just(1.0), 1 => Just(1e-30)]
}

/// The power for that fraction: the highest RMS is 2²⁸ steps.
fn power(share: f32, bits: u32) -> f32 {
    (share * 4f32.powi(28 - bits as i32)).max(f32::from_bits(1))
}

/// A point in a cell at these fractions of its sides, in steps of 2⁻¹⁶, with the weights of [`GridPoint::locate`].
fn point(speed: u32, force: u32) -> GridPoint {
    let both = ((u64::from(speed) * u64::from(force)) >> 16) as u32;
    GridPoint {
        nodes: [(0, 0), (0, 1), (1, 0), (1, 1)],
        weights: [ONE - speed - (force - both), force - both, speed - both, both],
        fade: ONE,
    }
}

fn fraction() -> impl Strategy<Value = u32> {
    prop_oneof![4 => 0..=ONE, 1 => Just(0), 1 => Just(ONE), 1 => Just(1), 1 => Just(ONE - 1)]
}

/// The law in float64: the RMS between these powers with these weights.
fn oracle(law: LevelLaw, terms: &[(f64, f64)]) -> f64 {
    let mean = |of: &dyn Fn(f64) -> f64| terms.iter().map(|(p, weight)| weight * of(*p)).sum::<f64>();
    match law {
        LevelLaw::Power => mean(&|p| p).sqrt(),
        LevelLaw::Amplitude => mean(&f64::sqrt),
        LevelLaw::Logarithm => mean(&|p| p.sqrt().ln()).exp(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn the_level_is_the_laws_own_between_nodes_and_within_their_range(
        shares in prop::array::uniform4(share()), speed in fraction(), force in fraction(), bits in 0usize..3,
    ) {
        let (bits, point) = (BITS[bits], point(speed, force));
        let powers = shares.map(|share| power(share, bits));
        let of = |speed: usize, force: usize| powers[2 * speed + force];
        let step = 2f64.powi(-(bits as i32));
        let terms: Vec<(f64, f64)> =
            powers.iter().zip(point.weights).filter(|&(_, weight)| weight > 0)
                .map(|(&p, weight)| (f64::from(p), f64::from(weight) / f64::from(ONE))).collect();
        let range = terms.iter().map(|(p, _)| rms_in_steps(*p as f32, bits));
        let (lowest, highest) = (range.clone().min().unwrap(), range.max().unwrap());
        for law in LevelLaw::ALL {
            let rms = rms_at(&point, law, bits, of);
            let exact = oracle(law, &terms);
            // A thousandth of 0.01 dB, plus a step of the nodes' levels and a step of the result.
            let error = (f64::from(rms) * step - exact).abs();
            prop_assert!(error <= 2.0 * step + exact * 1.2e-6, "{law}: {rms} {}", exact / step);
            // The mean of powers is computed in single precision, so rounding may put it above the largest power.
            let round_off = if law == LevelLaw::Power { highest / (1 << 22) + 1 } else { 0 };
            prop_assert!(rms >= lowest - round_off.min(lowest) && rms <= highest + round_off, "{law}: {rms}");
        }
    }

    #[test]
    fn at_a_node_every_law_gives_its_own_level_to_the_step(
        shares in prop::array::uniform4(share()), speed in 0u32..2, force in 0u32..2, bits in 0usize..3,
    ) {
        let (bits, point) = (BITS[bits], point(speed * ONE, force * ONE));
        let of = |speed: usize, force: usize| power(shares[2 * speed + force], bits);
        for law in LevelLaw::ALL {
            let rms = rms_at(&point, law, bits, of);
            prop_assert_eq!(rms, rms_in_steps(of(speed as usize, force as usize), bits), "{}", law);
        }
    }

    #[test]
    fn along_an_edge_the_level_does_not_turn_back(
        shares in prop::array::uniform2(share()), from in 0..ONE, steps in 1u32..300, bits in 0usize..3,
    ) {
        let (bits, to) = (BITS[bits], (from + steps).min(ONE));
        let of = |speed: usize, _: usize| power(shares[speed], bits);
        for law in [LevelLaw::Amplitude, LevelLaw::Logarithm] {
            let at = |fraction| rms_at(&point(fraction, 0), law, bits, of);
            let (near, far) = (at(from), at(to));
            let rises = shares[0] <= shares[1];
            prop_assert!(if rises { near <= far } else { near >= far }, "{law}: {near} {far}");
        }
    }

    #[test]
    fn below_the_grid_the_level_fades_by_its_law(
        speed in 0.0f32..=1.2, force in 0.0f32..=1.2,
    ) {
        for fade in FadeLaw::ALL {
            let bytes = lattice(Laws { level: LevelLaw::Power, fade });
            let texture = texture(&bytes);
            let locate = |speed, force| GridPoint::locate(&texture, motion(speed, force)).fade;
            let found = locate(speed * SPEEDS[0], force * FORCES[0]);
            let shares = [speed, force].map(|share| f64::from(share).min(1.0));
            let exact = match fade {
                FadeLaw::Amplitude => shares[0] * shares[1],
                FadeLaw::Power => (shares[0] * shares[1]).sqrt(),
            };
            // Two factors of half a step, and one truncation.
            let error = (f64::from(found) / f64::from(ONE) - exact).abs();
            prop_assert!(error <= 2.1 / f64::from(ONE), "{fade}: {found} {exact}");
            prop_assert!(found <= locate(speed * SPEEDS[0] * 1.01, force * FORCES[0]));
            // Exactly zero at rest, exactly one at the grid's edge, and no jump in between.
            prop_assert_eq!((locate(0.0, force * FORCES[0]), locate(speed * SPEEDS[0], 0.0)), (0, 0));
            prop_assert_eq!(locate(SPEEDS[0], FORCES[0]), ONE);
            prop_assert!(locate(SPEEDS[0].next_down(), FORCES[0]) >= ONE - 1);
        }
    }
}

fn lattice(laws: Laws) -> Vec<u8> {
    let model = &fixtures()[0];
    let node = |index: u8| model.node(f32::from(index) + 1.0);
    let spec = with_laws((0..6).map(node).collect(), laws);
    encode(&[spec]).expect("a valid library")
}

fn with_laws(nodes: Vec<NodeSpec>, laws: Laws) -> TextureSpec {
    TextureSpec {
        laws,
        ..spec(&SPEEDS, &FORCES, nodes)
    }
}
