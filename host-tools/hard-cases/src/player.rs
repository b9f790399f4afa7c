//! The kernel's filters with access to their state, and a player that moves one along a path over a grid of two by two
//! nodes and drives it. They are the same frames and states that [`stylus_kernel::Synthesis`] plays, but the excitation
//! comes from outside.

use core::marker::PhantomData;

use model_format::{MillimetresPerSecond, Newton, OutputSample, Texture};
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
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

/// Speeds of the grid, mm/s.
pub const SPEEDS_MM_S: [f32; 2] = [100.0, 200.0];
/// Forces of the grid, N.
pub const FORCES_N: [f32; 2] = [0.5, 1.0];

/// A motion over a grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Path {
    /// Rest on a point: mm/s and N.
    Still(f32, f32),
    /// Jumps between the corners of the grid, every this number of samples.
    Saw(u32),
    /// Jumps to random points on the grid and a little beyond it, at equal intervals.
    Random {
        /// Number of samples from one change of the motion to the next.
        every: u32,
        /// Seed of the motion, not of the noise.
        seed: u64,
    },
}

impl Path {
    /// Number of samples from one change of the motion to the next; `None` if it does not change.
    pub fn every(&self) -> Option<u32> {
        match *self {
            Self::Still(..) => None,
            Self::Saw(every) | Self::Random { every, .. } => Some(every),
        }
    }

    /// The motion that begins at this sample, if one does.
    pub fn change_at(&self, sample: usize) -> Option<Motion> {
        let every = self.every().map(|every| every as usize);
        every
            .map_or(sample == 0, |every| sample.is_multiple_of(every))
            .then(|| {
                let (speed_mm_s, force_n) = self.place(sample / every.unwrap_or(1));
                Motion::new(MillimetresPerSecond(speed_mm_s), Newton(force_n)).expect("it is finite")
            })
    }

    /// Speed, mm/s, and force, N, in this interval of the path.
    fn place(&self, interval: usize) -> (f32, f32) {
        match *self {
            Self::Still(speed, force) => (speed, force),
            Self::Saw(_) => {
                // All four corners, each once after every other corner.
                const CORNERS: [usize; 12] = [0, 3, 1, 2, 0, 1, 3, 2, 3, 0, 2, 1];
                let corner = CORNERS[interval % CORNERS.len()];
                (SPEEDS_MM_S[corner / 2], FORCES_N[corner % 2])
            }
            Self::Random { seed, .. } => {
                // A generator for each interval, so that the place does not depend on those before it.
                let mut random = rand_pcg::Pcg64::seed_from_u64(seed ^ interval as u64);
                (
                    random.random_range(0.9 * SPEEDS_MM_S[0]..1.1 * SPEEDS_MM_S[1]),
                    random.random_range(0.9 * FORCES_N[0]..1.1 * FORCES_N[1]),
                )
            }
        }
    }
}

/// The excitation of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// The kernel's noise, with an RMS of an eighth of full scale.
    Noise,
    /// Noise with an RMS of a third of full scale.
    Loud,
    /// Silence, for which no noise is drawn.
    Nothing,
}

/// A filter that follows a path over its texture.
pub struct Player<'a, F: ?Sized> {
    /// The filter.
    pub filter: &'a mut F,
    texture: Texture<'a>,
    path: Path,
    noise: Excitation,
    sample: usize,
}

impl<'a, F: Filter + ?Sized> Player<'a, F> {
    /// Plays `texture` with `filter` from the beginning of `path`. `seed` is the noise's.
    pub fn new(filter: &'a mut F, texture: Texture<'a>, path: Path, seed: u64) -> Self {
        Self {
            filter,
            texture,
            path,
            noise: Excitation::new(seed),
            sample: 0,
        }
    }

    /// Goes on to the next sample's motion. Returns it if it begins there.
    pub fn move_on(&mut self) -> Option<Motion> {
        let change = self.path.change_at(self.sample);
        if let Some(motion) = change {
            // A ramp of one sample: the level jumps with the motion.
            self.filter.follow(&self.texture, motion, 0, 1);
        }
        self.sample += 1;
        change
    }

    /// Draws the excitation of the next sample, in steps of 2⁻²⁸ of a standard deviation.
    pub fn excitation(&mut self, drive: Drive) -> i32 {
        let gain = match drive {
            Drive::Noise => 1.0,
            Drive::Loud => 8.0 / 3.0,
            Drive::Nothing => return 0,
        };
        (f64::from(self.noise.next_sample()) * gain) as i32
    }

    /// Moves on and plays a sample. Returns the output, and whether it saturated.
    pub fn play(&mut self, drive: Drive) -> (OutputSample, bool) {
        self.move_on();
        let excitation = self.excitation(drive);
        self.filter.sample(excitation, 0)
    }
}
