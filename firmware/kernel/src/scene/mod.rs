//! Playing a scene: at each moment only the stages that it needs.
//!
//! ```text
//! below the tick, once per block         in the tick, per sample
//!
//! Interaction --> Director --> Block --> ScenePlayback: voice 0 --> stick-slip --+
//!                    |        (whole)                   voice 1 --> stick-slip --+
//!                    v                                  tap ---------------------+--> equaliser --> output
//!              frames of voices
//! ```
//! A [`Plan`] is the compiled scene; it does not change. Once per block, the [`Director`] decides from it which voices
//! sound, whether a tap rings, and whether the tool sticks. The result is a [`Block`], a list of stages. The tick runs
//! only that list, so that a stage that is not in it costs nothing. Without contact, and once nothing rings any more,
//! the list is empty.
//!
//! Gains and the weights of a transition are part of the voices' levels, which ramp across each block. They cost no
//! instruction in the tick, and no change of region, gain or contact is faster than a block.
//!
//! The equaliser's sections are those of the scene, followed by those of the device's response, if it has one. A
//! [`Wave`] is played instead of voices: it is the waveform of a probe, which measures that response.
//!
//! [`ScenePlayer`] joins both halves, for programs that compute blocks and samples in one thread. A scene of one
//! surface without effects plays, bit for bit, what [`crate::Synthesis`] plays of its texture.

pub mod cost;
mod director;
mod equaliser;
mod interaction;
mod path;
mod plan;
mod playback;
mod slots;
mod stick_slip;
mod tap;

use core::marker::PhantomData;

use model_format::OutputSample;

use crate::arithmetic::{Arithmetic, Portable};
use crate::level::Levels;
use crate::synthesis::{Frame, Playback};

pub use director::Director;
pub use equaliser::{Equaliser, EqualiserState};
pub use interaction::{ContactDetector, ContactThreshold, Interaction, InteractionError};
pub use path::{Located, Path};
pub use plan::Plan;
pub use playback::{Block, MAX_STAGES, Ringing, SLOTS, ScenePlayback, Stage, VoiceStage, Wave};
pub use slots::Voices;
pub use stick_slip::{StickSlipFrame, StickSlipState, StickSlipWindow};
pub use tap::{Resonance, Strike, TapState};

/// Largest number of samples that voices play ahead, in [`ScenePlayer::next_block`].
const BLOCK_SAMPLES: usize = 64;

/// A scene being played: director, voices and playback in one.
#[derive(Clone, Debug)]
pub struct ScenePlayer<'a, A: Arithmetic = Portable> {
    director: Director<'a>,
    voices: OwnVoices<A>,
    playback: ScenePlayback,
    block: Block,
}

/// The voices, owned by the player alone.
#[derive(Clone, Debug)]
struct OwnVoices<A> {
    frames: [[Option<Frame>; 2]; SLOTS],
    playbacks: [Option<Playback>; SLOTS],
    arithmetic: PhantomData<A>,
}

impl<A: Arithmetic> Voices for OwnVoices<A> {
    type Arithmetic = A;

    fn frame(&mut self, slot: usize, buffer: usize) -> &mut Option<Frame> {
        &mut self.frames[slot][buffer]
    }

    fn levels(&self, slot: usize, buffer: usize, left: u32) -> Levels {
        let frame = self.frames[slot][buffer].as_ref();
        frame.map_or(Levels::SILENT, |frame| frame.levels(left))
    }

    fn playback(&mut self, slot: usize) -> &mut Option<Playback> {
        &mut self.playbacks[slot]
    }
}

impl<'a, A: Arithmetic> ScenePlayer<'a, A> {
    /// Plays `plan` from rest: it is silent until the tool touches. The same `seed` gives the same samples on every
    /// machine.
    pub fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            director: Director::new(plan, seed),
            #[expect(
                clippy::large_stack_arrays,
                reason = "a host's stack holds two voices; a device keeps them where it wants"
            )]
            voices: OwnVoices {
                frames: [const { [const { None }; 2] }; SLOTS],
                playbacks: [const { None }; SLOTS],
                arithmetic: PhantomData,
            },
            playback: ScenePlayback::new(),
            block: Block::silent(),
        }
    }

    /// Follows `interaction` for a block of `samples` samples; see [`Director::next_block`].
    pub fn follow(&mut self, interaction: Interaction, samples: u32) {
        let (left, ringing) = (self.playback.left(), self.playback.ringing());
        let (voices, block) = (&mut self.voices, &mut self.block);
        self.director
            .next_block(interaction, samples, left, ringing, voices, block);
        let playbacks = &mut self.voices.playbacks;
        self.playback.begin_block(&self.block, |voice| {
            if let Some(playback) = &mut playbacks[usize::from(voice.slot)] {
                playback.begin_frame(samples);
            }
        });
    }

    /// Sets the tick at which the next block begins; see [`Director::at_tick`].
    pub fn at_tick(&mut self, tick: u64) {
        self.director.at_tick(tick);
    }

    /// The next sample.
    #[inline]
    pub fn next_sample(&mut self) -> OutputSample {
        let OwnVoices { frames, playbacks, .. } = &mut self.voices;
        self.playback.next_sample(&self.block, |voice| {
            let slot = usize::from(voice.slot);
            match (&mut playbacks[slot], &frames[slot][usize::from(voice.buffer)]) {
                (Some(playback), Some(frame)) => playback.next_sample::<A>(frame),
                _ => OutputSample::SILENCE,
            }
        })
    }

    /// Computes the next samples, like a call of [`ScenePlayer::next_sample`] for each; see
    /// [`Playback::next_block`](crate::Playback::next_block).
    pub fn next_block(&mut self, outputs: &mut [OutputSample]) {
        for outputs in outputs.chunks_mut(BLOCK_SAMPLES) {
            self.next_short_block(outputs);
        }
    }

    /// Computes the next samples, at most [`BLOCK_SAMPLES`]. Voices play ahead, because none depends on a later stage.
    fn next_short_block(&mut self, outputs: &mut [OutputSample]) {
        let mut ahead = [[OutputSample::SILENCE; BLOCK_SAMPLES]; SLOTS];
        let voices = &mut self.voices;
        for voice in self.block.stages().iter().filter_map(Stage::voice) {
            let slot = usize::from(voice.slot);
            let frame = &voices.frames[slot][usize::from(voice.buffer)];
            if let (Some(playback), Some(frame)) = (&mut voices.playbacks[slot], frame) {
                playback.next_block::<A>(frame, &mut ahead[slot][..outputs.len()]);
            }
        }
        for (index, output) in outputs.iter_mut().enumerate() {
            let voice = |voice: VoiceStage| ahead[usize::from(voice.slot)][index];
            *output = self.playback.next_sample(&self.block, voice);
        }
    }

    /// Changes to `plan` as soon as everything audible has faded; see [`Director::switch`].
    pub fn switch(&mut self, plan: Plan<'a>) {
        self.director.switch(plan);
    }

    /// The block that is played.
    pub fn block(&self) -> &Block {
        &self.block
    }

    /// The director.
    pub fn director(&self) -> &Director<'a> {
        &self.director
    }

    /// Number of samples that reached full scale since the beginning, in voices, their sum, or the equaliser.
    pub fn saturations(&self) -> u32 {
        let voices = self.voices.playbacks.iter().flatten();
        let voices = voices.map(Playback::saturations);
        voices.fold(self.playback.saturations(), u32::saturating_add)
    }
}
