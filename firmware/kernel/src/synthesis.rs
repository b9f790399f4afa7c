//! A texture being played: excitation, filter and level behind one interface.
//!
//! A [`Frame`] holds the coefficients and levels of a motion, a [`Playback`] the state of what was played. A device
//! computes the next frame at a lower priority than its samples and hands it over as a whole. [`Synthesis`] joins both,
//! for programs that compute frame and samples in one thread.

use core::marker::PhantomData;

use model_format::{OutputSample, PlayRate, Texture};

use crate::arithmetic::{Arithmetic, Portable};
use crate::excitation::Excitation;
use crate::feed::{Feed, Material};
use crate::fixed::saturate;
use crate::grid::{GridPoint, Motion, ONE};
use crate::lattice::{LatticeFrame, LatticeState};
use crate::level::Levels;
use crate::lines::{LinesFrame, VoiceLines};
use crate::position::{Position, Track};

/// Update interval of the coefficients, samples: 2 ms at 5 kHz. [`update_interval_samples`] gives it for other rates.
pub const UPDATE_INTERVAL_SAMPLES: u32 = 10;

/// Update interval at `sample_rate_hz`, samples: 2 ms at each rate that a stylus plays, and
/// [`UPDATE_INTERVAL_SAMPLES`] at others.
pub const fn update_interval_samples(sample_rate_hz: u32) -> u32 {
    match PlayRate::of(sample_rate_hz) {
        Some(rate) => UPDATE_INTERVAL_SAMPLES * rate.samples_per_tick(),
        None => UPDATE_INTERVAL_SAMPLES,
    }
}

/// Largest number of samples of a fed texture's frame.
///
/// A device's frames take [`update_interval_samples`], and none of the host's programs more than 50.
pub const MAX_FED_SAMPLES: usize = 64;

/// Largest number of samples that a playback passes through its filter at once, in [`Playback::next_block`].
const BLOCK_SAMPLES: usize = 64;

/// Coefficients and levels of a motion, and the excitation of a fed texture.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Frame {
    lattice: LatticeFrame,
    excitation: Words,
}

/// The excitation of a fed texture for the samples of a frame.
#[derive(Clone, Debug)]
struct Words {
    /// The excitation in steps of 2⁻²⁵, the last sample at index 1. Index 0 is for samples after the last one, and is
    /// always 0.
    steps: [i32; MAX_FED_SAMPLES + 1],
    /// Number of samples.
    samples: u32,
    /// Number of the frame, which distinguishes it from the previous one.
    number: u32,
}

/// The place in the words of the frame that is played.
#[derive(Clone, Copy, Debug, Default)]
struct Feeding {
    /// Number of the frame that is played.
    number: u32,
    /// Index of the next word.
    next: u32,
}

impl Feeding {
    /// Returns the next word, 0 after the last.
    ///
    /// A frame's first word takes as many instructions as the others: its number gives a mask, and no branch.
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

impl Frame {
    /// A silent frame of no texture.
    pub const fn empty() -> Self {
        Self {
            lattice: LatticeFrame::silent(0),
            excitation: Words {
                steps: [0; MAX_FED_SAMPLES + 1],
                samples: 0,
                number: 0,
            },
        }
    }

    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        let mut frame = Self::empty();
        frame.silence(texture);
        frame
    }

    /// Makes this a silent frame for `texture`. It works in place, because a frame takes kilobytes of the stack.
    pub fn silence(&mut self, texture: &Texture<'_>) {
        self.lattice.silence(texture.max_order());
        self.excitation.steps.fill(0);
        (self.excitation.samples, self.excitation.number) = (0, 0);
    }

    /// Makes this the frame of `motion` on `texture`, for which this frame was created. Levels go from `from`, the
    /// levels of the previous frame, to their new values in `samples` samples.
    ///
    /// The work is bounded, and is not part of a sample's. For a plain lattice of order 400 it takes at most ten
    /// thousand instructions on a Cortex-M4; with fractions, a tail, and levels averaged in dB, it takes twelve
    /// thousand. `cargo test -p qemu-tests` counts them. A motion that does not change can be held instead, see
    /// [`Frame::hold`].
    pub fn update<A: Arithmetic>(&mut self, texture: &Texture<'_>, motion: Motion, from: Levels, samples: u32) {
        self.update_scaled::<A>(texture, motion, ONE, from, samples);
    }

