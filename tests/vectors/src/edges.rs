//! Operands at the ends of their ranges, which no texture's noise reaches.

use model_format::limits::MAX_ORDER;
use stylus_kernel::arithmetic::{Arithmetic, TURN_TAPS, Turn};
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::{Rotation, THETA_QUARTER_TURN};

const MOST_TURNS: usize = 3;
const SAMPLES: usize = 32;
const MOST_FEW_STAGES: usize = 33;

/// Passes to `sink` the results of the kernel's arithmetic for operands at the ends of their ranges.
pub fn edges<A: Arithmetic>(mut sink: impl FnMut(u32)) {
    sums_of_products::<A>(&mut sink);
    for theta in [-THETA_QUARTER_TURN, -1, THETA_QUARTER_TURN / 2, i32::MAX] {
        lattice_at_full_scale::<A>(theta, &mut sink);
    }
    lattices_of_few_stages::<A>(&mut sink);
}

/// Sums of words over their whole range, in an order that pairs each with each, so that sums wrap.
fn sums_of_products<A: Arithmetic>(sink: &mut impl FnMut(u32)) {
    const WORDS: [i32; 7] = [i32::MIN, i32::MIN + 1, -1, 0, 1, 0x1234_5678, i32::MAX];
    let turns = |step: usize| -> [Turn; MOST_TURNS] {
        core::array::from_fn(|turn| {
            core::array::from_fn(|tap| WORDS[(turn * TURN_TAPS + tap) / step % WORDS.len()])
        })
    };
    let (a, b) = (turns(1), turns(WORDS.len()));
    for length in 0..=MOST_TURNS {
        let sum = A::sum_of_products(&a[..length], &b);
        sink(sum as u32);
        sink((sum >> 32) as u32);
    }
}

/// Lattices whose stages all rotate by ±`theta` and whose signals are all at an end of their range, so that sums
/// saturate.
fn lattice_at_full_scale<A: Arithmetic>(theta: i32, sink: &mut impl FnMut(u32)) {
    let to_and_fro = [Rotation::from_theta(theta), Rotation::from_theta(-theta)];
    let rotations: [Rotation; MAX_ORDER] = core::array::from_fn(|stage| to_and_fro[stage / 2 % 2]);
    let ends = [i32::MAX, i32::MIN, i32::MIN];
    let state = LatticeState::from_backward(core::array::from_fn(|stage| ends[stage % 3]));
    one_by_one_and_two_by_two::<A>(&rotations, &state, |n| ends[n % 3], sink);
}

/// Lattices of every length modulo the number of stages that are computed together; each stage rotates differently.
fn lattices_of_few_stages<A: Arithmetic>(sink: &mut impl FnMut(u32)) {
    let rotations: [Rotation; MOST_FEW_STAGES] = core::array::from_fn(|stage| {
        Rotation::from_theta(THETA_QUARTER_TURN / 9 * (stage as i32 % 17 - 8))
    });
    for stages in 0..=MOST_FEW_STAGES {
        let excitation = |n: usize| (n as i32 - 11) * 0x0654_3217;
        let rotations = &rotations[..stages];
        one_by_one_and_two_by_two::<A>(rotations, &LatticeState::new(), excitation, sink);
    }
}

/// The samples of a lattice from `state` on and its final state, computed sample by sample and two samples per pass.
fn one_by_one_and_two_by_two<A: Arithmetic>(
    rotations: &[Rotation],
    state: &LatticeState,
    excitation: impl Fn(usize) -> i32,
    sink: &mut impl FnMut(u32),
) {
    let (mut single, mut double) = (state.clone(), state.clone());
    for n in 0..SAMPLES {
        sink(single.filter::<A>(rotations, excitation(n)) as u32);
    }
    for n in (0..SAMPLES).step_by(2) {
        let pair = [excitation(n), excitation(n + 1)];
        for output in double.filter_two::<A>(rotations, pair) {
            sink(output as u32);
        }
    }
    for state in [single, double] {
        for &backward in state.backward(rotations.len()) {
            sink(backward as u32);
        }
    }
}
