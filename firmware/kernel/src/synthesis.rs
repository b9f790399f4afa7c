//! A texture being played: excitation, filter and level behind one interface for all structures.
//!
//! A [`Frame`] holds the coefficients and levels of a motion, a [`Playback`] the state of what was played. A device
//! computes the next frame below its sample's priority and hands it over as a whole. [`Synthesis`] joins both, for
//! programs that compute frame and samples in one thread.

use core::marker::PhantomData;

use model_format::{OutputSample, PlayRate, Structure, Texture};

use crate::arithmetic::{Arithmetic, Portable};
use crate::direct::{self, DirectFrame, DirectState};
use crate::excitation::Excitation;
use crate::feed::{Feed, Material};
use crate::fixed::saturate;
use crate::grid::{GridPoint, Motion, ONE};
use crate::lattice::{LatticeFrame, LatticeState};
use crate::level::Levels;
use crate::lines::{LinesFrame, VoiceLines};
use crate::position::{Position, Track};

/// Update interval of the coefficients, samples: 2 ms at 5 kHz. [`update_interval_samples`] has it at other rates.
pub const UPDATE_INTERVAL_SAMPLES: u32 = 10;

/// Update interval at `sample_rate_hz`, samples: 2 ms at each rate that a stylus plays, and
/// [`UPDATE_INTERVAL_SAMPLES`] at others.
pub const fn update_interval_samples(sample_rate_hz: u32) -> u32 {
    match PlayRate::of(sample_rate_hz) {
        Some(rate) => UPDATE_INTERVAL_SAMPLES * rate.samples_per_tick(),
        None => UPDATE_INTERVAL_SAMPLES,
    }
}

/// Most samples of a fed texture's frame.
///
/// A device's frames take [`update_interval_samples`], and none of the host's programs more than 50.
pub const MAX_FED_SAMPLES: usize = 64;

/// Samples that a playback takes through its filter at once, in [`Playback::next_block`].
const BLOCK_SAMPLES: usize = 64;

/// Coefficients and levels of a motion, and the excitation of a fed texture.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Frame {
    filter: FrameOf,
    excitation: Words,
}

/// The excitation of a fed texture for the samples of a frame.
#[derive(Clone, Debug)]
struct Words {
    /// The excitation in steps of 2⁻²⁵, the last sample at index 1. Index 0 is that of samples after the last, and
    /// always 0.
    steps: [i32; MAX_FED_SAMPLES + 1],
    /// Number of samples.
    samples: u32,
    /// Number of the frame, which tells it from the one before.
    number: u32,
}

/// The place in the words of the frame that is played.
#[derive(Clone, Copy, Debug, Default)]
struct Feeding {
    /// Number of that frame.
    number: u32,
    /// Index of the next word.
    next: u32,
}

impl Feeding {
    /// The next word, 0 after the last.
    ///
    /// A frame's first word takes the instructions of the others: its number gives a mask, and no branch.
    #[inline(always)]
    fn next_word(&mut self, words: &Words) -> i32 {
        let differs = self.number ^ words.number;
        let begins = (differs | differs.wrapping_neg()).cast_signed() >> 31;
        let begins = begins.cast_unsigned();
        self.number = words.number;
        self.next = (words.samples & begins) | (self.next & !begins);
        let word = words.steps.get(self.next as usize).copied().unwrap_or(0);
        self.next = self.next.saturating_sub(1);
        word
    }
}

/// Scale that all frames of a texture share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Exponent of a direct form's coefficients; see [`direct::exponent`].
    exponent: u32,
}

impl Scale {
    /// The scale of `texture`.
    pub fn of(texture: &Texture<'_>) -> Self {
        let exponent = match texture.structure() {
            Structure::NormalisedLattice => 0,
            Structure::DirectForm16 | Structure::DirectForm32 => direct::exponent(texture),
        };
        Self { exponent }
    }
}