    /// Like [`Frame::update`], with the level times `gain`, in steps of 2⁻¹⁶: [`ONE`] leaves the level as it is.
    ///
    /// The gain costs no time in a sample, because it is part of the level's ramp. It must be a gain that a valid scene
    /// of `texture` may have, see [`model_format::scene::Scene::validate`].
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
        self.lattice.update::<A>(texture, &point, from, samples);
    }

    /// Like [`Frame::update_scaled`] with the motion, texture and gain of this frame's last update: the same bits, but
    /// in some ten instructions. So a motion that does not change costs almost nothing.
    pub fn hold(&mut self, from: Levels, samples: u32) {
        self.lattice.hold(from, samples);
    }

    /// Takes the excitation of `samples` samples at `motion` from `feed`, the feed of `texture`, which must be fed.
    ///
    /// The frame then holds the excitation of that many samples, at most [`MAX_FED_SAMPLES`], and is played once. Later
    /// samples, for example those of a late update, have an excitation of 0: the filter rings out.
    pub fn feed(&mut self, feed: &mut Feed, texture: &Texture<'_>, motion: Motion, samples: u32) {
        let (material, point) = (Material::of(texture), GridPoint::locate(texture, motion));
        let samples = (samples as usize).min(MAX_FED_SAMPLES);
        for word in self.excitation.steps[1..=samples].iter_mut().rev() {
            *word = feed.next_sample(&material, &point);
        }
        (self.excitation.samples, self.excitation.number) = (samples as u32, feed.next_frame());
    }

    /// The levels when `left` samples of their ramps remain; `left` is 0 at the end of the frame.
    pub fn levels(&self, left: u32) -> Levels {
        self.lattice.levels(left)
    }
}

/// State of a texture's filter, and the source of its excitation.
///
/// Except by [`Playback::from_rest`], it never begins empty, because a narrow resonance would then be too weak for as
/// long as it rings, up to a second. It begins in a state drawn from the excitation, stationary for every motion.
#[derive(Clone, Debug)]
pub struct Playback {
    excitation: Excitation,
    state: LatticeState,
    is_fed: bool,
    /// Samples of the current frame's ramps that remain.
    left: u32,
    saturations: u32,
    feeding: Feeding,
}

/// Returns the state in which `texture` begins.
fn beginning(texture: &Texture<'_>, excitation: &mut Excitation) -> LatticeState {
    let stages = texture.max_order();
    if texture.is_fed() {
        LatticeState::fed_stationary(stages, excitation)
    } else {
        LatticeState::stationary(stages, excitation)
    }
}

impl Playback {
    /// Begins `texture`. The same `seed` gives the same samples on every machine.
    pub fn new(texture: &Texture<'_>, seed: u64) -> Self {
        let mut excitation = Excitation::new(seed);
        let state = beginning(texture, &mut excitation);
        Self {
            excitation,
            state,
            is_fed: texture.is_fed(),
            left: 0,
            saturations: 0,
            feeding: Feeding::default(),
        }
    }

    /// An empty state for `texture`, with the noise of `seed` from its first sample on. It is for comparisons with
    /// filters that begin like that. No device plays from it.
    pub fn from_rest(texture: &Texture<'_>, seed: u64) -> Self {
        Self {
            excitation: Excitation::new(seed),
            state: LatticeState::new(),
            is_fed: texture.is_fed(),
            left: 0,
            saturations: 0,
            feeding: Feeding::default(),
        }
    }

    /// Changes to the beginning of `texture`. The excitation continues, whether computed here or by `feed`.
    ///
    /// `feed` serves all fed textures of this playback. It begins with this texture, if the texture is fed.
    pub fn restart(&mut self, texture: &Texture<'_>, feed: &mut Feed) {
        if self.is_fed {
            self.excitation = feed.gaussian().clone();
        }
        self.state = beginning(texture, &mut self.excitation);
        self.is_fed = texture.is_fed();
        self.left = 0;
        self.begin_feed(feed);
    }

    /// Begins `feed` with the texture for which this was created, if the texture is fed.
    pub fn begin_feed(&self, feed: &mut Feed) {
        if self.is_fed {
            feed.begin(self.excitation.clone());
        }
    }

    /// Begins a frame of the texture for which this was created. Its ramps take `samples` samples.
    #[inline]
    pub fn begin_frame(&mut self, samples: u32) {
        self.left = samples;
    }

