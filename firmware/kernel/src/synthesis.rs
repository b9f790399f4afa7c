//! A texture being played: excitation, filter and level behind one interface for all structures.

use model_format::{OutputSample, Structure, Texture};

use crate::direct::{DirectFrame, DirectState, Word16, Word32};
use crate::excitation::Excitation;
use crate::grid::{GridPoint, Motion};
use crate::lattice::{LatticeFrame, LatticeState};
use crate::multiply::{DualMultiply, Portable};

/// How often coefficients follow the motion, samples: every 2 ms at 5 kHz.
pub const UPDATE_INTERVAL_SAMPLES: u32 = 10;

/// A texture being played. `M` is how a processor multiplies 16-bit pairs; all give the same bits.
#[derive(Clone, Debug)]
pub struct Synthesis<'a, M: DualMultiply + Copy = Portable> {
    texture: Texture<'a>,
    excitation: Excitation,
    voice: Voice<M>,
    /// Samples of the current ramps that are still to come.
    left: u32,
    saturations: u32,
}

/// Frame and state of each structure. A texture of a single node needs no weighing of four.
#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one voice is reserved once, for the largest"
)]
enum Voice<M: DualMultiply + Copy> {
    Lattice(LatticeFrame, LatticeState),
    Direct16One(DirectFrame<Word16<M>, 1, 1>, DirectState<Word16<M>>),
    Direct16(DirectFrame<Word16<M>, 2, 2>, DirectState<Word16<M>>),
    Direct32One(DirectFrame<Word32, 1, 1>, DirectState<Word32>),
    Direct32(DirectFrame<Word32, 2, 2>, DirectState<Word32>),
}

impl<M: DualMultiply + Copy> Voice<M> {
    fn of(texture: &Texture<'_>) -> Self {
        let single = texture.speed_axis().len() * texture.force_axis().len() == 1;
        match (texture.structure(), single) {
            (Structure::NormalisedLattice, _) => Self::Lattice(
                LatticeFrame::silent(texture.max_order()),
                LatticeState::new(),
            ),
            (Structure::DirectForm16, true) => {
                Self::Direct16One(DirectFrame::silent(texture), DirectState::new())
            }
            (Structure::DirectForm16, false) => {
                Self::Direct16(DirectFrame::silent(texture), DirectState::new())
            }
            (Structure::DirectForm32, true) => {
                Self::Direct32One(DirectFrame::silent(texture), DirectState::new())
            }
            (Structure::DirectForm32, false) => {
                Self::Direct32(DirectFrame::silent(texture), DirectState::new())
            }
        }
    }
}

impl<'a, M: DualMultiply + Copy> Synthesis<'a, M> {
    /// `texture` at rest, silent until it is moved; the same `seed` gives the same samples, always and everywhere.
    pub fn new(texture: Texture<'a>, seed: u64) -> Self {
        Self {
            texture,
            excitation: Excitation::new(seed),
            voice: Voice::of(&texture),
            left: 0,
            saturations: 0,
        }
    }

    /// Takes over the motion of the moment: coefficients change with the next sample, the level reaches its new value
    /// within `samples` samples.
    ///
    /// The work is some tens of thousands of instructions (`cargo tasks qemu` counts them), in bounded time, and is not part
    /// of a sample's.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        let texture = &self.texture;
        let point = GridPoint::locate(texture, motion);
        match &mut self.voice {
            Voice::Lattice(frame, _) => frame.update(texture, &point, samples),
            Voice::Direct16One(frame, _) => frame.update(texture, &point, samples),
            Voice::Direct16(frame, _) => frame.update(texture, &point, samples),
            Voice::Direct32One(frame, _) => frame.update(texture, &point, samples),
            Voice::Direct32(frame, _) => frame.update(texture, &point, samples),
        }
        self.left = samples;
    }

    /// The next sample.
    #[inline]
    pub fn next_sample(&mut self) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let (left, excitation) = (self.left, self.excitation.next_sample());
        let (output, saturated) = match &mut self.voice {
            Voice::Lattice(frame, state) => state.next_sample(frame, excitation, left),
            Voice::Direct16One(frame, state) => state.next_sample(frame, excitation, left),
            Voice::Direct16(frame, state) => state.next_sample(frame, excitation, left),
            Voice::Direct32One(frame, state) => state.next_sample(frame, excitation, left),
            Voice::Direct32(frame, state) => state.next_sample(frame, excitation, left),
        };
        self.saturations = self.saturations.saturating_add(u32::from(saturated));
        output
    }

    /// How many samples were at full scale since the beginning.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }

    /// The texture that is played.
    pub fn texture(&self) -> Texture<'a> {
        self.texture
    }
}
