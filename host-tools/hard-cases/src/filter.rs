//! The kernel's filters with access to their state. They are the same frames and states that
//! [`stylus_kernel::Synthesis`] plays, but the excitation comes from outside.

use core::marker::PhantomData;

use model_format::{OutputSample, Texture};
use stylus_kernel::Motion;
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::{LatticeFrame, LatticeState};
use stylus_kernel::rotation::Rotation;

/// A filter of any structure.
pub trait Filter {
    /// Moves the filter to `motion` like [`stylus_kernel::Synthesis::follow`]. `left` samples of the level's present
    /// ramp remain. The level then changes to that of the motion within `samples` samples.
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion, left: u32, samples: u32);
    /// Puts one sample of `excitation`, in steps of 2⁻²⁸ of a standard deviation, through the filter, `left` samples
    /// before the end of the level's ramp. Returns the output, and whether it saturated.
    fn sample(&mut self, excitation: i32, left: u32) -> (OutputSample, bool);
    /// The newest signal of the state, full scale 2³¹.
    fn newest(&self) -> i32;
    /// The sum of the state's squares.
    fn energy(&self) -> u128;
    /// Returns whether any signal of the state is at an end of its range.
    fn is_at_full_scale(&self) -> bool;
    /// Sets every signal of the state to full scale with a random sign.
    fn glitch(&mut self, noise: &mut Excitation);
    /// Returns whether the filter is sure to fall silent without an excitation, also while the motion changes.
    fn settles(&self) -> bool {
        true
    }
    /// The rotations of a lattice at its latest motion.
    fn rotations(&self) -> &[Rotation] {
        &[]
    }
}

/// The kernel's normalised lattice.
pub struct Lattice<A> {
    frame: LatticeFrame,
    state: LatticeState,
    stages: usize,
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Lattice<A> {
    /// A lattice for `texture`, at rest.
    pub fn new(texture: &Texture<'_>) -> Self {
        Self {
            frame: LatticeFrame::silent(texture.max_order()),
            state: LatticeState::new(),
            stages: texture.max_order(),
            arithmetic: PhantomData,
        }
    }
}

impl<A: Arithmetic> Filter for Lattice<A> {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion, left: u32, samples: u32) {
        let point = GridPoint::locate(texture, motion);
        let from = self.frame.levels(left);
        self.frame.update::<A>(texture, &point, from, samples);
    }

    fn sample(&mut self, excitation: i32, left: u32) -> (OutputSample, bool) {
        self.state.next_sample::<A>(&self.frame, excitation, left)
    }

    fn newest(&self) -> i32 {
        self.state.backward(1)[0]
    }

    fn energy(&self) -> u128 {
        energy(self.state.backward(self.stages))
    }

    fn is_at_full_scale(&self) -> bool {
        any_at_end(self.state.backward(self.stages))
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        self.state = LatticeState::from_backward(core::array::from_fn(|_| full_scale(noise)));
    }

    fn rotations(&self) -> &[Rotation] {
        self.frame.rotations()
    }
}

/// Sum of the squares of `signals`, of which there are fewer than 2³².
///
/// Lower and upper halves of the squares are summed separately, because two words are faster than a long one.
pub fn energy(signals: &[i32]) -> u128 {
    let (low, high) = signals.iter().fold((0u64, 0u64), |(low, high), signal| {
        let square = u64::from(signal.unsigned_abs()) * u64::from(signal.unsigned_abs());
        (low + (square & u64::from(u32::MAX)), high + (square >> 32))
    });
    u128::from(low) + (u128::from(high) << 32)
}

/// Returns whether any of `signals` is at full scale. It checks all of them, which is faster than to stop at the first
/// one.
pub fn any_at_end(signals: &[i32]) -> bool {
    signals
        .iter()
        .map(|&signal| u32::from(signal == i32::MIN || signal == i32::MAX))
        .sum::<u32>()
        > 0
}

/// Returns full scale with a random sign.
pub fn full_scale(noise: &mut Excitation) -> i32 {
    if noise.next_sample() < 0 { i32::MIN } else { i32::MAX }
}