/// A frame of either filter.
#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one frame is reserved once, for the largest"
)]
enum FrameOf {
    Lattice(LatticeFrame),
    Direct(DirectFrame),
}

/// Runs an expression on the frame of either filter.
macro_rules! each_frame {
    ($frame:expr, $inner:ident => $result:expr) => {
        match $frame {
            FrameOf::Lattice($inner) => $result,
            FrameOf::Direct($inner) => $result,
        }
    };
}

impl Frame {
    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        Self::silent_at(texture, Scale::of(texture))
    }

    /// A silent frame for `texture`, whose [`Scale`] is known.
    pub fn silent_at(texture: &Texture<'_>, scale: Scale) -> Self {
        let filter = match texture.structure() {
            Structure::NormalisedLattice => {
                FrameOf::Lattice(LatticeFrame::silent(texture.max_order()))
            }
            Structure::DirectForm16 | Structure::DirectForm32 => {
                FrameOf::Direct(DirectFrame::silent_at(texture, scale.exponent))
            }
        };
        Self {
            filter,
            excitation: Words {
                steps: [0; MAX_FED_SAMPLES + 1],
                samples: 0,
                number: 0,
            },
        }
    }

    /// Makes this the frame of `motion` on `texture`, the one that it was made for. Levels go from `from`, those of the
    /// frame before, to their new values in `samples` samples.
    ///
    /// The work is bounded, and is not part of a sample's. A plain lattice of order 400 takes at most ten thousand
    /// instructions on a Cortex-M4, one with fractions and a tail, whose levels are averaged in dB, twelve thousand;
    /// `cargo tasks qemu` counts them. A motion that rests can be held instead, see [`Frame::hold`].
    pub fn update<A: Arithmetic>(
        &mut self,
        texture: &Texture<'_>,
        motion: Motion,
        from: Levels,
        samples: u32,
    ) {
        self.update_scaled::<A>(texture, motion, ONE, from, samples);
    }

    /// As [`Frame::update`], with the level times `gain`, in steps of 2⁻¹⁶: [`ONE`] leaves the level as it is.
    ///
    /// The gain costs nothing in a sample, because it is part of the level's ramp. It must be a gain that a valid
    /// scene of `texture` may have, see [`model_format::scene::Scene::validate`].
    pub fn update_scaled<A: Arithmetic>(
        &mut self,
        texture: &Texture<'_>,
        motion: Motion,
        gain: u32,
        from: Levels,
        samples: u32,
    ) {
        let mut point = GridPoint::locate(texture, motion);
        point.fade = ((u64::from(point.fade) * u64::from(gain)) / u64::from(ONE)) as u32;
        each_frame!(&mut self.filter, frame => frame.update::<A>(texture, &point, from, samples));
    }

    /// As [`Frame::update_scaled`] with the motion, texture and gain of this frame's last update, which is the same
    /// bits in some ten instructions: a motion that rests costs nothing.
    pub fn hold(&mut self, from: Levels, samples: u32) {
        each_frame!(&mut self.filter, frame => frame.hold(from, samples));
    }

    /// Takes the excitation of `samples` samples at `motion` from `feed`, that of `texture`, which is fed.
    ///
    /// The frame then holds the excitation of so many samples, at most [`MAX_FED_SAMPLES`], and is played once. Samples
    /// after the last, as those of a late update, have an excitation of 0: the filter rings out.
    pub fn feed(&mut self, feed: &mut Feed, texture: &Texture<'_>, motion: Motion, samples: u32) {
        let (material, point) = (Material::of(texture), GridPoint::locate(texture, motion));
        let samples = (samples as usize).min(MAX_FED_SAMPLES);
        for word in self.excitation.steps[1..=samples].iter_mut().rev() {
            *word = feed.next_sample(&material, &point);
        }
        (self.excitation.samples, self.excitation.number) = (samples as u32, feed.next_frame());
    }

    /// Makes this a silent frame with the coefficients of `motion`, for [`Playback::run_up`].
    pub fn prepare<A: Arithmetic>(&mut self, texture: &Texture<'_>, motion: Motion) {
        self.update_scaled::<A>(texture, motion, 0, Levels::SILENT, 1);
    }

    /// The levels with `left` samples of their ramps to come; `left` is 0 at the end of the frame.
    pub fn levels(&self, left: u32) -> Levels {
        each_frame!(&self.filter, frame => frame.levels(left))
    }
}

