//! The half of a scene that the tick runs; the block that the director hands to it, a list of stages; and a probe's
//! waveform, which is played unchanged.

use core::sync::atomic::{AtomicI16, Ordering};

use heapless::Vec;
use model_format::OutputSample;

use super::equaliser::{Equaliser, EqualiserState};
use super::stick_slip::{StickSlipFrame, StickSlipState};
use super::tap::{Resonance, Strike, TapState};
use crate::fixed::{saturate, shift_toward_zero};
use crate::level::Ramp;
use crate::lines::LinesFrame;

/// Whether the parts of a scene ring, which the [`super::Director`] needs to know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ringing {
    /// True if a tap rings.
    pub tap: bool,
    /// True if the equaliser rings.
    pub equaliser: bool,
}

/// State of a scene without its voices.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScenePlayback {
    tap: TapState,
    equaliser: EqualiserState,
    stick_slip: [StickSlipState; SLOTS],
    /// Samples of the block's ramps that remain.
    left: u32,
    saturations: u32,
}

impl ScenePlayback {
    /// Silence.
    pub const fn new() -> Self {
        Self {
            tap: TapState::new(),
            equaliser: EqualiserState::new(),
            stick_slip: [const { StickSlipState::new() }; SLOTS],
            left: 0,
            saturations: 0,
        }
    }

    /// Begins `block`, which was not played before. `begin_voice` is called with each voice whose frame begins with the
    /// block, for [`crate::Playback::begin_frame`].
    #[inline]
    pub fn begin_block(&mut self, block: &Block, mut begin_voice: impl FnMut(VoiceStage)) {
        self.left = block.samples;
        // Before the strike, which belongs to the new plan.
        if block.resets {
            self.tap = TapState::new();
            self.equaliser = EqualiserState::new();
        }
        if let Some(strike) = block.strike {
            self.tap.strike(strike);
        }
        for voice in block.stages.iter().filter_map(Stage::voice) {
            if voice.begins {
                begin_voice(voice);
            }
        }
    }

    /// The next sample of `block`. `voice` returns the next sample of a voice, see [`crate::Playback::next_sample`].
    #[inline]
    pub fn next_sample(&mut self, block: &Block, mut voice: impl FnMut(VoiceStage) -> OutputSample) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let mut mix = 0i64;
        let mut saturated = false;
        for stage in &block.stages {
            match stage {
                Stage::Voice(stage) => mix += i64::from(voice(*stage).0),
                Stage::StickSlip(stage, frame) => {
                    let state = &mut self.stick_slip[usize::from(stage.slot) % SLOTS];
                    mix += i64::from(state.modulate(frame, voice(*stage), self.left).0);
                }
                Stage::Lines(slot) => mix += block.lines_of(*slot, self.left),
                Stage::Tap(resonance) => mix += i64::from(self.tap.next_sample(*resonance).0),
                Stage::Wave => mix += block.wave_of(self.left),
                Stage::Equaliser => {
                    let (input, over) = saturate(mix);
                    let input = OutputSample(input);
                    let (output, full) = self.equaliser.process(&block.equaliser, input);
                    mix = i64::from(output.0);
                    saturated |= over | full;
                }
                // Two voices, eight lines of half a full scale in each slot, and a tap are at most eleven full scales,
                // which times 2¹⁶ are far from the end of 64 bits.
                Stage::FadeOut(ramp) => {
                    mix = shift_toward_zero(mix * i64::from(ramp.value(self.left)), 16);
                }
            }
        }
        let (output, over) = saturate(mix);
        self.saturations = self.saturations.saturating_add(u32::from(saturated | over));
        OutputSample(output)
    }

    /// Returns which parts ring. Call it after [`ScenePlayback::begin_block`] and before the director's next decision.
    pub fn ringing(&self) -> Ringing {
        Ringing {
            tap: !self.tap.is_silent(),
            equaliser: !self.equaliser.is_silent(),
        }
    }

    /// Samples of the block's ramps that remain.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// Number of samples that reached full scale in the sum or the equaliser. Voices count their own.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}

/// Number of voices that can sound at a time: two, while one surface fades into another.
pub const SLOTS: usize = 2;

/// Largest number of stages of a block: two voices with their lines, a tap, the equaliser, and the fade while scenes
/// change.
pub const MAX_STAGES: usize = 2 * SLOTS + 3;

/// A voice that sounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoiceStage {
    /// Index of the slot.
    pub slot: u8,
    /// Index of the frame within the slot.
    pub buffer: u8,
    /// True if that frame begins with the block; otherwise it continues from the previous block.
    pub begins: bool,
}

