//! All-pole filters of order 400 by others, for a trace beside ours: idsp's cascades of second-order sections, and
//! plain Rust in single precision; and ours alone. Like those of [`crate::counted`], the functions are found by their
//! names.
//!
//! The filter alone is counted, without excitation and level.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_precision_loss,
    reason = "coefficients are made up, and any do"
)]

use core::hint::black_box;

use dsp_fixedpoint::Q;
use dsp_process::SplitProcess;
use idsp::iir::{Biquad, Cascade, DirectForm};
use kernel_vectors::PEER_SAMPLES;
use model_format::Library;
use model_format::limits::MAX_ORDER;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::variants::direct::{DirectFrame, DirectState};
use stylus_realtime::CortexM;

use crate::LIBRARY;

/// The number of sections, of two poles each. Their zeros are computed too, because idsp has no others.
const SECTIONS: usize = MAX_ORDER / 2;

type Fixed = Q<i32, i64, 30>;
type FixedCascade = Cascade<[Biquad<Fixed>; SECTIONS]>;
type FixedState = DirectForm<i32, SECTIONS>;
type FloatCascade = Cascade<[Biquad<f32>; SECTIONS]>;
type FloatState = DirectForm<f32, SECTIONS>;

/// Runs each filter on noise.
pub fn play() {
    // Poles of radius 0.5, evenly around the circle.
    let section = |index: usize| {
        let along = index as f32 / SECTIONS as f32;
        [1.0, 0.0, 0.0, 1.0 - 2.0 * along, -0.25]
    };
    let fixed = |coefficient: f32| Fixed::from_bits((coefficient * (1u32 << 30) as f32) as i32);
    let fixed: FixedCascade = Cascade(core::array::from_fn(|index| Biquad {
        ba: section(index).map(fixed),
    }));
    let mut fixed_state = FixedState {
        x: [0; 2],
        y: [[0; 2]; SECTIONS],
    };
    let float: FloatCascade = Cascade(core::array::from_fn(|index| Biquad { ba: section(index) }));
    let mut float_state = FloatState {
        x: [0.0; 2],
        y: [[0.0; 2]; SECTIONS],
    };
    let coefficients = core::array::from_fn(|index| 0.3 / (index + 1) as f32);
    let mut direct = PlainDirect {
        coefficients,
        history: [0.0; 2 * MAX_ORDER],
        newest: 0,
    };
    let mut lattice = PlainLattice {
        reflection: coefficients,
        backward: [0.0; MAX_ORDER + 1],
    };
    let rotations: [Rotation; MAX_ORDER] =
        core::array::from_fn(|index| Rotation::from_theta(0x4000 / (index as i32 + 1)));
    let mut ours = LatticeState::new();
    let texture = Library::decode(LIBRARY).ok();
    let texture = texture.and_then(|library| library.texture("lattice, one node"));
    let frame = DirectFrame::silent(&texture.expect("the vectors' library has it"), 0);
    let mut ours_direct = DirectState::new();
    let mut noise = Excitation::new(1);
    for _ in 0..PEER_SAMPLES {
        let drawn = noise.next_sample() >> 8;
        let x = drawn as f32 / (1u32 << (excitation::FRACTION_BITS - 8)) as f32;
        black_box(idsp_fixed(&fixed, &mut fixed_state, drawn));
        black_box(idsp_float(&float, &mut float_state, x));
        black_box(plain_direct(&mut direct, x));
        black_box(plain_lattice(&mut lattice, x));
        black_box(lattice_alone(&mut ours, &rotations, drawn));
        black_box(direct_alone(&mut ours_direct, &frame, i64::from(drawn)));
    }
}

#[inline(never)]
fn lattice_alone(state: &mut LatticeState, rotations: &[Rotation], x: i32) -> i32 {
    state.filter::<CortexM>(rotations, x)
}

#[inline(never)]
fn direct_alone(state: &mut DirectState, frame: &DirectFrame, x: i64) -> (i32, bool) {
    state.filter(frame, x)
}

#[inline(never)]
fn idsp_fixed(cascade: &FixedCascade, state: &mut FixedState, x: i32) -> i32 {
    cascade.process(state, x)
}

#[inline(never)]
fn idsp_float(cascade: &FloatCascade, state: &mut FloatState, x: f32) -> f32 {
    cascade.process(state, x)
}

/// The direct form. Its history is written twice so that it never wraps.
struct PlainDirect {
    coefficients: [f32; MAX_ORDER],
    history: [f32; 2 * MAX_ORDER],
    newest: usize,
}

#[inline(never)]
fn plain_direct(filter: &mut PlainDirect, x: f32) -> f32 {
    let window = &filter.history[filter.newest..][..MAX_ORDER];
    let products = filter.coefficients.iter().zip(window).map(|(h, y)| h * y);
    let y = x + products.sum::<f32>();
    filter.newest = filter.newest.checked_sub(1).unwrap_or(MAX_ORDER - 1);
    filter.history[filter.newest] = y;
    filter.history[filter.newest + MAX_ORDER] = y;
    y
}

/// The two-multiplier lattice.
struct PlainLattice {
    reflection: [f32; MAX_ORDER],
    backward: [f32; MAX_ORDER + 1],
}

#[inline(never)]
fn plain_lattice(filter: &mut PlainLattice, x: f32) -> f32 {
    let mut forward = x;
    for (stage, k) in filter.reflection.iter().enumerate().rev() {
        let backward = filter.backward[stage];
        forward -= k * backward;
        filter.backward[stage + 1] = backward + k * forward;
    }
    filter.backward[0] = forward;
    forward
}