/// State of a texture's filter, and the source of its excitation.
///
/// It never begins empty, because a narrow line would then be too low for as long as it rings, up to a second. A
/// lattice begins in a state drawn from the excitation, stationary for every motion. A direct form begins cold: it is
/// silent until it was run up, see [`Playback::run_up`].
#[derive(Clone, Debug)]
pub struct Playback {
    excitation: Excitation,
    state: State,
    /// Samples that the state has yet to be run up.
    cold: u32,
    /// Samples of the current frame's ramps that are still to come.
    left: u32,
    saturations: u32,
    feeding: Feeding,
}

#[derive(Clone, Debug)]
enum State {
    Lattice(LatticeState),
    Direct(DirectState),
    /// A lattice of a fed texture.
    FedLattice(LatticeState),
    /// A direct form of a fed texture.
    FedDirect(DirectState),
}

impl State {
    fn at_rest(texture: &Texture<'_>) -> Self {
        match (texture.structure(), texture.is_fed()) {
            (Structure::NormalisedLattice, false) => Self::Lattice(LatticeState::new()),
            (Structure::NormalisedLattice, true) => Self::FedLattice(LatticeState::new()),
            (Structure::DirectForm16 | Structure::DirectForm32, false) => {
                Self::Direct(DirectState::new())
            }
            (Structure::DirectForm16 | Structure::DirectForm32, true) => {
                Self::FedDirect(DirectState::new())
            }
        }
    }

    /// The state in which `texture` begins, with the number of samples that it must be run up before it is heard.
    fn beginning(texture: &Texture<'_>, excitation: &mut Excitation) -> (Self, u32) {
        match texture.structure() {
            Structure::NormalisedLattice => {
                let stages = texture.max_order();
                let state = if texture.is_fed() {
                    Self::FedLattice(LatticeState::fed_stationary(stages, excitation))
                } else {
                    Self::Lattice(LatticeState::stationary(stages, excitation))
                };
                (state, 0)
            }
            Structure::DirectForm16 | Structure::DirectForm32 => {
                (Self::at_rest(texture), direct::RUN_UP_SAMPLES)
            }
        }
    }
}

impl Playback {
    /// The beginning of `texture`. The same `seed` gives the same samples on every machine.
    pub fn new(texture: &Texture<'_>, seed: u64) -> Self {
        let mut excitation = Excitation::new(seed);
        let (state, cold) = State::beginning(texture, &mut excitation);
        Self {
            excitation,
            state,
            cold,
            left: 0,
            saturations: 0,
            feeding: Feeding::default(),
        }
    }

    /// The state of `texture` that is empty and not to be run up, with the noise of `seed` from its first sample on:
    /// for comparisons with filters that begin so. No device plays from it.
    pub fn from_rest(texture: &Texture<'_>, seed: u64) -> Self {
        Self {
            excitation: Excitation::new(seed),
            state: State::at_rest(texture),
            cold: 0,
            left: 0,
            saturations: 0,
            feeding: Feeding::default(),
        }
    }

    /// Changes to the beginning of `texture`. The excitation goes on, whether it is made here or by `feed`.
    ///
    /// `feed` is that of all fed textures of this playback. It begins with this texture, if it is fed.
    pub fn restart(&mut self, texture: &Texture<'_>, feed: &mut Feed) {
        if self.is_fed() {
            self.excitation = feed.gaussian().clone();
        }
        (self.state, self.cold) = State::beginning(texture, &mut self.excitation);
        self.left = 0;
        self.begin_feed(feed);
    }

