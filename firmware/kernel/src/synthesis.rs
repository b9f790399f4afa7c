//! A texture being played: excitation, filter and level behind one interface for all structures.
//!
//! [`Frame`] is what a motion calls for, [`Playback`] what was played: a device computes the next frame below its
//! sample's priority and hands it over whole. [`Synthesis`] is both in one, for where there is no such hurry.

use model_format::{OutputSample, Structure, Texture};

use crate::arithmetic::{Arithmetic, Portable};
use crate::direct::{DirectFrame, DirectState, Word16, Word32};
use crate::excitation::Excitation;
use crate::grid::{GridPoint, Motion, ONE};
use crate::lattice::{LatticeFrame, LatticeState};
use crate::level::Levels;

/// How often coefficients follow the motion, samples: every 2 ms at 5 kHz.
pub const UPDATE_INTERVAL_SAMPLES: u32 = 10;

/// Coefficients and levels that a motion calls for. `M` is the processor's
/// arithmetic; all give the same bits.
#[derive(Clone, Debug)]
pub struct Frame<M: Arithmetic = Portable>(FrameOf<M>);

/// One for each structure. A texture of a single node needs no weighing of four.
#[derive(Clone, Debug)]
enum FrameOf<M: Arithmetic> {
    Lattice(LatticeFrame),
    Direct16One(DirectFrame<Word16<M>, 1, 1>),
    Direct16(DirectFrame<Word16<M>, 2, 2>),
    Direct32One(DirectFrame<Word32, 1, 1>),
    Direct32(DirectFrame<Word32, 2, 2>),
}

/// Runs an expression on the frame of any structure.
macro_rules! each_frame {
    ($frame:expr, $inner:ident => $result:expr) => {
        match $frame {
            FrameOf::Lattice($inner) => $result,
            FrameOf::Direct16One($inner) => $result,
            FrameOf::Direct16($inner) => $result,
            FrameOf::Direct32One($inner) => $result,
            FrameOf::Direct32($inner) => $result,
        }
    };
}

impl<M: Arithmetic> Frame<M> {
    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        let single = texture.speed_axis().len() * texture.force_axis().len() == 1;
        Self(match (texture.structure(), single) {
            (Structure::NormalisedLattice, _) => {
                FrameOf::Lattice(LatticeFrame::silent(texture.max_order()))
            }
            (Structure::DirectForm16, true) => FrameOf::Direct16One(DirectFrame::silent(texture)),
            (Structure::DirectForm16, false) => FrameOf::Direct16(DirectFrame::silent(texture)),
            (Structure::DirectForm32, true) => FrameOf::Direct32One(DirectFrame::silent(texture)),
            (Structure::DirectForm32, false) => FrameOf::Direct32(DirectFrame::silent(texture)),
        })
    }

    /// Makes this frame that of `motion` on `texture`, the one that it was made for; levels go there from `from`, those
    /// of the frame before, in `samples` samples.
    ///
    /// The work is some tens of thousands of instructions (`cargo tasks qemu` counts them), in bounded time, and is not part
    /// of a sample's.
    pub fn update(&mut self, texture: &Texture<'_>, motion: Motion, from: Levels, samples: u32) {
        self.update_scaled(texture, motion, ONE, from, samples);
    }

    /// As [`Frame::update`], with the level times `gain`, in steps of 2⁻¹⁶; [`ONE`] changes nothing.
    ///
    /// The gain costs nothing in a sample, as it is in the level's ramp. It must be one that a scene of `texture` may have;
    /// [`model_format::scene::Scene::validate`] knows which.
    pub fn update_scaled(
        &mut self,
        texture: &Texture<'_>,
        motion: Motion,
        gain: u32,
        from: Levels,
        samples: u32,
    ) {
        let mut point = GridPoint::locate(texture, motion);
        point.fade = ((u64::from(point.fade) * u64::from(gain)) / u64::from(ONE)) as u32;
        each_frame!(&mut self.0, frame => frame.update(texture, &point, from, samples));
    }

    /// The levels with `left` samples of their ramps to come: 0 when this frame has been played to its end.
    pub fn levels(&self, left: u32) -> Levels {
        each_frame!(&self.0, frame => frame.levels(left))
    }
}

