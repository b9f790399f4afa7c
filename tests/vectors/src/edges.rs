//! The ends of the ranges, which no texture's noise reaches.

use model_format::limits::MAX_ORDER;
use stylus_kernel::arithmetic::{Arithmetic, TURN_TAPS, Turn};
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::{Rotation, THETA_QUARTER_TURN};

const MOST_TURNS: usize = 3;
const SAMPLES: usize = 32;
const MOST_FEW_STAGES: usize = 33;

/// Gives `sink` the words that the kernel's arithmetic makes of operands at the ends of their ranges.
pub fn edges<A: Arithmetic>(mut sink: impl FnMut(u32)) {
    sums_of_products::<A>(&mut sink);
    for theta in [-THETA_QUARTER_TURN, -1, THETA_QUARTER_TURN / 2, i32::MAX] {
        lattice_at_full_scale::<A>(theta, &mut sink);
    }
    lattices_of_few_stages::<A>(&mut sink);
}

/// Sums of words from end to end of their range, in an order that brings each together with each, so that sums wrap.
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

/// All stages rotate by `theta` or back, and all signals are at an end of their range, so that sums saturate.
fn lattice_at_full_scale<A: Arithmetic>(theta: i32, sink: &mut impl FnMut(u32)) {
    let to_and_fro = [Rotation::from_theta(theta), Rotation::from_theta(-theta)];
    let rotations: [Rotation; MAX_ORDER] = core::array::from_fn(|stage| to_and_fro[stage / 2 % 2]);
    let ends = [i32::MAX, i32::MIN, i32::MIN];
    let mut state = LatticeState::from_backward(core::array::from_fn(|stage| ends[stage % 3]));
    for n in 0..SAMPLES {
        sink(state.filter::<A>(&rotations, ends[n % 3]) as u32);
    }
    for &backward in state.backward(MAX_ORDER) {
        sink(backward as u32);
    }
}

/// As many stages as leave every remainder where stages are taken some at a time; each stage rotates otherwise.
fn lattices_of_few_stages<A: Arithmetic>(sink: &mut impl FnMut(u32)) {
    let rotations: [Rotation; MOST_FEW_STAGES] = core::array::from_fn(|stage| {
        Rotation::from_theta(THETA_QUARTER_TURN / 9 * (stage as i32 % 17 - 8))
    });
    for stages in 0..=MOST_FEW_STAGES {
        let mut state = LatticeState::new();
        for n in 0..SAMPLES {
            let excitation = (n as i32 - 11) * 0x0654_3217;
            sink(state.filter::<A>(&rotations[..stages], excitation) as u32);
        }
        for &backward in state.backward(stages) {
            sink(backward as u32);
        }
    }
}