    /// Begins `feed` with the texture that this was made for, if it is fed.
    pub fn begin_feed(&self, feed: &mut Feed) {
        if self.is_fed() {
            feed.begin(self.excitation.clone());
        }
    }

    fn is_fed(&self) -> bool {
        matches!(self.state, State::FedLattice(_) | State::FedDirect(_))
    }

    /// Number of samples that are still to be run up before the texture may be heard: 0 for a lattice.
    pub fn cold(&self) -> u32 {
        self.cold
    }

    /// Runs the state up by at most `samples` samples, at the end of the ramps of `frame`, a frame of the texture.
    ///
    /// Samples at full scale do not count, because nobody hears them. The excitation of a fed texture is that of `feed`
    /// at `motion`.
    pub fn run_up<A: Arithmetic>(
        &mut self,
        frame: &Frame,
        texture: &Texture<'_>,
        motion: Motion,
        feed: &mut Feed,
        samples: u32,
    ) {
        let FrameOf::Direct(frame) = &frame.filter else {
            return;
        };
        let samples = samples.min(self.cold);
        match &mut self.state {
            State::Direct(state) => {
                state.begin::<A>(frame);
                for _ in 0..samples {
                    state.run::<A>(frame, self.excitation.next_sample());
                }
            }
            State::FedDirect(state) => {
                let (material, point) = (Material::of(texture), GridPoint::locate(texture, motion));
                state.begin::<A>(frame);
                for _ in 0..samples {
                    state.run_fed::<A>(frame, feed.next_sample(&material, &point));
                }
            }
            State::Lattice(_) | State::FedLattice(_) => return,
        }
        self.cold -= samples;
    }

    /// Begins `frame`, a frame of the texture that this was made for, whose ramps take `samples` samples.
    #[inline]
    pub fn begin_frame<A: Arithmetic>(&mut self, frame: &Frame, samples: u32) {
        self.left = samples;
        if let FrameOf::Direct(frame) = &frame.filter
            && let State::Direct(state) | State::FedDirect(state) = &mut self.state
        {
            state.begin::<A>(frame);
        }
    }

