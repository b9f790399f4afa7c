//! The traced functions. Their calls are found in the trace by their addresses, because none is inlined and none calls
//! another.

use core::hint::black_box;

use kernel_vectors::job::Filter;
use kernel_vectors::{COUNTED_SAMPLES, counted_motion};
use model_format::limits::MAX_ORDER;
use model_format::{Library, OutputSample, Texture};
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::variants::direct::{DirectFrame, DirectState};
use stylus_kernel::variants::normalised16::{Lattice16Frame, Lattice16State};
use stylus_kernel::variants::two_multiplier::{TwoMultiplierFrame, TwoMultiplierState};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};
use stylus_realtime::CortexM;

/// Plays every texture of `library` by `filter`, over the first `updates` updates of the motion.
pub fn play(filter: Filter, updates: u32, library: &[u8]) {
    let library = Library::decode(library).expect("the host wrote a library");
    for texture in library.textures() {
        match filter {
            Filter::Product => {
                let mut synthesis = Synthesis::from_rest(texture, 1);
                follow(&mut synthesis, updates, update, sample);
            }
            Filter::TwoMultiplier => {
                let mut variant = Variant {
                    texture,
                    excitation: Excitation::new(1),
                    frame: TwoMultiplierFrame::silent(texture.max_order()),
                    state: TwoMultiplierState::new(),
                    left: 0,
                };
                follow(
                    &mut variant,
                    updates,
                    two_multiplier_update,
                    two_multiplier_sample,
                );
            }
            Filter::Normalised16 => {
                let mut variant = Variant {
                    texture,
                    excitation: Excitation::new(1),
                    frame: Lattice16Frame::silent(texture.max_order()),
                    state: Lattice16State::new(),
                    left: 0,
                };
                follow(
                    &mut variant,
                    updates,
                    normalised16_update,
                    normalised16_sample,
                );
            }
            Filter::Direct => {
                let mut variant = Variant {
                    texture,
                    excitation: Excitation::new(1),
                    frame: DirectFrame::silent(&texture, 0),
                    state: DirectState::new(),
                    left: 0,
                };
                follow(&mut variant, updates, direct_update, direct_sample);
            }
        }
    }
}

/// Plays a texture along the motion.
fn follow<S>(
    player: &mut S,
    updates: u32,
    update: fn(&mut S, Motion),
    sample: fn(&mut S) -> OutputSample,
) {
    for index in 0..updates {
        black_box(update)(player, counted_motion(index));
        for _ in 0..COUNTED_SAMPLES {
            black_box(black_box(sample)(player));
        }
    }
}

#[inline(never)]
fn update(synthesis: &mut Synthesis<'_, CortexM>, motion: Motion) {
    synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
}

#[inline(never)]
fn sample(synthesis: &mut Synthesis<'_, CortexM>) -> OutputSample {
    synthesis.next_sample()
}

/// A structure that the product does not ship, with the excitation and level that the product has around every
/// structure.
struct Variant<'a, F, S> {
    texture: Texture<'a>,
    excitation: Excitation,
    frame: F,
    state: S,
    left: u32,
}

#[inline(never)]
fn two_multiplier_update(
    variant: &mut Variant<'_, TwoMultiplierFrame, TwoMultiplierState>,
    motion: Motion,
) {
    let point = GridPoint::locate(&variant.texture, motion);
    let from = variant.frame.levels(variant.left);
    let samples = UPDATE_INTERVAL_SAMPLES;
    variant
        .frame
        .update(&variant.texture, &point, from, samples);
    variant.left = samples;
}

#[inline(never)]
fn two_multiplier_sample(
    variant: &mut Variant<'_, TwoMultiplierFrame, TwoMultiplierState>,
) -> OutputSample {
    variant.left = variant.left.saturating_sub(1);
    let excitation = variant.excitation.next_sample();
    variant
        .state
        .next_sample(&variant.frame, excitation, variant.left)
        .0
}

#[inline(never)]
fn normalised16_update(variant: &mut Variant<'_, Lattice16Frame, Lattice16State>, motion: Motion) {
    let point = GridPoint::locate(&variant.texture, motion);
    let from = variant.frame.levels(variant.left);
    let samples = UPDATE_INTERVAL_SAMPLES;
    variant
        .frame
        .update(&variant.texture, &point, from, samples);
    variant.left = samples;
}

#[inline(never)]
fn normalised16_sample(variant: &mut Variant<'_, Lattice16Frame, Lattice16State>) -> OutputSample {
    variant.left = variant.left.saturating_sub(1);
    let excitation = variant.excitation.next_sample();
    variant
        .state
        .next_sample(&variant.frame, excitation, variant.left)
        .0
}

/// Made-up predictors: the instructions depend on their number alone.
static PREDICTOR: [i32; MAX_ORDER] = [1 << 20; MAX_ORDER];

#[inline(never)]
fn direct_update(variant: &mut Variant<'_, DirectFrame, DirectState>, motion: Motion) {
    let point = GridPoint::locate(&variant.texture, motion);
    let from = variant.frame.levels(variant.left);
    let samples = UPDATE_INTERVAL_SAMPLES;
    let nodes = [black_box(&PREDICTOR[..variant.texture.max_order()]); 4];
    variant
        .frame
        .update(&variant.texture, &point, nodes, from, samples);
    variant.left = samples;
}

#[inline(never)]
fn direct_sample(variant: &mut Variant<'_, DirectFrame, DirectState>) -> OutputSample {
    variant.left = variant.left.saturating_sub(1);
    let excitation = variant.excitation.next_sample();
    variant
        .state
        .next_sample(&variant.frame, excitation, variant.left)
        .0
}