/// What was played of a texture, and the noise to come.
#[derive(Clone, Debug)]
pub struct Playback<M: Arithmetic = Portable> {
    excitation: Excitation,
    state: State<M>,
    /// Samples of the current frame's ramps that are still to come.
    left: u32,
    saturations: u32,
}

#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one state is reserved once, for the largest"
)]
enum State<M: Arithmetic> {
    Lattice(LatticeState),
    Direct16(DirectState<Word16<M>>),
    Direct32(DirectState<Word32>),
}

impl<M: Arithmetic> State<M> {
    fn at_rest(texture: &Texture<'_>) -> Self {
        match texture.structure() {
            Structure::NormalisedLattice => Self::Lattice(LatticeState::new()),
            Structure::DirectForm16 => Self::Direct16(DirectState::new()),
            Structure::DirectForm32 => Self::Direct32(DirectState::new()),
        }
    }
}

impl<M: Arithmetic> Playback<M> {
    /// `texture` at rest; the same `seed` gives the same samples, always and everywhere.
    pub fn new(texture: &Texture<'_>, seed: u64) -> Self {
        Self {
            excitation: Excitation::new(seed),
            state: State::at_rest(texture),
            left: 0,
            saturations: 0,
        }
    }

    /// Takes up `texture`, at rest; the noise goes on.
    pub fn restart(&mut self, texture: &Texture<'_>) {
        self.state = State::at_rest(texture);
        self.left = 0;
    }

    /// A frame begins whose ramps take `samples` samples.
    #[inline]
    pub fn begin_frame(&mut self, samples: u32) {
        self.left = samples;
    }

    /// The next sample, by a frame of the texture that this was made for; by that of another structure it is silence.
    #[inline]
    pub fn next_sample(&mut self, frame: &Frame<M>) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let (left, excitation) = (self.left, self.excitation.next_sample());
        let (output, saturated) = match (&frame.0, &mut self.state) {
            (FrameOf::Lattice(frame), State::Lattice(state)) => {
                state.next_sample::<M>(frame, excitation, left)
            }
            (FrameOf::Direct16One(frame), State::Direct16(state)) => {
                state.next_sample(frame, excitation, left)
            }
            (FrameOf::Direct16(frame), State::Direct16(state)) => {
                state.next_sample(frame, excitation, left)
            }
            (FrameOf::Direct32One(frame), State::Direct32(state)) => {
                state.next_sample(frame, excitation, left)
            }
            (FrameOf::Direct32(frame), State::Direct32(state)) => {
                state.next_sample(frame, excitation, left)
            }
            _ => (OutputSample::SILENCE, false),
        };
        self.saturations = self.saturations.saturating_add(u32::from(saturated));
        output
    }

    /// Samples of the current frame's ramps that are still to come.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// How many samples were at full scale since the beginning: of the lattice its output before the level, of the direct
    /// form its history.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}

/// A texture being played, frame and playback in one.
#[derive(Clone, Debug)]
pub struct Synthesis<'a, M: Arithmetic = Portable> {
    texture: Texture<'a>,
    frame: Frame<M>,
    playback: Playback<M>,
}

impl<'a, M: Arithmetic> Synthesis<'a, M> {
    /// `texture` at rest, silent until it is moved; the same `seed` gives the same samples, always and everywhere.
    pub fn new(texture: Texture<'a>, seed: u64) -> Self {
        Self {
            texture,
            frame: Frame::silent(&texture),
            playback: Playback::new(&texture, seed),
        }
    }

    /// Takes over the motion of the moment: coefficients change with the next sample, the level goes from where it is to
    /// its new value within `samples` samples. See [`Frame::update`].
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        let from = self.frame.levels(self.playback.left());
        self.frame.update(&self.texture, motion, from, samples);
        self.playback.begin_frame(samples);
    }

    /// The next sample.
    #[inline]
    pub fn next_sample(&mut self) -> OutputSample {
        self.playback.next_sample(&self.frame)
    }

    /// See [`Playback::saturations`].
    pub fn saturations(&self) -> u32 {
        self.playback.saturations()
    }

    /// The texture that is played.
    pub fn texture(&self) -> Texture<'a> {
        self.texture
    }
}