    /// The next sample, by a frame of the texture that this was made for. A frame of another structure gives silence.
    ///
    /// `A` is the processor's arithmetic; all give the same bits.
    #[inline]
    pub fn next_sample<A: Arithmetic>(&mut self, frame: &Frame) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let (left, excitation) = (self.left, self.excitation.next_sample());
        let (output, saturated) = match (&frame.filter, &mut self.state) {
            (FrameOf::Lattice(frame), State::Lattice(state)) => {
                state.next_sample::<A>(frame, excitation, left)
            }
            (FrameOf::Direct(frame), State::Direct(state)) => {
                state.next_sample::<A>(frame, excitation, left)
            }
            _ => self.next_fed_sample::<A>(frame, left),
        };
        self.saturations = self.saturations.saturating_add(u32::from(saturated));
        output
    }

    /// The next sample of a fed texture, which takes the excitation that the frame was fed with, and whether it is at
    /// full scale. It is apart from that of a plain texture, so that it does not touch that one's instructions.
    #[cold]
    #[inline(never)]
    fn next_fed_sample<A: Arithmetic>(&mut self, frame: &Frame, left: u32) -> (OutputSample, bool) {
        let excitation = self.feeding.next_word(&frame.excitation);
        match (&frame.filter, &mut self.state) {
            (FrameOf::Lattice(frame), State::FedLattice(state)) => {
                state.next_fed_sample::<A>(frame, excitation, left)
            }
            (FrameOf::Direct(frame), State::FedDirect(state)) => {
                state.next_fed_sample::<A>(frame, excitation, left)
            }
            _ => (OutputSample::SILENCE, false),
        }
    }

    /// The next samples, those of a call of [`Playback::next_sample`] for each.
    ///
    /// A lattice takes less time for many at once, if `A` has [`Arithmetic::rotate_block`]. This is for programs that
    /// may know all of them before the first is put out.
    pub fn next_block<A: Arithmetic>(&mut self, frame: &Frame, outputs: &mut [OutputSample]) {
        for outputs in outputs.chunks_mut(BLOCK_SAMPLES) {
            let mut words = [0; BLOCK_SAMPLES];
            let words = &mut words[..outputs.len()];
            if !self.next_words::<A>(frame, words) {
                outputs.fill_with(|| self.next_sample::<A>(frame));
                continue;
            }
            for (output, &word) in outputs.iter_mut().zip(words.iter()) {
                *output = OutputSample(word);
            }
        }
    }

    /// Fills `words`, at most [`BLOCK_SAMPLES`], with the next samples of a lattice. Returns false, and does nothing,
    /// if this is none.
    fn next_words<A: Arithmetic>(&mut self, frame: &Frame, words: &mut [i32]) -> bool {
        let left = self.left;
        let FrameOf::Lattice(lattice) = &frame.filter else {
            return false;
        };
        let full = match &mut self.state {
            State::Lattice(state) => {
                words.fill_with(|| self.excitation.next_sample());
                state.next_block::<A>(lattice, words, left)
            }
            State::FedLattice(state) => {
                let mut fed = [0; BLOCK_SAMPLES];
                let fed = &mut fed[..words.len()];
                // The generator goes on, as it does for single samples.
                fed.fill_with(|| {
                    self.excitation.next_sample();
                    self.feeding.next_word(&frame.excitation)
                });
                state.next_fed_block::<A>(lattice, fed, words, left)
            }
            State::Direct(_) | State::FedDirect(_) => return false,
        };
        self.left = left.saturating_sub(words.len() as u32);
        self.saturations = self.saturations.saturating_add(full);
        true
    }

    /// Samples of the current frame's ramps that are still to come.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// Number of samples at full scale since the beginning: in a lattice the output before the level, in a direct
    /// form the history.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}

/// A texture being played, frame and playback in one, by the arithmetic `A`.
#[derive(Clone, Debug)]
pub struct Synthesis<'a, A: Arithmetic = Portable> {
    texture: Texture<'a>,
    frame: Frame,
    /// The motion that the frame is of.
    motion: Option<Motion>,
    playback: Playback,
    /// The excitation, if the texture is fed.
    feed: Feed,
    lines: Option<LinesPlayback>,
    arithmetic: PhantomData<A>,
}

/// Lines of the texture, the way of the tool, and what is played of both.
#[derive(Clone, Debug)]
struct LinesPlayback {
    lines: VoiceLines,
    frame: LinesFrame,
    track: Track,
    saturations: u32,
}

impl LinesPlayback {
    fn new(texture: &Texture<'_>) -> Option<Self> {
        Some(Self {
            lines: VoiceLines::new(texture)?,
            frame: LinesFrame::new(),
            track: Track::new(),
            saturations: 0,
        })
    }

    /// `sample` with the lines added, `left` samples of the block to come.
    fn added(&mut self, sample: OutputSample, left: u32) -> OutputSample {
        let (sum, over) = saturate(i64::from(sample.0) + self.frame.sample(left));
        self.saturations = self.saturations.saturating_add(u32::from(over));
        OutputSample(sum)
    }
}

impl<'a, A: Arithmetic> Synthesis<'a, A> {
    /// Plays `texture`: it is silent until [`Synthesis::follow`] gives it a motion, and then at its level. The same
    /// `seed` gives the same samples on every machine.
    pub fn new(texture: Texture<'a>, seed: u64) -> Self {
        Self::of_playback(texture, Playback::new(&texture, seed), seed)
    }