    /// Returns the next sample, with a frame of the texture for which this was created.
    ///
    /// `A` is the processor's arithmetic; all give the same bits.
    #[inline]
    pub fn next_sample<A: Arithmetic>(&mut self, frame: &Frame) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let (left, excitation) = (self.left, self.excitation.next_sample());
        let (output, saturated) = if self.is_fed {
            self.next_fed_sample::<A>(frame, left)
        } else {
            self.state.next_sample::<A>(&frame.lattice, excitation, left)
        };
        self.saturations = self.saturations.saturating_add(u32::from(saturated));
        output
    }

    /// Returns the next sample of a fed texture, from the excitation that the frame holds, and whether it is at full
    /// scale. It is separate from a plain texture's path, so that it does not change the instructions there.
    #[cold]
    #[inline(never)]
    fn next_fed_sample<A: Arithmetic>(&mut self, frame: &Frame, left: u32) -> (OutputSample, bool) {
        let excitation = self.feeding.next_word(&frame.excitation);
        let lattice = &frame.lattice;
        self.state.next_fed_sample::<A>(lattice, excitation, left)
    }

    /// Computes the next samples, like a call of [`Playback::next_sample`] for each.
    ///
    /// Many samples at once take less time, if `A` implements [`Arithmetic::rotate_block`]. This is for programs that
    /// may know all of them before the first is put out.
    pub fn next_block<A: Arithmetic>(&mut self, frame: &Frame, outputs: &mut [OutputSample]) {
        for outputs in outputs.chunks_mut(BLOCK_SAMPLES) {
            let mut words = [0; BLOCK_SAMPLES];
            let words = &mut words[..outputs.len()];
            self.next_words::<A>(frame, words);
            for (output, &word) in outputs.iter_mut().zip(words.iter()) {
                *output = OutputSample(word);
            }
        }
    }

    /// Fills `words`, at most [`BLOCK_SAMPLES`], with the next samples.
    fn next_words<A: Arithmetic>(&mut self, frame: &Frame, words: &mut [i32]) {
        let (left, lattice) = (self.left, &frame.lattice);
        let full = if self.is_fed {
            let mut fed = [0; BLOCK_SAMPLES];
            let fed = &mut fed[..words.len()];
            // The generator advances, like for single samples.
            fed.fill_with(|| {
                self.excitation.next_sample();
                self.feeding.next_word(&frame.excitation)
            });
            self.state.next_fed_block::<A>(lattice, fed, words, left)
        } else {
            words.fill_with(|| self.excitation.next_sample());
            self.state.next_block::<A>(lattice, words, left)
        };
        self.left = left.saturating_sub(words.len() as u32);
        self.saturations = self.saturations.saturating_add(full);
    }

    /// Samples of the current frame's ramps that remain.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// Number of samples that reached full scale since the beginning: in the lattice, before the level; in a fed
    /// texture also in the excitation and after the level.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}

/// A texture being played, frame and playback in one, computed with the arithmetic `A`.
#[derive(Clone, Debug)]
pub struct Synthesis<'a, A: Arithmetic = Portable> {
    texture: Texture<'a>,
    frame: Frame,
    /// The motion of the frame.
    motion: Option<Motion>,
    playback: Playback,
    /// The excitation, if the texture is fed.
    feed: Feed,
    lines: Option<LinesPlayback>,
    arithmetic: PhantomData<A>,
}

/// Lines of the texture, the movement of the tool, and the frame of lines that is played.
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

    /// Returns `sample` with the lines added, when `left` samples of the block remain.
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
    /// For a fed texture it must be called at least every [`MAX_FED_SAMPLES`] samples, see [`Frame::feed`].
    ///
    /// Lines that are tied to position advance by the motion's speed.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        self.follow_to(motion, None, samples);
    }

    /// Like [`Synthesis::follow`], with the position that the tool has at the last of `samples` samples, for lines that
    /// are tied to position. Without one, the position is the integral of the speed.
    pub fn follow_to(&mut self, motion: Motion, position: Option<Position>, samples: u32) {
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
        if self.playback.is_fed {
            self.frame.feed(&mut self.feed, &self.texture, motion, samples);
        }
        self.playback.begin_frame(samples);
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

    /// Computes the next samples, like a call of [`Synthesis::next_sample`] for each; see [`Playback::next_block`].
    pub fn next_block(&mut self, outputs: &mut [OutputSample]) {
        let left = self.playback.left();
        self.playback.next_block::<A>(&self.frame, outputs);
        if let Some(lines) = &mut self.lines {
            for (output, played) in outputs.iter_mut().zip(1..) {
                *output = lines.added(*output, left.saturating_sub(played));
            }
        }
    }

    /// Number of samples that reached full scale; see [`Playback::saturations`]. Sums with lines count, too.
    pub fn saturations(&self) -> u32 {
        let of_lines = self.lines.as_ref().map_or(0, |lines| lines.saturations);
        self.playback.saturations().saturating_add(of_lines)
    }

    /// The texture that is played.
    pub fn texture(&self) -> Texture<'a> {
        self.texture
    }
}
