//! The kernel's filters with access to their state. They are the same frames and states that
//! [`stylus_kernel::Synthesis`] plays, but the excitation comes from outside.

use model_format::{OutputSample, Texture};
use stylus_kernel::Motion;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::{LatticeFrame, LatticeState};
use stylus_kernel::rotation::Rotation;

use crate::playing::wavefront::Wavefront;

/// A filter of any structure.
pub trait Player {
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

/// A player for `texture`, at rest.
pub fn player(texture: &Texture<'_>) -> Box<dyn Player> {
    Box::new(Lattice {
        frame: LatticeFrame::silent(texture.max_order()),
        state: LatticeState::new(),
        stages: texture.max_order(),
    })
}

struct Lattice {
    frame: LatticeFrame,
    state: LatticeState,
    stages: usize,
}

/// Sum of the squares of `signals`, of which there are fewer than 2³².
///
/// Lower and upper halves of the squares are summed separately, because two words are faster than a long one.
pub fn energy(signals: impl Iterator<Item = i32>) -> u128 {
    let (low, high) = signals.fold((0u64, 0u64), |(low, high), signal| {
        let square = u64::from(signal.unsigned_abs()) * u64::from(signal.unsigned_abs());
        (low + (square & u64::from(u32::MAX)), high + (square >> 32))
    });
    u128::from(low) + (u128::from(high) << 32)
}

/// Returns whether any of `signals` is at full scale. It checks all of them, which is faster than to stop at the first
/// one.
pub fn any_at_end(signals: impl Iterator<Item = i32>) -> bool {
    let ends = signals.map(|signal| u32::from(signal == i32::MIN || signal == i32::MAX));
    ends.sum::<u32>() > 0
}

impl Player for Lattice {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion, left: u32, samples: u32) {
        let point = GridPoint::locate(texture, motion);
        let from = self.frame.levels(left);
        self.frame
            .update::<Wavefront>(texture, &point, from, samples);
    }

    fn sample(&mut self, excitation: i32, left: u32) -> (OutputSample, bool) {
        self.state
            .next_sample::<Wavefront>(&self.frame, excitation, left)
    }

    fn newest(&self) -> i32 {
        self.state.backward(1)[0]
    }

    fn energy(&self) -> u128 {
        energy(self.state.backward(self.stages).iter().copied())
    }

    fn is_at_full_scale(&self) -> bool {
        any_at_end(self.state.backward(self.stages).iter().copied())
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        self.state = LatticeState::from_backward(std::array::from_fn(|_| full_scale(noise)));
    }

    fn rotations(&self) -> &[Rotation] {
        self.frame.rotations()
    }
}

/// Returns full scale with a random sign.
pub fn full_scale(noise: &mut Excitation) -> i32 {
    if noise.next_sample() < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::models::{fixtures, library};
    use model_format::{Library, MillimetresPerSecond, Newton};
    use proptest::prelude::*;
    use stylus_kernel::Synthesis;

    /// The stressed filter and the played one give the same bits.
    #[test]
    fn a_player_and_a_synthesis_play_the_same() {
        let models = fixtures();
        let nodes: Vec<_> = [0, 1, 3, 0].map(|index| (&models[index], 4.0)).to_vec();
        let bytes = library(&nodes).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let mut synthesis: Synthesis<'_> = Synthesis::from_rest(texture, 5);
        let (mut player, mut noise, mut left) = (player(&texture), Excitation::new(5), 0);
        for n in 0..2000u16 {
            let speed = MillimetresPerSecond(f32::from(n % 97) * 3.0);
            let motion = Motion::new(speed, Newton(f32::from(n % 31) / 25.0)).unwrap();
            // In one sample, and in ramps that are cut short.
            let samples = if n < 1000 { 1 } else { 10 };
            synthesis.follow(motion, samples);
            player.follow(&texture, motion, left, samples);
            left = samples;
            for _ in 0..samples.min(7) {
                left -= 1;
                let played = player.sample(noise.next_sample(), left).0;
                assert_eq!(played, synthesis.next_sample(), "step {n}");
            }
        }
    }

    proptest! {
        #[test]
        fn energy_is_the_exact_sum_of_squares_and_ends_are_found(
            signals in prop::collection::vec(prop_oneof![any::<i32>(), Just(i32::MIN), Just(i32::MAX)], 0..800),
        ) {
            let exact: u128 = signals.iter().map(|&signal| u128::from(signal.unsigned_abs()).pow(2)).sum();
            prop_assert_eq!(energy(signals.iter().copied()), exact);
            let at_end = signals.iter().any(|&signal| signal == i32::MIN || signal == i32::MAX);
            prop_assert_eq!(any_at_end(signals.iter().copied()), at_end);
        }
    }
}