    /// Plays `texture` from an empty state; see [`Playback::from_rest`].
    pub fn from_rest(texture: Texture<'a>, seed: u64) -> Self {
        Self::of_playback(texture, Playback::from_rest(&texture, seed), seed)
    }

    fn of_playback(texture: Texture<'a>, playback: Playback, seed: u64) -> Self {
        let mut feed = Feed::new(seed);
        playback.begin_feed(&mut feed);
        Self {
            texture,
            frame: Frame::silent(&texture),
            motion: None,
            playback,
            feed,
            lines: LinesPlayback::new(&texture),
            arithmetic: PhantomData,
        }
    }

    /// Follows `motion`: coefficients change with the next sample, and the level goes to its new value in `samples`
    /// samples. It is called once per update interval, see [`UPDATE_INTERVAL_SAMPLES`] and [`Frame::update`].
    ///
    /// The first motion that a cold texture sounds at runs it up as a whole, which takes the time of
    /// [`direct::RUN_UP_SAMPLES`] samples. A fed texture is followed at least every [`MAX_FED_SAMPLES`] samples, see
    /// [`Frame::feed`].
    ///
    /// Lines that are locked to place go on by the motion's speed.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        self.follow_to(motion, None, samples);
    }

    /// As [`Synthesis::follow`], with the position that the tool has at the last of `samples` samples, for lines that
    /// are locked to place. Without one it is the integral of the speed.
    pub fn follow_to(&mut self, motion: Motion, position: Option<Position>, samples: u32) {
        if self.playback.cold() > 0 {
            self.run_up(motion);
        }
        let left = self.playback.left();
        if let Some(lines) = &mut self.lines {
            let (speed, rate) = (motion.speed_mm_s(), self.texture.sample_rate_hz());
            let passage = lines.track.advance(position, speed, samples, left, rate);
            let voice = &mut lines.lines;
            let frame = voice.follow(&self.texture, motion, ONE, passage, samples, left);
            lines.frame.clone_from(frame);
        }
        let from = self.frame.levels(left);
        if self.motion.replace(motion) == Some(motion) {
            self.frame.hold(from, samples);
        } else {
            self.frame.update::<A>(&self.texture, motion, from, samples);
        }
        if self.playback.is_fed() {
            self.frame
                .feed(&mut self.feed, &self.texture, motion, samples);
        }
        self.playback.begin_frame::<A>(&self.frame, samples);
    }

    fn run_up(&mut self, motion: Motion) {
        if GridPoint::locate(&self.texture, motion).fade > 0 {
            self.frame.prepare::<A>(&self.texture, motion);
            self.motion = None;
            let (frame, texture, feed) = (&self.frame, &self.texture, &mut self.feed);
            self.playback
                .run_up::<A>(frame, texture, motion, feed, u32::MAX);
        }
    }

    /// The next sample.
    #[inline]
    pub fn next_sample(&mut self) -> OutputSample {
        let sample = self.playback.next_sample::<A>(&self.frame);
        match &mut self.lines {
            Some(lines) => lines.added(sample, self.playback.left()),
            None => sample,
        }
    }

    /// The next samples, those of a call of [`Synthesis::next_sample`] for each; see [`Playback::next_block`].
    pub fn next_block(&mut self, outputs: &mut [OutputSample]) {
        let left = self.playback.left();
        self.playback.next_block::<A>(&self.frame, outputs);
        if let Some(lines) = &mut self.lines {
            for (output, played) in outputs.iter_mut().zip(1..) {
                *output = lines.added(*output, left.saturating_sub(played));
            }
        }
    }

    /// Number of samples at full scale; see [`Playback::saturations`]. Sums with lines count too.
    pub fn saturations(&self) -> u32 {
        let of_lines = self.lines.as_ref().map_or(0, |lines| lines.saturations);
        self.playback.saturations().saturating_add(of_lines)
    }

    /// The texture that is played.
    pub fn texture(&self) -> Texture<'a> {
        self.texture
    }
}