/// A stage that the tick runs per sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A voice.
    Voice(VoiceStage),
    /// A voice whose tool sticks and slips.
    StickSlip(VoiceStage, StickSlipFrame),
    /// The lines of the voice in this slot, which are tied to position.
    Lines(u8),
    /// A tap that rings.
    Tap(Resonance),
    /// A probe's waveform.
    Wave,
    /// The equaliser, for the sum of all earlier stages.
    Equaliser,
    /// A fade of the sum of all earlier stages, by a ramp that ends at zero with the block.
    FadeOut(Ramp),
}

impl Stage {
    /// The voice of the stage, if it has one.
    pub fn voice(&self) -> Option<VoiceStage> {
        match *self {
            Self::Voice(voice) | Self::StickSlip(voice, _) => Some(voice),
            Self::Lines(_) | Self::Tap(_) | Self::Wave | Self::Equaliser | Self::FadeOut(_) => None,
        }
    }
}

/// The stages of a block, in their order.
#[derive(Clone, Debug)]
pub struct Block {
    pub(super) stages: Vec<Stage, MAX_STAGES>,
    /// Lines of each slot's voice.
    pub(super) lines: [LinesFrame; SLOTS],
    pub(super) strike: Option<Strike>,
    /// Samples of a probe's waveform, the last one first.
    pub(super) wave: [i32; MAX_BLOCK_SAMPLES],
    /// True if tap and equaliser are reset before the first sample.
    pub(super) resets: bool,
    pub(super) samples: u32,
    pub(super) equaliser: Equaliser,
    /// Number of the plan whose equaliser this is.
    pub(super) equaliser_of: u32,
}

impl Block {
    /// Silence of unlimited length.
    pub const fn silent() -> Self {
        Self {
            stages: Vec::new(),
            lines: [const { LinesFrame::new() }; SLOTS],
            strike: None,
            wave: [0; MAX_BLOCK_SAMPLES],
            resets: false,
            samples: 0,
            equaliser: Equaliser::NONE,
            equaliser_of: 0,
        }
    }

    /// Adds a stage to the list.
    pub(super) fn push(&mut self, stage: Stage) {
        // The list has space for one of each.
        let _ = self.stages.push(stage);
    }

    /// The sample of the lines of `slot`, when `left` samples of the block remain.
    ///
    /// This is a separate function, marked as rare, because its registers would cost a tick without lines some
    /// instructions.
    #[cold]
    #[inline(never)]
    pub(super) fn lines_of(&self, slot: u8, left: u32) -> i64 {
        self.lines[usize::from(slot) % SLOTS].sample(left)
    }

    /// The sample of the probe's waveform, when `left` samples of the block remain. This is a separate function for the
    /// same reason as [`Block::lines_of`].
    #[cold]
    #[inline(never)]
    pub(super) fn wave_of(&self, left: u32) -> i64 {
        self.wave.get(left as usize).copied().unwrap_or(0).into()
    }

    /// The stages that the tick runs per sample, in their order.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Number of samples of the block, which all ramps take.
    pub fn samples(&self) -> u32 {
        self.samples
    }
}

/// Samples of the longest block: 2 ms at 10 kHz.
pub(super) const MAX_BLOCK_SAMPLES: usize = 20;

/// A periodic waveform with a beginning and an end.
#[derive(Clone, Copy, Debug)]
pub struct Wave<'a> {
    /// Samples of one period.
    pub samples: &'a [AtomicI16],
    /// Number of samples of all periods together.
    pub total: u32,
    /// Acceleration of a sample of value `i16::MAX`, m/s², below the output's full scale.
    pub peak_m_s2: f32,
    /// Tick of the first sample.
    pub first_tick: u64,
}

impl Wave<'_> {
    /// Fills `block` with the samples from number `from` on, the last one first, and with zeros before the wave begins
    /// and after its end. Returns false if no sample belongs to the wave.
    pub(super) fn fill(&self, from: i64, block: &mut [i32]) -> bool {
        let one = (1u32 << OutputSample::FRACTION_BITS) as f32;
        let step = self.peak_m_s2 * one / f32::from(i16::MAX);
        let mut sounds = false;
        for (place, number) in block.iter_mut().rev().zip(from..) {
            let number = u32::try_from(number).ok().filter(|&number| number < self.total);
            let sample = number.and_then(|number| {
                let at = (number as usize).checked_rem(self.samples.len())?;
                Some(self.samples[at].load(Ordering::Relaxed))
            });
            sounds |= sample.is_some();
            *place = (f32::from(sample.unwrap_or(0)) * step) as i32;
        }
        sounds
    }
}
